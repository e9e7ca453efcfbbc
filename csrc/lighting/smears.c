/* SPDX-License-Identifier: GPL-3.0-or-later */
#include "lighting/smears.h"

#include "scene/aperture.h"

bool fum_camera_blurs(const fum_camera *camera) {
  return camera->shutter_open < camera->shutter_close || camera->aperture_radius > 0.0;
}

/* From local space to where a point appears to the camera as it stands now, when it is looked at `frames` later. What a
 * window that has moved or grown does to the picture is done to the points' places across the view. */
static int32_t find_sight(fum_context *context, const fum_octree *octree, const fum_camera *camera, const fum_view *now,
                          double frames, double out[16]) {
  fum_view then;
  const int32_t status = fum_view_init_at(context, camera, frames, &then);
  if (status != FUM_OK) return status;
  fum_view_place(&then, octree->origin);
  const double *m = then.camera_from_local;
  for (int i = 0; i < 16; i++)
    out[i] = m[i];
  for (int axis = 0; axis < 2; axis++) {
    const double *w = now->window + 2 * axis, *v = then.window + 2 * axis;
    const double scale = (w[1] - w[0]) / (v[1] - v[0]), offset = w[0] - scale * v[0];
    for (int column = 0; column < 4; column++)
      out[4 * axis + column] = scale * m[4 * axis + column];
    if (now->type != FUM_CAMERA_PERSPECTIVE) {
      out[4 * axis + 3] += offset;
      continue;
    }
    for (int column = 0; column < 4; column++)
      out[4 * axis + column] -= offset * m[8 + column]; /* the depth is -z */
  }
  return FUM_OK;
}

/* What all particles are seen through. */
typedef struct lens {
  const fum_scene *scene;
  const fum_octree *octree;
  const fum_view *view;
  double times[2];         /* of the shutter's opening and closing, frames from now */
  double sights[2][16];    /* find_sight then */
  double focus, per_depth; /* of the confusion */
} lens;

static void find_smear(const lens *l, int64_t i, fum_smear *out) {
  const uint32_t index = l->octree->indices[i];
  const fum_particles *set = fum_scene_particles_of(l->scene, index);
  const float *velocity = set->velocities != NULL ? set->velocities + 3 * (index - set->offset) : (float[3]){0};
  const double at[3] = {(double)l->octree->x[i], (double)l->octree->y[i], (double)l->octree->z[i]};
  double ends[2][3];
  for (int end = 0; end < 2; end++) {
    double moved[3];
    for (int axis = 0; axis < 3; axis++)
      moved[axis] = at[axis] + l->times[end] * (double)velocity[axis];
    fum_transform_point(l->sights[end], moved, ends[end]);
  }
  for (int axis = 0; axis < 3; axis++) {
    out->center[axis] = (float)(0.5 * (ends[0][axis] + ends[1][axis]));
    out->path[axis] = (float)(ends[1][axis] - ends[0][axis]);
  }
  out->confusion = (float)(l->per_depth * (-(double)out->center[2] - l->focus));
}

/* As in fum_smears.worst; 0 of what isn't in front of the camera. */
static double find_offset(const lens *l, const fum_smears *smears, int64_t i, double pixel) {
  const fum_smear *smear = &smears->items[i];
  const double at[3] = {(double)l->octree->x[i], (double)l->octree->y[i], (double)l->octree->z[i]};
  const double depth = -(double)smear->center[2], sigma = 1.0 / (double)l->octree->inverse_sigmas[i];
  const double nearest = depth + 0.5 * fabs((double)smear->path[2]) + 4.0 * sigma;
  if (nearest < l->view->clip_start || depth > l->view->clip_end + nearest - depth) return 0.0;
  double here[3], squared = 0.0;
  fum_transform_point(l->view->camera_from_local, at, here);
  for (int axis = 0; axis < 3; axis++) {
    const double offset = (double)smear->center[axis] - here[axis], path = (double)smear->path[axis];
    squared += offset * offset + path * path / 12.0;
  }
  const double defocus = smears->aperture_deviation * (double)smear->confusion;
  const double width = fmax(sigma, pixel * (l->view->type == FUM_CAMERA_PERSPECTIVE ? depth : 1.0));
  return sqrt(squared + defocus * defocus) / width;
}

int32_t fum_smears_find(const fum_scene *scene, const fum_octree *octree, const fum_camera *camera,
                        const fum_view *view, fum_smears *out_smears) {
  fum_context *context = scene->context;
  const double *w = view->window;
  const double pixel = fmax((w[1] - w[0]) / (double)view->width, (w[3] - w[2]) / (double)view->height);
  const bool moves = camera->shutter_open < camera->shutter_close;
  fum_aperture aperture;
  fum_aperture_find(camera, &aperture);
  lens l = {.scene = scene,
            .octree = octree,
            .view = view,
            .times = {moves ? camera->shutter_open : 0.0, moves ? camera->shutter_close : 0.0},
            .focus = camera->focus_distance,
            .per_depth = camera->aperture_radius / camera->focus_distance};
  fum_smears smears = {
      .confusion_per_depth = l.per_depth, .extent = aperture.extent, .aperture_deviation = sqrt(aperture.variance)};
  double worst = 0.0;
  int32_t status = FUM_OK;
  for (int end = 0; end < 2 && status == FUM_OK; end++)
    status = find_sight(context, octree, camera, view, l.times[end], l.sights[end]);
  if (status == FUM_OK) status = fum_alloc(context, octree->count, sizeof *smears.items, "motion", &smears.items);
  if (status != FUM_OK) return status;
#pragma omp parallel for num_threads(fum_thread_count(context)) schedule(static) reduction(max : worst)
  for (int64_t i = 0; i < octree->count; i++) {
    find_smear(&l, i, &smears.items[i]);
    worst = fum_most(worst, find_offset(&l, &smears, i, pixel));
  }
  smears.worst = worst;
  *out_smears = smears;
  return FUM_OK;
}

void fum_smears_free(fum_context *context, fum_smears *smears) {
  fum_free(context, &smears->items);
}
