/* SPDX-License-Identifier: GPL-3.0-or-later */
#include "pass/surfaces.h"

#include "pass/places.h"

#include <math.h>

/* A ray to a light must not meet the surface that it starts on: it starts this share of the distance to the camera in
 * front of it. */
static const float LIFT = 3e-5F;

/* What a ray sees; the normal is 0 where there is nothing. */
typedef struct sight {
  float position[3], normal[3];
} sight;

static sight look(const fum_solids *solids, const fum_view *view, double x, double y) {
  double start[3], direction[3];
  fum_vec3 normal;
  sight s = {0};
  fum_view_ray(view, x, y, start, direction);
  const fum_vec3 from = {(float)start[0], (float)start[1], (float)start[2]};
  const fum_vec3 along = {(float)direction[0], (float)direction[1], (float)direction[2]};
  const float far = (float)view->clip_end;
  const float t = fum_solids_see(solids, from, along, (float)view->clip_start, far, &normal);
  if (!(t < far)) return s;
  const float lift = LIFT * t * fum_length(along), n[3] = {normal.x, normal.y, normal.z};
  for (int axis = 0; axis < 3; axis++) {
    s.position[axis] = (float)(start[axis] + direction[axis] * (double)t) + lift * n[axis];
    s.normal[axis] = n[axis];
  }
  return s;
}

static bool is_solid(const sight *s) {
  return s->normal[0] != 0.0F || s->normal[1] != 0.0F || s->normal[2] != 0.0F;
}

static int32_t keep_solid(fum_context *context, int64_t count, const sight *sights, const uint32_t *pixels,
                          int32_t per_pixel, fum_surfaces *out) {
  const char *what = "surfaces of solids";
  fum_surfaces s = {0};
  for (int64_t i = 0; i < count; i++)
    s.count += is_solid(&sights[i]);
  int32_t status = fum_alloc(context, s.count, 3 * sizeof *s.positions, what, &s.positions);
  if (status == FUM_OK) status = fum_alloc(context, s.count, 3 * sizeof *s.normals, what, &s.normals);
  if (status == FUM_OK) status = fum_alloc(context, s.count, sizeof *s.pixels, what, &s.pixels);
  if (status != FUM_OK) {
    fum_surfaces_free(context, &s);
    return status;
  }
  int64_t n = 0;
  for (int64_t i = 0; i < count; i++) {
    if (!is_solid(&sights[i])) continue;
    for (int axis = 0; axis < 3; axis++) {
      s.positions[3 * n + axis] = sights[i].position[axis];
      s.normals[3 * n + axis] = sights[i].normal[axis];
    }
    s.pixels[n++] = pixels[i / per_pixel];
  }
  *out = s;
  return FUM_OK;
}

int32_t fum_surfaces_find(fum_context *context, const fum_solids *solids, const fum_view *view, int64_t pixel_count,
                          const uint32_t *pixels, bool is_middle, fum_surfaces *out_surfaces) {
  const int32_t per_pixel = is_middle ? 1 : FUM_PLACES;
  const int64_t count = pixel_count * per_pixel;
  sight *sights = NULL;
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
  fum_free(context, &surfaces->pixels);
}
