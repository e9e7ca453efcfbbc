/* SPDX-License-Identifier: GPL-3.0-or-later */
#include "lighting/centres.h"

/* Distance from a point to the box of all particles' centres. */
static double distance_to_box(const fum_octree *octree, const double point[3]) {
  const fum_octree_node *root = &octree->nodes[0];
  double squared = 0.0;
  for (int axis = 0; axis < 3; axis++) {
    const double below = (double)root->lower[axis] - point[axis], above = point[axis] - (double)root->upper[axis];
    const double gap = fmax(0.0, fmax(below, above));
    squared += gap * gap;
  }
  return sqrt(squared);
}

/* Angles as seen from a particle that change by less than this across it: its size over a distance. */
static double angle_over(double sigma, double distance) {
  return distance > 0.0 ? sigma / distance : INFINITY;
}

/* The steepest relative change of Henyey and Greenstein's function over an angle. */
static double steepest_phase(const fum_scene *scene) {
  double steepest = 0.0;
  for (int32_t s = 0; s < scene->particles_count; s++) {
    const double g = fabs((double)scene->particles[s].anisotropy);
    steepest = fmax(steepest, 3.0 * g / ((1.0 - g) * (1.0 - g)));
  }
  return steepest;
}

bool fum_centres_suffice(const fum_scene *scene, const fum_octree *octree, const fum_view *view, const fum_slabs *slabs,
                         const fum_lamps *lamps, const fum_solids *solids, float tolerance) {
  const double per_angle = 0.25, allowed = 0.5 * (double)tolerance, sigma = 1.0 / (double)octree->sums[0].least_inverse,
               phase = steepest_phase(scene);
  const double *m = view->local_from_camera;
  if (solids != NULL || !(slabs->thickness <= allowed)) return false;
  if (phase > 0.0 && view->type == FUM_CAMERA_PERSPECTIVE &&
      per_angle * phase * angle_over(sigma, distance_to_box(octree, (double[3]){m[3], m[7], m[11]})) > allowed)
    return false;
  for (int32_t l = 0; l < lamps->count; l++) {
    const fum_lamp *lamp = &lamps->items[l];
    if (lamp->desc.type == FUM_LIGHT_SUN || lamp->environment != NULL || !lamp->lights_smoke) continue;
    if (lamp->desc.type != FUM_LIGHT_POINT) return false;
    const double at[3] = {(double)lamp->position.x, (double)lamp->position.y, (double)lamp->position.z};
    /* Strength falls with the square of the distance. Seen across a particle that is far from its neighbours, a quarter
     * of that is left; where they overlap, less (measured). */
    if (per_angle * (2.0 + phase) * angle_over(sigma, distance_to_box(octree, at)) > allowed) return false;
  }
  return true;
}
