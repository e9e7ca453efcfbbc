/* SPDX-License-Identifier: GPL-3.0-or-later */
#include "octree/cube.h"

/* Written so that compilers make one instruction of each for several places. Whatever isn't less, such as what isn't a
 * number, is in the last cell. */
static inline int32_t find_cell(double lower, double cells_per_metre, float place) {
  const double last = (1 << FUM_CUBE_LEVELS) - 1, cell = ((double)place - lower) * cells_per_metre;
  return (int32_t)(cell < last ? cell : last);
}

void fum_cube_find_cells(const fum_cube *cube, const float place[3], uint32_t out[3]) {
  for (int axis = 0; axis < 3; axis++)
    out[axis] = (uint32_t)find_cell((double)cube->lower[axis], cube->cells_per_metre, place[axis]);
}

/* Sets the lowest 10 bits of a number three apart. */
static inline uint32_t spread(uint32_t v) {
  v = (v | v << 16) & 0x030000ffU;
  v = (v | v << 8) & 0x0300f00fU;
  v = (v | v << 4) & 0x030c30c3U;
  return (v | v << 2) & 0x09249249U;
}

/* Cells along each axis of the finest level, of at most FUM_CUBE_STEP places. */
static void find_all_cells(const fum_cube *cube, int64_t count, const float *const places[3],
                           uint32_t out[3][FUM_CUBE_STEP]) {
  for (int axis = 0; axis < 3; axis++) {
    const double lower = (double)cube->lower[axis], cells_per_metre = cube->cells_per_metre;
    const float *restrict along = places[axis];
    for (int64_t i = 0; i < count; i++)
      out[axis][i] = (uint32_t)find_cell(lower, cells_per_metre, along[i]);
  }
}

static void interleave(uint32_t cells[3][FUM_CUBE_STEP], fum_cube_band band, int64_t count, uint32_t *restrict out) {
  const uint32_t mask = (1U << band.levels) - 1;
  for (int64_t i = 0; i < count; i++)
    out[i] = spread(cells[0][i] >> band.shift & mask) | spread(cells[1][i] >> band.shift & mask) << 1 |
             spread(cells[2][i] >> band.shift & mask) << 2;
}

void fum_cube_find_short_codes(const fum_cube *cube, fum_cube_band band, int64_t count, const float *const places[3],
                               uint32_t *out) {
  uint32_t cells[3][FUM_CUBE_STEP];
  find_all_cells(cube, count, places, cells);
  interleave(cells, band, count, out);
}

void fum_cube_find_codes(const fum_cube *cube, int levels, int64_t count, const float *const places[3],
                         uint64_t *restrict out) {
  const int low_levels = levels < FUM_CUBE_SHORT ? levels : FUM_CUBE_SHORT;
  const fum_cube_band low = {0, low_levels}, high = {low_levels, levels - low_levels};
  uint32_t cells[3][FUM_CUBE_STEP], low_codes[FUM_CUBE_STEP], high_codes[FUM_CUBE_STEP];
  for (int64_t begin = 0; begin < count; begin += FUM_CUBE_STEP) {
    const int64_t left = count - begin, step = left < FUM_CUBE_STEP ? left : FUM_CUBE_STEP;
    find_all_cells(cube, step, (const float *const[3]){places[0] + begin, places[1] + begin, places[2] + begin}, cells);
    interleave(cells, low, step, low_codes);
    interleave(cells, high, step, high_codes);
    for (int64_t i = 0; i < step; i++)
      out[begin + i] = (uint64_t)high_codes[i] << (3 * low_levels) | low_codes[i];
  }
}
