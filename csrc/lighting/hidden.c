/* SPDX-License-Identifier: GPL-3.0-or-later */
#include "lighting/hidden.h"

#include "lighting/solver.h"
#include "octree/bunch.h"
#include "octree/sums.h"

static int32_t coarse(int32_t samples) {
  return (samples + FUM_HIDDEN_STEP - 1) / FUM_HIDDEN_STEP;
}

static int64_t lay_values(const fum_hidden *hidden) {
  int64_t count = 0;
  for (int32_t f = 0; f < hidden->face_count; f += FUM_HIDDEN_STEP) {
    hidden->firsts[f] = count;
    count += (int64_t)coarse(hidden->faces[f].columns) * coarse(hidden->faces[f].rows);
  }
  return count;
}

static void place_points(const fum_view *view, const fum_slabs *slabs, const fum_hidden *hidden, float *positions) {
  for (int32_t f = 0; f < hidden->face_count; f += FUM_HIDDEN_STEP) {
    const fum_lattice_face *grid = &hidden->faces[f];
    const int32_t columns = coarse(grid->columns), rows = coarse(grid->rows);
    for (int32_t r = 0; r < rows; r++) {
      for (int32_t c = 0; c < columns; c++) {
        double local[3];
        fum_view_point(view, (double)(grid->origin[0] + grid->spacing[0] * (float)(c * FUM_HIDDEN_STEP)),
                       (double)(grid->origin[1] + grid->spacing[1] * (float)(r * FUM_HIDDEN_STEP)),
                       (double)slabs->faces[f].range, local);
        float *p = positions + 3 * (hidden->firsts[f] + (int64_t)r * columns + c);
        for (int axis = 0; axis < 3; axis++)
          p[axis] = (float)local[axis];
      }
    }
  }
}

/* The camera taken for a light. */
static fum_emitter camera_of(const fum_view *view) {
  const double *m = view->local_from_camera;
  return (fum_emitter){.is_directional = view->type == FUM_CAMERA_ORTHOGRAPHIC,
                       .position = {(float)m[3], (float)m[7], (float)m[11]},
                       .direction = {(float)m[2], (float)m[6], (float)m[10]}};
}

static int32_t solve(fum_context *context, const fum_octree *octree, const fum_view *view, const fum_octree *points,
                     float limit, float *out_depths) {
  const float rough = 0.01F; /* nobody sees these depths: they are compared with the limit */
  fum_solver solver = {.wanted = FUM_SOLVER_AUTOMATIC, .tolerance = rough, .is_careful = true};
  fum_medium medium = {.octree = octree, .sigma_scale = 1.0F, .depth_scale = 1.0F, .depth_limit = limit + 1.0F};
  fum_receivers receivers = {.octree = points};
  float *depths = NULL;
  uint8_t *is_lit = NULL;
  int32_t status = fum_medium_begin(context, rough, &medium);
  if (status == FUM_OK) status = fum_alloc(context, points->count, sizeof *depths, "hidden samples", &depths);
  if (status == FUM_OK) status = fum_alloc(context, points->count, sizeof *is_lit, "hidden samples", &is_lit);
  if (status != FUM_OK) goto done;
  for (int64_t i = 0; i < points->count; i++)
    is_lit[i] = 1;
  const fum_emitter camera = camera_of(view);
  status = fum_solver_solve(context, &solver, &medium, &receivers, &camera, is_lit, (float[2]){0.0F, 0.0F}, depths);
  if (status != FUM_OK) goto done;
  for (int64_t i = 0; i < points->count; i++)
    out_depths[points->indices[i]] = depths[i];
done:
  fum_free(context, &is_lit);
  fum_free(context, &depths);
  fum_receivers_free(context, &receivers);
  fum_medium_end(context, &medium);
  return status;
}

int32_t fum_hidden_find(fum_context *context, const fum_octree *octree, const fum_view *view, const fum_slabs *slabs,
                        const fum_lattice_face *faces, float tolerance, fum_hidden *out_hidden) {
  /* What is left of the light behind this depth is a fiftieth of the tolerance. */
  fum_hidden hidden = {.face_count = slabs->count + 1, .faces = faces, .limit = -logf(0.02F * tolerance)};
  const fum_bunch_options rough = {.sigma_scale = 1.0F, .side = 4.0F, .most_left = 0.5F};
  float *positions = NULL;
  fum_octree *points = NULL, *casters = NULL;
  *out_hidden = hidden;
  /* Smoke before the clip range hides nothing, but lies between the samples and the camera. */
  if (slabs->has_holes || (double)slabs->faces[0].range <= view->clip_start * 1.0001) return FUM_OK;
  int32_t status = fum_alloc(context, hidden.face_count, sizeof *hidden.firsts, "hidden samples", &hidden.firsts);
  if (status != FUM_OK) goto done;
  const int64_t count = lay_values(&hidden);
  status = fum_alloc(context, count, sizeof *hidden.depths, "hidden samples", &hidden.depths);
  if (status == FUM_OK) status = fum_alloc(context, count, 3 * sizeof *positions, "hidden samples", &positions);
  if (status != FUM_OK) goto done;
  place_points(view, slabs, &hidden, positions);
  status = fum_octree_build_points(context, octree->origin, count, positions, FUM_GROUP_SIZE, &points);
  if (status == FUM_OK) status = fum_octree_bunch(context, octree, &rough, &casters);
  if (status == FUM_OK && casters != NULL) status = fum_octree_sum(context, casters);
  if (status == FUM_OK)
    status = solve(context, casters != NULL ? casters : octree, view, points, hidden.limit, hidden.depths);
  if (status != FUM_OK) goto done;
  *out_hidden = hidden;
  hidden = (fum_hidden){0};
done:
  fum_octree_destroy(context, casters);
  fum_octree_destroy(context, points);
  fum_free(context, &positions);
  fum_hidden_free(context, &hidden);
  return status;
}

void fum_hidden_free(fum_context *context, fum_hidden *hidden) {
  fum_free(context, &hidden->firsts);
  fum_free(context, &hidden->depths);
}

/* The face that a face's samples are judged by: one coarse face further to the front, so that what interpolation takes
 * from a hidden sample is hidden as well. Negative: there is none. */
static int32_t judging_face(const fum_hidden *hidden, int32_t face) {
  const int32_t before = face / FUM_HIDDEN_STEP * FUM_HIDDEN_STEP - FUM_HIDDEN_STEP;
  return hidden->depths == NULL || before < 0 || hidden->faces[before].columns == 0 ? -1 : before;
}

/* The first of four coarse samples around a place along an axis of the window. */
static int32_t first_around(const fum_lattice_face *grid, int axis, float place) {
  return (int32_t)floorf((place - grid->origin[axis]) / (grid->spacing[axis] * FUM_HIDDEN_STEP)) - 1;
}

bool fum_hidden_ask(const fum_hidden *hidden, int32_t face, float u, float v) {
  const int32_t before = judging_face(hidden, face);
  if (before < 0) return false;
  const fum_lattice_face *grid = &hidden->faces[before];
  const int32_t columns = coarse(grid->columns), rows = coarse(grid->rows);
  const int32_t c0 = first_around(grid, 0, u), r0 = first_around(grid, 1, v);
  for (int32_t r = r0; r < r0 + 4; r++) {
    for (int32_t c = c0; c < c0 + 4; c++) {
      if (r < 0 || c < 0 || r >= rows || c >= columns) return false;
      if (hidden->depths[hidden->firsts[before] + (int64_t)r * columns + c] < hidden->limit) return false;
    }
  }
  return true;
}

bool fum_hidden_touches(const fum_hidden *hidden, int32_t face, const float lower[2], const float upper[2]) {
  const int32_t before = judging_face(hidden, face);
  if (before < 0) return false;
  const fum_lattice_face *grid = &hidden->faces[before];
  const int32_t counts[2] = {coarse(grid->columns), coarse(grid->rows)};
  int32_t first[2], end[2];
  for (int axis = 0; axis < 2; axis++) {
    const int32_t low = first_around(grid, axis, lower[axis]), high = first_around(grid, axis, upper[axis]) + 4;
    first[axis] = low > 0 ? low : 0;
    end[axis] = high < counts[axis] ? high : counts[axis];
  }
  for (int32_t r = first[1]; r < end[1]; r++) {
    for (int32_t c = first[0]; c < end[0]; c++) {
      if (hidden->depths[hidden->firsts[before] + (int64_t)r * counts[0] + c] >= hidden->limit) return true;
    }
  }
  return false;
}

/* The value of the coarse sample nearest to (u, v) on a coarse face that has any. */
static double nearest_depth(const fum_hidden *hidden, int32_t face, const double window[2]) {
  const fum_lattice_face *grid = &hidden->faces[face];
  const int32_t counts[2] = {coarse(grid->columns), coarse(grid->rows)};
  int32_t at[2];
  for (int axis = 0; axis < 2; axis++) {
    const double step = (double)grid->spacing[axis] * FUM_HIDDEN_STEP;
    const double place = (window[axis] - (double)grid->origin[axis]) / step + 0.5;
    at[axis] = (int32_t)fmin(fmax(place, 0.0), (double)(counts[axis] - 1));
  }
  return (double)hidden->depths[hidden->firsts[face] + (int64_t)at[1] * counts[0] + at[0]];
}

double fum_hidden_depth(const fum_hidden *hidden, const fum_slabs *slabs, const double window[2], double range) {
  const int32_t first = fum_slab_at(slabs, range) / FUM_HIDDEN_STEP * FUM_HIDDEN_STEP, next = first + FUM_HIDDEN_STEP;
  int32_t before = first;
  while (before >= 0 && hidden->faces[before].columns == 0)
    before -= FUM_HIDDEN_STEP;
  const double front = before >= 0 ? nearest_depth(hidden, before, window) : 0.0;
  if (next >= hidden->face_count || hidden->faces[next].columns == 0) return front;
  const double begin = (double)slabs->faces[first].range, end = (double)slabs->faces[next].range;
  const double share = fmin(1.0, fmax(0.0, (range - begin) / (end - begin)));
  return front + (nearest_depth(hidden, next, window) - front) * share;
}
