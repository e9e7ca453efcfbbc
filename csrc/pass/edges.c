/* SPDX-License-Identifier: GPL-3.0-or-later */
#include "pass/edges.h"

#include "pass/places.h"

#include <math.h>
#include <stdlib.h>

/* Depths that differ by less than this share of themselves are those of one surface. */
static const float SMOOTH = 0.01F;

/* Does depth bend at the pixel? Slopes are those of one surface. */
static bool is_edge(const fum_view *view, const float *depths, int32_t x, int32_t y) {
  const int64_t pixel = (int64_t)y * view->width + x;
  const float here = depths[pixel];
  int64_t steps[FUM_STEPS];
  fum_steps_around(view, x, y, steps);
  for (int k = 0; k < FUM_STEPS; k++) {
    if (fabsf(depths[pixel - steps[k]] - 2.0F * here + depths[pixel + steps[k]]) > SMOOTH * here) return true;
  }
  return false;
}

static int compare(const void *a, const void *b) {
  const float x = *(const float *)a, y = *(const float *)b;
  return (x > y) - (x < y);
}

static float mean(const float *values, int count) {
  float sum = 0.0F;
  for (int i = 0; i < count; i++)
    sum += values[i];
  return sum / (float)count;
}

/* Depths in a pixel fall into two groups, divided where they are farthest apart. */
static void look_closely(const fum_solids *solids, const fum_view *view, int64_t pixel, const fum_solid_view *out) {
  const double x = (double)(pixel % view->width), y = (double)(pixel / view->width);
  float depths[FUM_PLACES];
  for (int i = 0; i < FUM_PLACES; i++) {
    double place[2];
    fum_place_in_pixel(i, place);
    depths[i] = fum_look(solids, view, x + place[0], y + place[1]).depth;
  }
  qsort(depths, FUM_PLACES, sizeof *depths, compare);
  int near = 1;
  for (int i = 2; i < FUM_PLACES; i++) {
    if (depths[i] - depths[i - 1] > depths[near] - depths[near - 1]) near = i;
  }
  if (depths[near] - depths[near - 1] < SMOOTH * depths[near]) near = FUM_PLACES;
  out->depths[pixel] = mean(depths, near);
  out->behind[pixel] = near < FUM_PLACES ? mean(depths + near, FUM_PLACES - near) : out->depths[pixel];
  out->shares[pixel] = (float)near / (float)FUM_PLACES;
  if (near < FUM_PLACES) out->between[pixel] = 0.5F * (depths[near - 1] + depths[near]);
}

/* Finds the edges before anything is changed: they are found by neighbours. */
static int32_t find_edges(fum_context *context, const fum_solids *solids, const fum_view *view, fum_solid_view *out) {
  const int64_t pixels = (int64_t)view->width * view->height;
  uint32_t *edges = NULL;
  int64_t count = 0;
  int32_t status = fum_alloc(context, pixels, sizeof *edges, "edges of solids", &edges);
  for (int64_t i = 0; i < pixels && status == FUM_OK; i++) {
    if (is_edge(view, out->depths, (int32_t)(i % view->width), (int32_t)(i / view->width)))
      edges[count++] = (uint32_t)i;
  }
  if (status != FUM_OK || count == 0) goto done;
  status = fum_alloc(context, pixels, sizeof *out->behind, "edges of solids", &out->behind);
  if (status == FUM_OK) status = fum_alloc(context, pixels, sizeof *out->shares, "edges of solids", &out->shares);
  if (status == FUM_OK) status = fum_alloc(context, pixels, sizeof *out->between, "edges of solids", &out->between);
  if (status != FUM_OK) goto done;
  for (int64_t i = 0; i < pixels; i++) {
    out->behind[i] = out->depths[i];
    out->shares[i] = 1.0F;
    out->between[i] = INFINITY;
  }
#pragma omp parallel for num_threads(fum_thread_count(context)) schedule(dynamic, 256)
  for (int64_t n = 0; n < count; n++) {
    if (fum_progress_in_loop(context, n, 1 << 10)) continue;
    look_closely(solids, view, edges[n], out);
  }
  status = fum_progress_report(context, FUM_STAGE_PASSES, 0.0F, "Finding edges of solids");
done:
  fum_free(context, &edges);
  return status;
}

int32_t fum_solid_view_find(fum_context *context, const fum_solids *solids, const fum_view *view,
                            fum_solid_view *out_solid_view) {
  fum_solid_view found = {0};
  if (!fum_solids_hide_from_camera(solids)) return FUM_OK;
  int32_t status =
      fum_alloc(context, (int64_t)view->width * view->height, sizeof(float), "depth of solids", &found.depths);
  if (status != FUM_OK) return status;
#pragma omp parallel for num_threads(fum_thread_count(context)) schedule(dynamic, 8)
  for (int32_t y = 0; y < view->height; y++) {
    if (fum_progress_in_loop(context, y, 8)) continue;
    for (int32_t x = 0; x < view->width; x++)
      found.depths[(int64_t)y * view->width + x] = fum_look(solids, view, x + 0.5, y + 0.5).depth;
  }
  status = fum_progress_report(context, FUM_STAGE_PASSES, 0.0F, "Finding solids");
  if (status == FUM_OK) status = find_edges(context, solids, view, &found);
  if (status == FUM_OK) {
    *out_solid_view = found;
  } else {
    fum_solid_view_free(context, &found);
  }
  return status;
}

void fum_solid_view_free(fum_context *context, fum_solid_view *solid_view) {
  fum_free(context, &solid_view->depths);
  fum_free(context, &solid_view->behind);
  fum_free(context, &solid_view->shares);
  fum_free(context, &solid_view->between);
}
