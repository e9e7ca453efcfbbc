/* SPDX-License-Identifier: GPL-3.0-or-later */
#include "lighting/sweep_near.h"

#include "lighting/exact.h"
#include "octree/pick.h"

/* A face of directions is laid out in tiles, each of them a group of receivers, and has MARGIN lines on both sides of
 * its window for the cubic that is put through four of them. */
enum { FACES = 6, TILE = 8, TILE_SIZE = TILE * TILE, MARGIN = 2 };

static const char WHAT[] = "a light's vicinity";

static fum_vec3 way_to(const fum_sweep_task *task, int64_t i) {
  const fum_octree *points = task->receivers->octree;
  return fum_sub((fum_vec3){points->x[i], points->y[i], points->z[i]}, task->emitter->position);
}

/* Marks the lit receivers within `reach`; counts them and those beyond. */
static void mark_within(fum_context *context, const fum_sweep_task *task, float reach, uint8_t *is_within,
                        int64_t counts[2]) {
  int64_t within = 0, beyond = 0;
#pragma omp parallel for num_threads(fum_thread_count(context)) reduction(+ : within, beyond)
  for (int64_t i = 0; i < task->receivers->octree->count; i++) {
    const bool is_lit = task->is_lit[i] != 0, is_near = !(fum_length(way_to(task, i)) > reach);
    is_within[i] = is_lit && is_near;
    within += is_lit && is_near;
    beyond += is_lit && !is_near;
  }
  counts[0] = within;
  counts[1] = beyond;
}

/* Directions along a side that are two fifths of the smallest sigma apart, in whole tiles. */
static double side_for(double smallest_sigma) {
  const double steps = ceil(2.0 / (smallest_sigma * 0.4)) + 2.0 * MARGIN;
  return TILE * ceil(steps / TILE);
}

int32_t fum_sweep_near_plan(fum_context *context, const fum_sweep_task *task, const fum_sweep_view *view,
                            fum_sweep_near *out_near) {
  const double read_us = 0.05, most_share = 0.5, most_side = 4096.0;
  const fum_sweep_vicinity *v = &view->vicinity;
  int64_t counts[2];
  *out_near = (fum_sweep_near){.is_worthwhile = true};
  if (v->count == 0) return FUM_OK;
  out_near->is_worthwhile = (double)v->count <= most_share * (double)fum_medium_casters(task->medium)->count;
  const int32_t status = fum_alloc(context, task->receivers->octree->count, 1, WHAT, &out_near->is_exact);
  if (status != FUM_OK) return status;
  mark_within(context, task, (float)v->reach, out_near->is_exact, counts);
  const double side = side_for(v->smallest), directions = FACES * side * side;
  if (side <= most_side && directions < 0.5 * (double)counts[1]) {
    out_near->side = (int32_t)side;
    out_near->cost_us = fum_exact_predict_us(v->count, counts[0] + (int64_t)directions) + read_us * (double)counts[1];
  } else { /* there are hardly more receivers than directions */
    mark_within(context, task, INFINITY, out_near->is_exact, counts);
    out_near->cost_us = fum_exact_predict_us(v->count, counts[0]);
  }
  return FUM_OK;
}

void fum_sweep_near_free(fum_context *context, fum_sweep_near *near) {
  fum_free(context, &near->is_exact);
}

/* Directions from the light, as points that are behind all casters of its vicinity, and their optical depths. */
typedef struct directions {
  int32_t side;
  float per_tangent; /* grid lines */
  fum_octree *points;
  fum_receivers receivers;
  uint8_t *is_lit;
  float *depths; /* in the points' order */
} directions;

/* Place of a grid point among the depths. */
static int64_t place_of(int32_t side, int64_t face, int32_t column, int32_t row) {
  const int64_t tiles = side / TILE, tile = (face * tiles + row / TILE) * tiles + column / TILE;
  return tile * TILE_SIZE + (row % TILE) * TILE + column % TILE;
}

/* Face 2 k looks along axis k and face 2 k + 1 against it, its columns and rows run along the next axes. */
static void aim(const directions *d, fum_vec3 light, float distance, int64_t face, int32_t column, int32_t row) {
  const int axis = (int)(face / 2);
  float way[3];
  way[axis] = face % 2 == 0 ? 1.0F : -1.0F;
  way[(axis + 1) % 3] = (float)(column - MARGIN + 1) / d->per_tangent - 1.0F;
  way[(axis + 2) % 3] = (float)(row - MARGIN + 1) / d->per_tangent - 1.0F;
  const float scale = distance / sqrtf(way[0] * way[0] + way[1] * way[1] + way[2] * way[2]);
  const int64_t at = place_of(d->side, face, column, row);
  d->points->x[at] = light.x + scale * way[0];
  d->points->y[at] = light.y + scale * way[1];
  d->points->z[at] = light.z + scale * way[2];
  d->is_lit[at] = 1;
}

static int32_t lay_directions(fum_context *context, fum_vec3 light, float distance, directions *d) {
  const int64_t count = (int64_t)FACES * d->side * d->side, groups = count / TILE_SIZE;
  const double origin[3] = {0.0, 0.0, 0.0};
  int32_t status = fum_octree_create(context, origin, count, false, &d->points);
  if (status == FUM_OK) status = fum_alloc(context, groups + 1, sizeof(uint32_t), WHAT, &d->receivers.group_begins);
  if (status == FUM_OK) status = fum_alloc(context, count, sizeof *d->is_lit, WHAT, &d->is_lit);
  if (status == FUM_OK) status = fum_alloc(context, count, sizeof *d->depths, WHAT, &d->depths);
  if (status != FUM_OK) return status;
  d->receivers.octree = d->points;
  d->receivers.group_count = groups;
  for (int64_t k = 0; k <= groups; k++)
    d->receivers.group_begins[k] = (uint32_t)(k * TILE_SIZE);
  for (int64_t face = 0; face < FACES; face++) {
    for (int32_t row = 0; row < d->side; row++) {
      for (int32_t column = 0; column < d->side; column++)
        aim(d, light, distance, face, column, row);
    }
  }
  return FUM_OK;
}

static void free_directions(fum_context *context, directions *d) {
  fum_octree_destroy(context, d->points);
  fum_free(context, &d->receivers.group_begins);
  fum_free(context, &d->is_lit);
  fum_free(context, &d->depths);
}

/* Of the cubic through four values at -1, 0, 1 and 2. */
static void find_weights(float t, float weights[4]) {
  const float s = 1.0F - t, third = 0.33333333F;
  weights[0] = -0.5F * third * t * s * (1.0F + s);
  weights[1] = 0.5F * (1.0F + t) * s * (1.0F + s);
  weights[2] = 0.5F * t * (1.0F + t) * (1.0F + s);
  weights[3] = -0.5F * third * t * s * (1.0F + t);
}

/* Where a tangent from -1 to 1 is among the grid lines. Returns the first of four. */
static int32_t locate(const directions *d, float tangent, float weights[4]) {
  const float at = (tangent + 1.0F) * d->per_tangent;
  const int32_t most = d->side - 2 * MARGIN, line = (int32_t)at < most ? (int32_t)at : most;
  find_weights(at - (float)line, weights);
  return line + MARGIN - 2;
}

static float read_depth(const directions *d, fum_vec3 way) {
  const float w[3] = {way.x, way.y, way.z}, a[3] = {fabsf(way.x), fabsf(way.y), fabsf(way.z)};
  const int axis = a[0] >= a[1] && a[0] >= a[2] ? 0 : a[1] >= a[2] ? 1 : 2;
  const float per_depth = 1.0F / a[axis];
  float across[4], up[4], depth = 0.0F;
  const int32_t column = locate(d, w[(axis + 1) % 3] * per_depth, across);
  const int32_t row = locate(d, w[(axis + 2) % 3] * per_depth, up);
  const int64_t face = 2 * axis + (w[axis] < 0.0F);
  for (int32_t r = 0; r < 4; r++) {
    float sum = 0.0F;
    for (int32_t c = 0; c < 4; c++)
      sum += across[c] * d->depths[place_of(d->side, face, column + c, row + r)];
    depth += up[r] * sum;
  }
  return depth > 0.0F ? depth : 0.0F;
}

/* Depths of the receivers behind the vicinity. */
static int32_t solve_beyond(fum_context *context, const fum_sweep_task *task, const fum_sweep_view *view,
                            const fum_sweep_near *near, fum_medium *medium, const float progress[2], float *depths) {
  directions d = {.side = near->side, .per_tangent = 0.5F * (float)(near->side - 2 * MARGIN)};
  const fum_emitter *light = task->emitter;
  int32_t status = lay_directions(context, light->position, 1.001F * (float)view->vicinity.reach, &d);
  if (status == FUM_OK) status = fum_exact_solve(context, medium, &d.receivers, light, d.is_lit, progress, d.depths);
  if (status != FUM_OK) goto done;
#pragma omp parallel for num_threads(fum_thread_count(context))
  for (int64_t i = 0; i < task->receivers->octree->count; i++) {
    if (task->is_lit[i] && !near->is_exact[i]) depths[i] = read_depth(&d, way_to(task, i));
  }
done:
  free_directions(context, &d);
  return status;
}

/* The casters in the light's vicinity. */
static int32_t pick_near(fum_context *context, const fum_octree *casters, const fum_sweep_view *view,
                         fum_octree **out_picked) {
  uint8_t *is_near = NULL;
  int32_t status = fum_alloc(context, casters->count, sizeof *is_near, WHAT, &is_near);
  for (int64_t i = 0; i < casters->count && status == FUM_OK; i++)
    is_near[i] = casters->optical_depths[i] > 0.0F && !(view->sigmas[i] > 0.0F);
  if (status == FUM_OK) status = fum_octree_pick(context, casters, is_near, out_picked);
  fum_free(context, &is_near);
  return status;
}

int32_t fum_sweep_near_solve(fum_context *context, const fum_sweep_task *task, const fum_sweep_view *view,
                             const fum_sweep_near *near, const float progress[2], float *depths) {
  const float middle = 0.5F * (progress[0] + progress[1]);
  fum_octree *picked = NULL;
  if (view->vicinity.count == 0) return FUM_OK;
  int32_t status = pick_near(context, fum_medium_casters(task->medium), view, &picked);
  if (status != FUM_OK) return status;
  const fum_medium *all = task->medium;
  fum_medium medium = {.octree = picked, /* merged already */
                       .sigma_scale = all->sigma_scale,
                       .depth_scale = all->depth_scale,
                       .depth_limit = all->depth_limit,
                       .error = all->error};
  if (near->side > 0)
    status = solve_beyond(context, task, view, near, &medium, (float[2]){progress[0], middle}, depths);
  if (status == FUM_OK)
    status = fum_exact_solve(context, &medium, task->receivers, task->emitter, near->is_exact,
                             (float[2]){middle, progress[1]}, depths);
  fum_medium_end(context, &medium);
  fum_octree_destroy(context, picked);
  return status;
}
