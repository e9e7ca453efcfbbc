/* SPDX-License-Identifier: GPL-3.0-or-later */
#include "billboard/splat_tiles.h"

#include "base/vector.h"

/* First and last tile that the splat's box touches along an axis. */
static void find_tiles(const fum_splat *s, int axis, int32_t pixels, int32_t out[2]) {
  const float first = s->middle_px[axis] - s->half_px[axis], last = s->middle_px[axis] + s->half_px[axis];
  const float per_pixel = 1.0F / (float)FUM_TILE, end = (float)fum_tiles_along(pixels);
  out[0] = (int32_t)(fum_max(first, 0.0F) * per_pixel);
  out[1] = (int32_t)fum_min(last * per_pixel, end - 0.5F);
}

/* Squares of the splat's distances from a row or column of tiles, as fum_splat_gap. */
static float find_gap(const fum_splat *s, int axis, int32_t tile) {
  const float first = (float)(tile * FUM_TILE);
  return fum_splat_gap(s, axis, first, first + (float)(FUM_TILE - 1));
}

fum_touched fum_touched_find(const fum_view *view, const fum_splat *splat, bool is_smeared) {
  int32_t x[2], y[2];
  if (!fum_splat_is_seen(splat)) return 0;
  find_tiles(splat, 0, view->width, x);
  find_tiles(splat, 1, view->height, y);
  if (x[1] < x[0] || y[1] < y[0]) return 0;
  const bool has_corners = x[0] < x[1] && y[0] < y[1];
  if (x[1] > x[0] + 1 || y[1] > y[0] + 1 || (has_corners && is_smeared)) return FUM_TOUCHED_MANY;
  fum_touched touched = (fum_touched)(y[0] * fum_tiles_along(view->width) + x[0]) << FUM_TOUCHED_TILE;
  for (int32_t row = y[0]; row <= y[1]; row++) {
    for (int32_t column = x[0]; column <= x[1]; column++) {
      if (has_corners && find_gap(splat, 0, column) + find_gap(splat, 1, row) > splat->rim) continue;
      touched |= 1U << (2 * (row - y[0]) + column - x[0]);
    }
  }
  return touched;
}

int32_t fum_splat_sorting_begin(fum_context *context, const fum_view *view, fum_splats *splats, const uint8_t *wanted,
                                fum_splat_sorting *out) {
  const int64_t tiles = (int64_t)splats->columns * splats->rows;
  *out = (fum_splat_sorting){.view = view,
                             .splats = splats,
                             .wanted = wanted,
                             .blocks = fum_thread_count(context),
                             .tiles = tiles,
                             .stride = tiles + splats->columns + 1};
  int32_t status = fum_alloc(context, out->blocks * out->stride, sizeof *out->cursors, "tiles", &out->cursors);
  if (status == FUM_OK) status = fum_alloc(context, splats->count, sizeof *out->touched, "tiles", &out->touched);
  if (status == FUM_OK)
    status = fum_alloc(context, tiles + 1, sizeof *splats->tile_begins, "tiles", &splats->tile_begins);
  return status;
}

void fum_splat_sorting_end(fum_context *context, fum_splat_sorting *s) {
  fum_free(context, &s->cursors);
  fum_free(context, &s->touched);
}

/* Does the streak pass near a tile? */
static bool is_near(const fum_streak *streak, int32_t column, int32_t row) {
  const float half = 0.5F * (float)(FUM_TILE - 1), diagonal = 1.4143F * half;
  return fum_streak_touches(streak, (float)(column * FUM_TILE) + half, (float)(row * FUM_TILE) + half, diagonal);
}

/* Counts every wanted tile that the splat touches, or writes it down at the place that was counted. */
static void touch_many(const fum_splat_sorting *s, int64_t i, int64_t *cursors, uint32_t *out) {
  const fum_splat *splat = &s->splats->splats[i];
  const fum_streak *streaks = s->splats->streaks;
  const fum_streak *streak = streaks != NULL && streaks[i].kind != FUM_STREAK_NONE ? &streaks[i] : NULL;
  int32_t x[2], y[2];
  find_tiles(splat, 0, s->view->width, x);
  find_tiles(splat, 1, s->view->height, y);
  const bool has_corners = x[0] < x[1] && y[0] < y[1];
  for (int32_t row = y[0]; row <= y[1]; row++) {
    const float left = has_corners ? splat->rim - find_gap(splat, 1, row) : INFINITY;
    for (int32_t column = x[0]; column <= x[1]; column++) {
      const int64_t tile = (int64_t)row * s->splats->columns + column;
      if (s->wanted != NULL && !s->wanted[tile]) continue;
      if (has_corners && find_gap(splat, 0, column) > left) continue;
      if (has_corners && streak != NULL && !is_near(streak, column, row)) continue;
      const int64_t at = cursors[tile]++;
      if (out != NULL) out[at] = (uint32_t)i;
    }
  }
}

/* Without the tiles that aren't wanted. */
static fum_touched keep_wanted(const fum_splat_sorting *s, fum_touched touched) {
  const uint8_t *at = s->wanted + (touched >> FUM_TOUCHED_TILE);
  for (int k = 0; k < 4; k++) {
    const fum_touched bit = 1U << k;
    if ((touched & bit) != 0 && !at[k / 2 * s->splats->columns + k % 2]) touched &= ~bit;
  }
  return touched;
}

/* Without branches: which of four tiles are touched can't be foretold. */
void fum_splat_sorting_count(const fum_splat_sorting *s, int block, int64_t begin, int64_t end) {
  int64_t *cursors = s->cursors + block * s->stride;
  const int32_t columns = s->splats->columns;
  for (int64_t i = begin; i < end; i++) {
    fum_touched touched = s->touched[i];
    if (touched == 0) continue;
    if ((touched & FUM_TOUCHED_MANY) != 0) {
      touch_many(s, i, cursors, NULL);
      continue;
    }
    if (s->wanted != NULL) touched = s->touched[i] = keep_wanted(s, touched);
    int64_t *at = cursors + (touched >> FUM_TOUCHED_TILE);
    at[0] += touched & 1;
    at[1] += touched >> 1 & 1;
    at[columns] += touched >> 2 & 1;
    at[columns + 1] += touched >> 3 & 1;
  }
}

/* Writes to the tile of a cursor if a bit is set, in vain if not. */
static inline void put(uint32_t i, fum_touched bit, int64_t *cursor, uint32_t *out, uint32_t *vain) {
  uint32_t *const places[2] = {vain, out + *cursor};
  *places[bit] = i;
  *cursor += bit;
}

static void write_block(const fum_splat_sorting *s, int block, uint32_t *out) {
  int64_t *cursors = s->cursors + block * s->stride;
  const int64_t end = fum_splat_sorting_block(s, block + 1);
  const int32_t columns = s->splats->columns;
  uint32_t vain;
  for (int64_t i = fum_splat_sorting_block(s, block); i < end; i++) {
    const fum_touched touched = s->touched[i];
    if (touched == 0) continue;
    if ((touched & FUM_TOUCHED_MANY) != 0) {
      touch_many(s, i, cursors, out);
      continue;
    }
    int64_t *at = cursors + (touched >> FUM_TOUCHED_TILE);
    put((uint32_t)i, touched & 1, at, out, &vain);
    put((uint32_t)i, touched >> 1 & 1, at + 1, out, &vain);
    put((uint32_t)i, touched >> 2 & 1, at + columns, out, &vain);
    put((uint32_t)i, touched >> 3 & 1, at + columns + 1, out, &vain);
  }
}

int32_t fum_splat_sorting_write(fum_context *context, const fum_splat_sorting *s) {
  fum_splats *splats = s->splats;
  int64_t total = 0;
  for (int64_t tile = 0; tile < s->tiles; tile++) {
    splats->tile_begins[tile] = total;
    for (int block = 0; block < s->blocks; block++) {
      const int64_t n = s->cursors[block * s->stride + tile];
      s->cursors[block * s->stride + tile] = total;
      total += n;
    }
  }
  splats->tile_begins[s->tiles] = total;
  const int32_t status = fum_alloc(context, total, sizeof *splats->tile_splats, "tiles", &splats->tile_splats);
  if (status != FUM_OK) return status;
#pragma omp parallel for num_threads(s->blocks) schedule(static, 1)
  for (int block = 0; block < s->blocks; block++)
    write_block(s, block, splats->tile_splats);
  return FUM_OK;
}
