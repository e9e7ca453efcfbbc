/* SPDX-License-Identifier: GPL-3.0-or-later */
#include "billboard/coarse.h"

#include "base/vector.h"
#include "billboard/coarse_error.h"
#include "billboard/coarse_grid.h"

#include <stdlib.h>

/* What a picture is made with. */
typedef struct painting {
  fum_context *context;
  fum_tile_job *job;
  fum_coarse_grid grid;
  uint8_t *smooth; /* [tiles of the picture] those with smoke that are interpolated */
  uint8_t *needed; /* [tiles of the grid] for them */
  int32_t plane_count;
  fum_coarse_plane *planes; /* [plane_count]; the first one is Combined */
  float **light_rgb;        /* [lights] of the grid */
} painting;

static int32_t add_plane(painting *p, int32_t channels, float *pixels, float **out_values) {
  const fum_view *view = &p->grid.view;
  fum_coarse_plane *added = &p->planes[p->plane_count++];
  added->spline = (fum_spline){.columns = view->width, .rows = view->height, .channels = channels};
  added->pixels = pixels;
  const int32_t status = fum_alloc(p->context, (int64_t)view->width * view->height, (size_t)channels * sizeof(float),
                                   "picture of smooth smoke", &added->spline.values);
  *out_values = added->spline.values;
  return status;
}

/* The job on the grid, where no solid is amid the smoke. */
static int32_t begin_coarse(painting *p, fum_tile_job *coarse) {
  const fum_tile_job *job = p->job;
  const int32_t lights = job->scene->light_count;
  int32_t status = fum_alloc(p->context, lights + 2, sizeof *p->planes, "picture of smooth smoke", &p->planes);
  if (status == FUM_OK)
    status = fum_alloc(p->context, lights, sizeof *p->light_rgb, "picture of smooth smoke", &p->light_rgb);
  *coarse = *job;
  coarse->view = &p->grid.view;
  coarse->solid_depths = coarse->solid_behind = coarse->solid_shares = NULL;
  coarse->through[0] = coarse->through[1] = NULL;
  if (status == FUM_OK) status = add_plane(p, 4, job->rgba, &coarse->rgba);
  if (status == FUM_OK && job->emission != NULL) status = add_plane(p, 3, job->emission, &coarse->emission);
  for (int32_t l = 0; l < lights && job->light_rgb != NULL && status == FUM_OK; l++) {
    if (job->light_rgb[l] != NULL) status = add_plane(p, 3, job->light_rgb[l], &p->light_rgb[l]);
  }
  coarse->light_rgb = job->light_rgb != NULL ? p->light_rgb : NULL;
  return status;
}

static void end_painting(painting *p) {
  for (int32_t k = 0; k < p->plane_count; k++)
    fum_free(p->context, &p->planes[k].spline.values);
  fum_free(p->context, &p->planes);
  fum_free(p->context, &p->light_rgb);
  fum_free(p->context, &p->needed);
  fum_free(p->context, &p->smooth);
  fum_coarse_grid_end(p->context, &p->grid);
}

static void points_along(const painting *p, int32_t tile, int32_t side, int32_t out[2]) {
  const int32_t end = (tile + 1) * FUM_TILE < side ? (tile + 1) * FUM_TILE : side;
  out[0] = fum_coarse_grid_point(&p->grid, tile * FUM_TILE);
  out[1] = fum_coarse_grid_point(&p->grid, end - 1) + 1;
}

/* Points of the grid, first and last column and row, that a tile lies between. */
static void points_of(const painting *p, int64_t tile, int32_t x[2], int32_t y[2]) {
  points_along(p, (int32_t)(tile % p->grid.columns), p->grid.whole->width, x);
  points_along(p, (int32_t)(tile / p->grid.columns), p->grid.whole->height, y);
}

/* Do splats of the grid touch the tile? */
static bool has_smoke(const painting *p, int64_t tile) {
  const fum_splats *splats = p->job->splats;
  int32_t x[2], y[2];
  points_of(p, tile, x, y);
  for (int32_t row = y[0] / FUM_TILE; row <= y[1] / FUM_TILE; row++) {
    const int64_t *begins = splats->tile_begins + (int64_t)row * splats->columns;
    if (begins[x[0] / FUM_TILE] < begins[x[1] / FUM_TILE + 1]) return true;
  }
  return false;
}

/* Sorts tiles into those without smoke, smooth ones and those that are drawn pixel by pixel. */
static int32_t sort_tiles(painting *p, fum_coarse_report *out) {
  const int64_t tiles = (int64_t)p->grid.columns * p->grid.rows;
  const int32_t status = fum_alloc(p->context, tiles, sizeof *p->smooth, "tiles", &p->smooth);
  for (int64_t i = 0; i < tiles && status == FUM_OK; i++) {
    const bool counts = has_smoke(p, i);
    p->smooth[i] = counts && !p->grid.fine[i];
    out->tile_count += counts;
    out->fine_count += counts && p->grid.fine[i];
  }
  return status;
}

static int32_t clamp_tile(int32_t point, int32_t count) {
  const int32_t tile = point < 0 ? 0 : point / FUM_TILE;
  return tile < count ? tile : count - 1;
}

/* Marks tiles of the grid on which a tile of the picture lies, and so many points around it. */
static void mark_around(const painting *p, int64_t tile, int32_t around, uint8_t *out) {
  const fum_splats *splats = p->job->splats;
  int32_t x[2], y[2];
  points_of(p, tile, x, y);
  const int32_t columns[2] = {clamp_tile(x[0] - around, splats->columns), clamp_tile(x[1] + around, splats->columns)};
  const int32_t rows[2] = {clamp_tile(y[0] - around, splats->rows), clamp_tile(y[1] + around, splats->rows)};
  for (int32_t row = rows[0]; row <= rows[1]; row++) {
    for (int32_t column = columns[0]; column <= columns[1]; column++)
      out[row * splats->columns + column] = 1;
  }
}

/* Finds the smooth tiles that aren't: the grid's points don't tell enough of them. */
static int64_t find_rough(const painting *p, float tolerance) {
  int64_t count = 0;
#pragma omp parallel for num_threads(fum_thread_count(p->context)) schedule(dynamic) reduction(+ : count)
  for (int64_t i = 0; i < (int64_t)p->grid.columns * p->grid.rows; i++) {
    int32_t x[2], y[2];
    if (!p->smooth[i]) continue;
    points_of(p, i, x, y);
    for (int32_t k = 0; k < p->plane_count && p->smooth[i]; k++)
      p->smooth[i] = !fum_coarse_is_rough(&p->planes[k], tolerance, x, y);
    p->grid.fine[i] = !p->smooth[i];
    count += p->grid.fine[i];
  }
  return count;
}

/* Splines swing a little where there is nothing. */
static void limit(float *pixels, int32_t channels, int32_t count) {
  for (int32_t i = 0; i < channels * count; i++)
    pixels[i] = fum_max(pixels[i], 0.0F);
  for (int32_t i = 0; i < count && channels == 4; i++)
    pixels[4 * i + 3] = fum_min(pixels[4 * i + 3], 1.0F);
}

/* No solid is amid the smoke: behind it is seen what isn't covered. */
static void note_through(const fum_tile_job *job, int64_t pixel, int32_t count) {
  for (int layer = 0; layer < 2; layer++) {
    for (int64_t i = pixel; i < pixel + count && job->through[layer] != NULL; i++)
      job->through[layer][i] = 1.0F - job->rgba[4 * i + 3];
  }
}

/* One row of a tile's pixels. `coefficients`: room for a row of the grid. */
static void interpolate_row(const painting *p, const fum_spline_taps *taps, int32_t x, int32_t y, float *coefficients) {
  const int32_t width = p->grid.whole->width, shift = FUM_COARSE_MARGIN * taps->step;
  const int32_t count = width - x < FUM_TILE ? width - x : FUM_TILE;
  const int64_t pixel = (int64_t)y * width + x;
  for (int32_t k = 0; k < p->plane_count; k++) {
    const fum_coarse_plane *of = &p->planes[k];
    const int32_t channels = of->spline.channels;
    fum_spline_row(&of->spline, taps, y + shift, x + shift, count, coefficients);
    fum_spline_points(taps, channels, coefficients, x + shift, count, of->pixels + pixel * channels);
    limit(of->pixels + pixel * channels, channels, count);
  }
  note_through(p->job, pixel, count);
}

static int32_t interpolate(const painting *p) {
  const fum_spline_taps taps = fum_spline_find_taps(p->grid.step);
  const int64_t tiles = (int64_t)p->grid.columns * p->grid.rows;
  bool has_memory = true;
  for (int32_t k = 0; k < p->plane_count; k++)
    fum_spline_fit(p->context, &p->planes[k].spline);
#pragma omp parallel num_threads(fum_thread_count(p->context)) reduction(&& : has_memory)
  {
    float *row = malloc(4 * (size_t)p->grid.view.width * sizeof *row);
    has_memory = row != NULL;
#pragma omp for schedule(dynamic)
    for (int64_t i = 0; i < tiles; i++) {
      const int32_t x = (int32_t)(i % p->grid.columns) * FUM_TILE, y0 = (int32_t)(i / p->grid.columns) * FUM_TILE;
      if (!p->smooth[i] || row == NULL) continue;
      for (int32_t y = y0; y < y0 + FUM_TILE && y < p->grid.whole->height; y++)
        interpolate_row(p, &taps, x, y, row);
    }
    free(row);
  }
  return has_memory ? FUM_OK : fum_fail(p->context, FUM_ERROR_MEMORY, "drawing: no memory for a row of the picture");
}

/* Splats of the grid, of which those that touch tiles that are drawn pixel by pixel are seen in the picture. */
static int32_t see_fine(const painting *p, const fum_splats_options *options, fum_splats *splats) {
  const fum_tile_job *job = p->job;
  const float step = (float)p->grid.step, shift = 0.5F * step * (1.0F - 2.0F * FUM_COARSE_MARGIN) - 0.5F;
  const int32_t around = 2;
  uint8_t *from = NULL;
  int32_t status = fum_alloc(p->context, (int64_t)splats->columns * splats->rows, sizeof *from, "tiles", &from);
  for (int64_t i = 0; i < (int64_t)p->grid.columns * p->grid.rows && status == FUM_OK; i++) {
    if (p->grid.fine[i]) mark_around(p, i, around, from);
  }
  const fum_splats_again again = {.from = from, .wanted = p->grid.fine, .scale = step, .shift = {shift, shift}};
  if (status == FUM_OK)
    status = fum_splats_see_again(p->context, job->octree, job->view, job->slabs, options, &again, splats);
  fum_free(p->context, &from);
  return status;
}

/* Splats of the picture, those of the grid or none being there. */
static int32_t see_all(const painting *p, const fum_splats_options *options, fum_splats *splats) {
  const fum_tile_job *job = p->job;
  const fum_splats_again again = {0};
  if (splats->splats == NULL) return fum_splats_find(p->context, job->octree, job->view, job->slabs, options, splats);
  return fum_splats_see_again(p->context, job->octree, job->view, job->slabs, options, &again, splats);
}

/* Draws tiles pixel by pixel: those that are marked, or all. */
static int32_t draw_fine(painting *p, const fum_splats_options *options, bool all, fum_splats *splats,
                         fum_coarse_report *report) {
  fum_tile_job *job = p->job;
  int32_t status = all ? see_all(p, options, splats) : see_fine(p, options, splats);
  if (status != FUM_OK) return status;
  if (all) report->seen_count = splats->seen_count;
  fum_tiles_shade_dust(p->context, job, splats);
  const double start_s = fum_now_s();
  status = fum_tiles_draw(p->context, job);
  report->draw_s += fum_now_s() - start_s;
  return status;
}

/* Every eighth tile of the grid, whose roughness stands for that of all. */
static bool is_sampled(int32_t column, int32_t row) {
  return (column + 3 * row) % 8 == 0;
}

/* Does a block of the grid's points show smoke? */
static bool shows(const fum_spline *rgba, const int32_t x[2], const int32_t y[2]) {
  for (int32_t j = y[0]; j <= y[1]; j++) {
    for (int32_t i = x[0]; i <= x[1]; i++) {
      if (rgba->values[4 * ((int64_t)j * rgba->columns + i) + 3] > 0.004F) return true;
    }
  }
  return false;
}

/* Would so much of the sampled tiles be drawn once more that the grid saves nothing? */
static bool is_wasted(const painting *p, float tolerance) {
  const fum_splats *splats = p->job->splats;
  const int32_t block = FUM_TILE / p->grid.step, last = FUM_TILE - FUM_COARSE_AROUND - block;
  int64_t count = 0, rough = 0;
  for (int64_t i = 0; i < (int64_t)splats->columns * splats->rows; i++) {
    const int32_t column = (int32_t)(i % splats->columns), row = (int32_t)(i / splats->columns);
    if (!p->needed[i] || !is_sampled(column, row)) continue;
    for (int32_t v = FUM_COARSE_AROUND; v <= last; v += block) {
      for (int32_t u = FUM_COARSE_AROUND; u <= last; u += block) {
        const int32_t x[2] = {column * FUM_TILE + u, column * FUM_TILE + u + block - 1};
        const int32_t y[2] = {row * FUM_TILE + v, row * FUM_TILE + v + block - 1};
        if (x[1] + FUM_COARSE_AROUND >= p->grid.view.width || y[1] + FUM_COARSE_AROUND >= p->grid.view.height) continue;
        if (!shows(&p->planes[0].spline, x, y)) continue;
        bool is_rough = false;
        for (int32_t k = 0; k < p->plane_count; k++)
          is_rough = is_rough || fum_coarse_is_rough(&p->planes[k], tolerance, x, y);
        rough += is_rough;
        count++;
      }
    }
  }
  return count >= 8 && 3 * rough > count;
}

/* Draws those of the grid's tiles that are needed and sampled, or not sampled. */
static int32_t draw_part(const painting *p, fum_tile_job *coarse, bool sampled) {
  const fum_splats *splats = p->job->splats;
  const int64_t tiles = (int64_t)splats->columns * splats->rows;
  uint8_t *wanted = NULL;
  int32_t status = fum_alloc(p->context, tiles, sizeof *wanted, "tiles", &wanted);
  for (int64_t i = 0; i < tiles && status == FUM_OK; i++) {
    const int32_t column = (int32_t)(i % splats->columns), row = (int32_t)(i / splats->columns);
    wanted[i] = p->needed[i] && is_sampled(column, row) == sampled;
  }
  coarse->wanted = wanted;
  if (status == FUM_OK) status = fum_tiles_draw(p->context, coarse);
  if (status == FUM_OK) status = fum_coarse_find_means(p->context, p->plane_count, p->planes);
  fum_free(p->context, &wanted);
  return status;
}

/* Draws what is smooth enough on the grid, and marks the tiles that aren't. If there are too many nothing is drawn. */
static int32_t draw_coarse(painting *p, float tolerance, fum_coarse_report *report) {
  const int64_t tiles = (int64_t)p->grid.columns * p->grid.rows;
  const int32_t around = 12; /* what is further away splines have forgotten but for a 20000th */
  const fum_splats *splats = p->job->splats;
  fum_tile_job coarse;
  int32_t status = begin_coarse(p, &coarse);
  if (status == FUM_OK)
    status = fum_alloc(p->context, (int64_t)splats->columns * splats->rows, sizeof *p->needed, "tiles", &p->needed);
  if (status != FUM_OK) return status;
  for (int64_t i = 0; i < tiles; i++) {
    if (p->smooth[i]) mark_around(p, i, around, p->needed);
  }
  status = draw_part(p, &coarse, true);
  if (status != FUM_OK) return status;
  if (is_wasted(p, tolerance)) {
    report->step = 1;
    return FUM_OK;
  }
  status = draw_part(p, &coarse, false);
  if (status != FUM_OK) return status;
  report->fine_count += find_rough(p, tolerance);
  return interpolate(p);
}

int32_t fum_coarse_draw(fum_context *context, fum_tile_job *job, const fum_splats_options *options, float tolerance,
                        fum_splats *splats, fum_coarse_report *out) {
  painting p = {.context = context, .job = job};
  *out = (fum_coarse_report){.step = 1};
  int32_t status = fum_coarse_grid_begin(context, job, &p.grid);
  if (status == FUM_OK && p.grid.step > 1) {
    status = fum_splats_find(context, job->octree, &p.grid.view, job->slabs, options, splats);
    if (status == FUM_OK) out->seen_count = fum_coarse_grid_mark(context, splats, job->octree, &p.grid);
    if (status == FUM_OK) status = sort_tiles(&p, out);
    if (2 * out->fine_count <= out->tile_count) out->step = p.grid.step;
  }
  const double start_s = fum_now_s();
  if (status == FUM_OK && out->step > 1) status = draw_coarse(&p, tolerance, out);
  out->draw_s = fum_now_s() - start_s;
  if (out->step == 1) out->fine_count = out->tile_count;
  if (status == FUM_OK && (out->step == 1 || out->fine_count > 0))
    status = draw_fine(&p, options, out->step == 1, splats, out);
  end_painting(&p);
  return status;
}
