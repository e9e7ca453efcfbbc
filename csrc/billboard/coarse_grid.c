/* SPDX-License-Identifier: GPL-3.0-or-later */
#include "billboard/coarse_grid.h"

#include "base/vector.h"

/* Sigmas of most particles, in points of the grid: a Gaussian has little left then that splines don't follow... */
static const double WIDE = 0.9;
/* ...and how many of the particles in view may be narrower. */
static const double NARROW_SHARE = 0.02;
/* The grid's points show how rough the smoke is, but not of particles below this sigma. */
static const double NARROW = 0.8;
/* Points that a grid has at least along the picture's longer side: smaller pictures are drawn in no time. */
static const int32_t LEAST_SIDE = 96;

enum { STEPS = 3 }; /* 2, 4 and 8 pixels */

/* What a sample of the particles is like. */
typedef struct sample {
  int64_t count;         /* in the picture */
  int64_t narrow[STEPS]; /* too narrow for that step */
  int64_t fine;          /* in tiles that are marked already */
} sample;

static void look_at(const fum_tile_job *job, const fum_coarse_grid *grid, int64_t i, sample *s) {
  const fum_octree *octree = job->octree;
  const fum_view *view = job->view;
  const double local[3] = {(double)octree->x[i], (double)octree->y[i], (double)octree->z[i]};
  double c[3], px[2];
  if (!fum_view_project(view, local, px)) return;
  if (px[0] < 0.0 || px[1] < 0.0 || px[0] >= (double)view->width || px[1] >= (double)view->height) return;
  fum_transform_point(view->camera_from_local, local, c);
  const double sigma = 1.0 / (double)octree->inverse_sigmas[i];
  if (-c[2] < view->clip_start - sigma || -c[2] > view->clip_end + sigma) return;
  const double pixel = fum_view_pixel(view) * (view->type == FUM_CAMERA_PERSPECTIVE ? -c[2] : 1.0);
  for (int k = 0; k < STEPS; k++)
    s->narrow[k] += sigma < WIDE * pixel * (double)(2 << k);
  s->fine += grid->fine[(int64_t)((int32_t)px[1] / FUM_TILE) * grid->columns + (int32_t)px[0] / FUM_TILE];
  s->count++;
}

static int32_t choose_step(const fum_tile_job *job, const fum_coarse_grid *grid) {
  const int64_t every = job->octree->count / 50000 + 1;
  const int32_t side = job->view->width > job->view->height ? job->view->width : job->view->height;
  sample s = {0};
  if (side < 2 * LEAST_SIDE) return 1;
  for (int64_t i = 0; i < job->octree->count; i += every)
    look_at(job, grid, i, &s);
  if (s.count == 0 || 2 * s.fine > s.count) return 1;
  for (int k = STEPS - 1; k >= 0; k--) {
    if (side >= (2 << k) * LEAST_SIDE && (double)s.narrow[k] <= NARROW_SHARE * (double)s.count) return 2 << k;
  }
  return 1;
}

/* Is a solid before the end of the smoke? One behind it cuts nothing. Along a ray it is further away than its depth. */
static bool has_solid(const fum_tile_job *job, int32_t column, int32_t row) {
  const fum_view *view = job->view;
  const float end = fum_min((float)view->clip_end, job->slabs->faces[job->slabs->count].range);
  for (int32_t y = row * FUM_TILE; y < (row + 1) * FUM_TILE && y < view->height; y++) {
    for (int32_t x = column * FUM_TILE; x < (column + 1) * FUM_TILE && x < view->width; x++) {
      if (job->solid_depths[(int64_t)y * view->width + x] < end) return true;
    }
  }
  return false;
}

static void mark_solids(fum_context *context, const fum_tile_job *job, const fum_coarse_grid *grid) {
#pragma omp parallel for num_threads(fum_thread_count(context)) schedule(static)
  for (int32_t row = 0; row < grid->rows; row++) {
    for (int32_t column = 0; column < grid->columns; column++)
      grid->fine[row * grid->columns + column] = has_solid(job, column, row);
  }
}

/* Points stand in the middles of squares of step x step pixels. */
static fum_view find_view(const fum_view *whole, int32_t step) {
  fum_view view = *whole;
  int32_t *sides[2] = {&view.width, &view.height};
  for (int axis = 0; axis < 2; axis++) {
    const double *window = whole->window + 2 * axis;
    const double point = (window[1] - window[0]) / (double)*sides[axis] * (double)step;
    *sides[axis] = (*sides[axis] + step - 1) / step + 2 * FUM_COARSE_MARGIN;
    view.window[2 * axis] = window[0] - point * FUM_COARSE_MARGIN;
    view.window[2 * axis + 1] = view.window[2 * axis] + point * (double)*sides[axis];
  }
  return view;
}

int32_t fum_coarse_grid_begin(fum_context *context, const fum_tile_job *job, fum_coarse_grid *out) {
  fum_coarse_grid grid = {.whole = job->view,
                          .columns = (job->view->width + FUM_TILE - 1) / FUM_TILE,
                          .rows = (job->view->height + FUM_TILE - 1) / FUM_TILE};
  const int32_t status = fum_alloc(context, (int64_t)grid.columns * grid.rows, sizeof *grid.fine, "tiles", &grid.fine);
  if (status != FUM_OK) return status;
  if (job->solid_depths != NULL) mark_solids(context, job, &grid);
  grid.step = choose_step(job, &grid);
  grid.view = find_view(job->view, grid.step);
  *out = grid;
  return FUM_OK;
}

void fum_coarse_grid_end(fum_context *context, fum_coarse_grid *grid) {
  fum_free(context, &grid->fine);
}

/* First and last pixel that a splat of the grid's view may touch, with so many points beyond. */
static void find_pixels(const fum_coarse_grid *grid, const fum_splat *splat, int axis, float beyond, float out[2]) {
  const float step = (float)grid->step, margin = (float)FUM_COARSE_MARGIN - 0.5F;
  const float middle = splat->middle_px[axis] - margin, half = splat->half_px[axis] + beyond;
  out[0] = (middle - half) * step - 0.5F;
  out[1] = (middle + half) * step - 0.5F;
}

/* First and last of the picture's tiles, along an axis, that a splat of the grid's view may touch; `beyond`: points of
 * the grid. Empty where it is beside the picture. */
static void find_tiles(const fum_coarse_grid *grid, const fum_splat *splat, int axis, float beyond, int32_t out[2]) {
  const float scale = 1.0F / (float)FUM_TILE;
  float pixels[2];
  find_pixels(grid, splat, axis, beyond, pixels);
  const float first = pixels[0] * scale, last = pixels[1] * scale;
  const int32_t count = axis == 0 ? grid->columns : grid->rows;
  out[0] = first > 0.0F ? (int32_t)fum_min(first, (float)count) : 0;
  out[1] = last < 0.0F ? -1 : last < (float)count ? (int32_t)last : count - 1;
}

static bool is_in_picture(const fum_coarse_grid *grid, const fum_splat *splat) {
  float x[2], y[2];
  find_pixels(grid, splat, 0, 0.0F, x);
  find_pixels(grid, splat, 1, 0.0F, y);
  return x[1] >= 0.0F && y[1] >= 0.0F && x[0] <= (float)(grid->whole->width - 1) &&
         y[0] <= (float)(grid->whole->height - 1);
}

static void mark_splat(const fum_coarse_grid *grid, const int32_t columns[2], const int32_t rows[2]) {
  for (int32_t row = rows[0]; row <= rows[1]; row++) {
    for (int32_t column = columns[0]; column <= columns[1]; column++) {
      uint8_t *at = &grid->fine[row * grid->columns + column];
#pragma omp atomic write
      *at = 1;
    }
  }
}

int64_t fum_coarse_grid_mark(fum_context *context, const fum_splats *splats, const fum_octree *octree,
                             const fum_coarse_grid *grid) {
  const float beyond = 6.0F; /* points: what splines make of a narrow splat has faded by then */
  const bool is_perspective = grid->view.type == FUM_CAMERA_PERSPECTIVE;
  const float narrow = (float)(NARROW * fum_view_pixel(&grid->view));
  int64_t seen = 0;
#pragma omp parallel for num_threads(fum_thread_count(context)) schedule(static) reduction(+ : seen)
  for (int64_t i = 0; i < splats->count; i++) {
    const fum_splat *s = &splats->splats[i];
    int32_t columns[2], rows[2];
    if (!(s->half_px[0] > 0.0F)) continue;
    const bool is_narrow = s->sigma < narrow * (is_perspective ? -s->center[2] : 1.0F);
    if (is_in_picture(grid, s)) seen += fum_octree_members(octree, i);
    if (!is_narrow) continue;
    find_tiles(grid, s, 0, beyond, columns);
    find_tiles(grid, s, 1, beyond, rows);
    mark_splat(grid, columns, rows);
  }
  return seen;
}
