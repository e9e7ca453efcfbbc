/* SPDX-License-Identifier: GPL-3.0-or-later */
#include "lighting/sweep_view.h"

#include <string.h>

static void cross(const double a[3], const double b[3], double out[3]) {
  for (int axis = 0; axis < 3; axis++) {
    const int next = (axis + 1) % 3, last = (axis + 2) % 3;
    out[axis] = a[next] * b[last] - a[last] * b[next];
  }
}

static double dot(const double a[3], const double b[3]) {
  return a[0] * b[0] + a[1] * b[1] + a[2] * b[2];
}

static fum_vec3 to_floats(const double v[3]) {
  return (fum_vec3){(float)v[0], (float)v[1], (float)v[2]};
}

/* A face that looks along `axis` (unit), with the window -half..half. */
static void aim_face(const double to_middle[3], const double axis[3], double half, fum_sweep_face *out) {
  double helper[3] = {0.0, 0.0, 0.0}, right[3], up[3];
  helper[fabs(axis[0]) < 0.6 ? 0 : 1] = 1.0;
  cross(axis, helper, right);
  const double length = sqrt(dot(right, right));
  for (int i = 0; i < 3; i++)
    right[i] /= length;
  cross(right, axis, up);
  *out =
      (fum_sweep_face){.right = to_floats(right),
                       .up = to_floats(up),
                       .axis = to_floats(axis),
                       .offset = {(float)dot(to_middle, right), (float)dot(to_middle, up), (float)dot(to_middle, axis)},
                       .lower = {(float)-half, (float)-half},
                       .upper = {(float)half, (float)half}};
}

/* Sigmas behind its centre at which a caster in the light's vicinity ends. */
static const float NEAR_REACH = 3.5F;

/* Beside dense smoke its tails alone are seen: the denser the smoke is as a whole, the farther they reach. */
static float reach_for(double optical_depth) {
  const double least = 2.6, most = 4.4, left = 0.02; /* of the optical depth, before the tail falls off from there */
  return (float)fmin(most, fmax(least, sqrt(2.0 * log(fmax(1.0, optical_depth / left)))));
}

/* Sigma where a caster is widest, at most: a Gaussian's longest axis is within its stretches' root of the sum of
 * squares.
 */
static float widest_of(const fum_octree *casters, float sigma, int64_t i) {
  const int64_t step = casters->count + FUM_OCTREE_PAD;
  const float *s = casters->stretches;
  if (s == NULL) return sigma;
  const float xx = s[i], yy = s[i + step], xy = s[i + 2 * step], xz = s[i + 3 * step], yz = s[i + 4 * step];
  const float squares = xx * xx + yy * yy + (xx + yy) * (xx + yy) + 2.0F * (xy * xy + xz * xz + yz * yz);
  return sqrtf(sigma * sigma + sqrtf(squares));
}

/* Finds the sigmas that casters have, and as seen from the light; returns the distance of the farthest. */
static float find_sigmas(fum_context *context, const fum_medium *medium, const fum_sweep_view *view) {
  const fum_octree *casters = fum_medium_casters(medium);
  const double *o = view->to_middle;
  const fum_vec3 middle = view->middle, to_middle = {(float)o[0], (float)o[1], (float)o[2]};
  const float scale = medium->sigma_scale;
  const float *x = casters->x, *y = casters->y, *z = casters->z, *depths = casters->optical_depths;
  float *sigmas = view->sigmas, *widest = view->widest, farthest = 0.0F;
#pragma omp parallel for simd num_threads(fum_thread_count(context)) reduction(max : farthest)
  for (int64_t i = 0; i < casters->count; i++) {
    const fum_vec3 way = {x[i] - middle.x + to_middle.x, y[i] - middle.y + to_middle.y, z[i] - middle.z + to_middle.z};
    const float distance = view->is_parallel ? 1.0F : sqrtf(fum_dot(way, way)),
                is_there = depths[i] > 0.0F ? 1.0F : 0.0F, sigma = scale / casters->inverse_sigmas[i];
    sigmas[i] = is_there * sigma / distance;
    widest[i] = widest_of(casters, sigma, i);
    farthest = fmaxf(is_there * distance, farthest);
  }
  return farthest;
}

/* Sets the casters in the light's vicinity apart and measures both them and the others. */
static void part(fum_context *context, const fum_medium *medium, float outermost, fum_sweep_view *view) {
  /* Sigma over distance above which a shadow isn't a footprint; ratio of distances that ranges are good for. */
  const float widest = 0.1F, most_ratio = 100.0F, scale = medium->sigma_scale;
  const fum_octree *casters = fum_medium_casters(medium);
  const bool is_parallel = view->is_parallel;
  float nearest = INFINITY, farthest = 0.0F, smallest = INFINITY, largest = 0.0F, wide = 0.0F, reach = 0.0F;
  float smallest_near = INFINITY;
  int64_t near_count = 0;
  const int threads = fum_thread_count(context);
#pragma omp parallel for num_threads(threads) reduction(+ : near_count) reduction(min                                  \
                                                        : nearest, smallest, smallest_near) reduction(max : farthest, largest, wide, reach)
  for (int64_t i = 0; i < casters->count; i++) {
    const float sigma = view->sigmas[i], inverse = casters->inverse_sigmas[i];
    if (!(sigma > 0.0F)) continue;
    const float distance = is_parallel ? 1.0F : scale / (inverse * sigma);
    if (!is_parallel && (sigma > widest || most_ratio * distance < outermost)) {
      near_count++;
      smallest_near = fum_min(sigma, smallest_near);
      reach = fum_max(distance + NEAR_REACH * scale / inverse, reach);
      view->sigmas[i] = 0.0F;
      continue;
    }
    nearest = fum_min(distance, nearest);
    farthest = fum_max(distance, farthest);
    smallest = fum_min(sigma, smallest);
    largest = fum_max(sigma, largest);
    wide = fum_max(view->widest[i], wide);
  }
  view->vicinity = (fum_sweep_vicinity){near_count, (double)reach, (double)smallest_near};
  view->nearest = (double)nearest;
  view->farthest = (double)farthest;
  view->reference = sqrt((double)nearest * (double)farthest);
  view->smallest = smallest;
  view->largest = largest;
  view->reach_m = (double)wide;
}

/* How casters, all within `radius`, are seen. False if none is but in the light's vicinity. */
static bool measure(fum_context *context, const fum_medium *medium, double radius, fum_sweep_view *view) {
  part(context, medium, find_sigmas(context, medium, view), view);
  view->reach = reach_for(2.0 * medium->mass / fmax(radius * radius, 1e-60));
  view->reach_m *= (double)view->reach;
  return view->farthest > 0.0;
}

/* Around the light where it is near, else before it: a window around the cone of the casters. Receivers beyond are in
 * nobody's shadow. */
static void aim_faces(double radius, const double axis[3], fum_sweep_view *view) {
  const double distance = sqrt(dot(view->to_middle, view->to_middle));
  if (!view->is_parallel && distance < 1.5 * radius) {
    view->face_count = FUM_SWEEP_FACES;
    for (int f = 0; f < FUM_SWEEP_FACES; f++) {
      double side[3] = {0.0};
      side[f / 2] = f % 2 == 0 ? 1.0 : -1.0;
      aim_face(view->to_middle, side, 1.001, &view->faces[f]);
    }
    return;
  }
  const double half = view->is_parallel ? radius : radius / sqrt(distance * distance - radius * radius);
  view->face_count = 1;
  aim_face(view->to_middle, axis, 1.05 * half + 1e-30, &view->faces[0]);
}

int32_t fum_sweep_view_find(fum_context *context, const fum_medium *medium, const fum_emitter *emitter,
                            fum_sweep_view *out_view, bool *out_is_clear) {
  const char *what = "a light's view";
  const double far_away = 1e4; /* radii of the casters: their rays are parallel within a hundredth of a sigma */
  const fum_octree *casters = fum_medium_casters(medium);
  const fum_octree_node *root = casters->nodes;
  const fum_vec3 p = emitter->position, d = emitter->direction;
  const double light[3] = {(double)p.x, (double)p.y, (double)p.z};
  double axis[3] = {-(double)d.x, -(double)d.y, -(double)d.z}, middle[3], radius = 0.0;
  fum_sweep_view view = {.is_parallel = emitter->is_directional};
  *out_is_clear = false;
  if (casters->node_count == 0) return FUM_OK;
  for (int k = 0; k < 3; k++) {
    middle[k] = (double)(0.5F * (root->upper[k] + root->lower[k]));
    radius = hypot(radius, 0.5 * ((double)root->upper[k] - (double)root->lower[k]));
  }
  view.middle = to_floats(middle);
  if (!view.is_parallel) {
    for (int k = 0; k < 3; k++)
      view.to_middle[k] = middle[k] - light[k];
    const double distance = sqrt(dot(view.to_middle, view.to_middle));
    view.is_parallel = distance > far_away * radius;
    for (int k = 0; k < 3 && distance > 0.0; k++)
      axis[k] = view.to_middle[k] / distance;
  }
  if (view.is_parallel) memset(view.to_middle, 0, sizeof view.to_middle);
  int32_t status = fum_alloc(context, casters->count + FUM_OCTREE_PAD, sizeof *view.sigmas, what, &view.sigmas);
  if (status == FUM_OK) status = fum_alloc(context, casters->count, sizeof *view.widest, what, &view.widest);
  if (status != FUM_OK) {
    fum_sweep_view_free(context, &view);
    return status;
  }
  *out_is_clear = measure(context, medium, radius, &view);
  aim_faces(radius + view.reach_m, axis, &view);
  *out_view = view;
  return FUM_OK;
}

void fum_sweep_view_free(fum_context *context, fum_sweep_view *view) {
  fum_free(context, &view->widest);
  fum_free(context, &view->sigmas);
}
