/* SPDX-License-Identifier: GPL-3.0-or-later */
#include "pass/surfaces.h"

#include "pass/places.h"

#include <math.h>

/* A ray to a light must not meet the surface that it starts on: it starts this share of the distance to the camera in
 * front of it. */
static const float LIFT = 3e-5F;

/* What a ray sees. */
typedef struct seen {
  float position[3], normal[3], depth;
  int32_t mesh; /* -1: no solid */
} seen;

static seen look(const fum_solids *solids, const fum_view *view, double x, double y) {
  const fum_sight sight = fum_look(solids, view, x, y);
  const double *d = sight.direction;
  const float t = sight.depth, n[3] = {sight.solid.normal.x, sight.solid.normal.y, sight.solid.normal.z};
  const float smooth[3] = {sight.solid.smooth.x, sight.solid.smooth.y, sight.solid.smooth.z};
  seen s = {.depth = t, .mesh = -1};
  if (!(t < (float)view->clip_end) || (n[0] == 0.0F && n[1] == 0.0F && n[2] == 0.0F)) return s;
  const float lift = LIFT * t * fum_length((fum_vec3){(float)d[0], (float)d[1], (float)d[2]});
  s.mesh = sight.solid.mesh;
  for (int axis = 0; axis < 3; axis++) {
    s.position[axis] = (float)(sight.start[axis] + d[axis] * (double)t) + lift * n[axis];
    s.normal[axis] = smooth[axis];
  }
  return s;
}

static int32_t keep_solid(fum_context *context, int64_t count, const seen *sights, const uint32_t *pixels,
                          int32_t per_pixel, fum_surfaces *out) {
  const char *what = "surfaces of solids";
  fum_surfaces s = {0};
  for (int64_t i = 0; i < count; i++)
    s.count += sights[i].mesh >= 0;
  int32_t status = fum_alloc(context, s.count, 3 * sizeof *s.positions, what, &s.positions);
  if (status == FUM_OK) status = fum_alloc(context, s.count, 3 * sizeof *s.normals, what, &s.normals);
  if (status == FUM_OK) status = fum_alloc(context, s.count, sizeof *s.depths, what, &s.depths);
  if (status == FUM_OK) status = fum_alloc(context, s.count, sizeof *s.meshes, what, &s.meshes);
  if (status == FUM_OK) status = fum_alloc(context, s.count, sizeof *s.pixels, what, &s.pixels);
  if (status != FUM_OK) {
    fum_surfaces_free(context, &s);
    return status;
  }
  int64_t n = 0;
  for (int64_t i = 0; i < count; i++) {
    if (sights[i].mesh < 0) continue;
    for (int axis = 0; axis < 3; axis++) {
      s.positions[3 * n + axis] = sights[i].position[axis];
      s.normals[3 * n + axis] = sights[i].normal[axis];
    }
    s.depths[n] = sights[i].depth;
    s.meshes[n] = sights[i].mesh;
    s.pixels[n++] = pixels[i / per_pixel];
  }
  *out = s;
  return FUM_OK;
}

int32_t fum_surfaces_find(fum_context *context, const fum_solids *solids, const fum_view *view, int64_t pixel_count,
                          const uint32_t *pixels, bool is_middle, fum_surfaces *out_surfaces) {
  const int32_t per_pixel = is_middle ? 1 : FUM_PLACES;
  const int64_t count = pixel_count * per_pixel;
  seen *sights = NULL;
  int32_t status = fum_alloc(context, count, sizeof *sights, "surfaces of solids", &sights);
  if (status != FUM_OK) return status;
#pragma omp parallel for num_threads(fum_thread_count(context)) schedule(dynamic, 1024)
  for (int64_t i = 0; i < count; i++) {
    if (fum_progress_in_loop(context, i, 1 << 12)) continue;
    const uint32_t pixel = pixels[i / per_pixel], width = (uint32_t)view->width;
    double place[2] = {0.5, 0.5};
    if (!is_middle) fum_place_in_pixel((int32_t)(i % per_pixel), place);
    sights[i] = look(solids, view, pixel % width + place[0], pixel / width + place[1]);
  }
  status = fum_progress_report(context, FUM_STAGE_PASSES, 0.1F, "Finding solids");
  if (status == FUM_OK) status = keep_solid(context, count, sights, pixels, per_pixel, out_surfaces);
  fum_free(context, &sights);
  return status;
}

void fum_surfaces_free(fum_context *context, fum_surfaces *surfaces) {
  fum_free(context, &surfaces->positions);
  fum_free(context, &surfaces->normals);
  fum_free(context, &surfaces->depths);
  fum_free(context, &surfaces->meshes);
  fum_free(context, &surfaces->pixels);
}
