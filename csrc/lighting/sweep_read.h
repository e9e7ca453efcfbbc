/* SPDX-License-Identifier: GPL-3.0-or-later */
/* Optical depth read from the grid of a patch of the sweep; a part of sweep_loop.h. */

/* Faces, rows and columns that a receiver is read from along each axis. */
enum { TAPS = 4 };

/* Cells from which receivers are read. */
static area find_area(const patch *p, const spot *receivers, int64_t count) {
  fum_quad low = {INFINITY, INFINITY}, high = {0.0F};
  for (int64_t i = 0; i < count; i++) {
    fum_quad at;
    memcpy(&at, &receivers[i], sizeof at);
    low = fum_quad_min(low, at);
    high = fum_quad_max(high, at);
  }
  return (area){at_least(floorf(low[0]) - 1.0F, 0), at_least(floorf(low[1]) - 1.0F, 0),
                at_most(high[0] + 3.0F, p->columns), at_most(high[1] + 3.0F, p->rows)};
}

/* Copies the faces that receivers between the second and the third of them are read from, side by side for each cell:
 * these have a fourth of the memory to look at. */
static void take_faces(const patch *p, int32_t first, area of) {
  int32_t at[TAPS];
  for (int32_t k = 0; k < TAPS; k++)
    at[k] = (first + k) & (FACES - 1);
  const bool is_whole = at[0] < at[TAPS - 1];
  for (int32_t y = of.top; y < of.bottom; y++) {
    for (int64_t i = (int64_t)y * p->columns + of.left; i < (int64_t)y * p->columns + of.right; i++) {
      const float *line = p->lines + FACES * i;
      float *out = p->faces + TAPS * i;
      if (is_whole) {
        memcpy(out, line + at[0], TAPS * sizeof *out);
        continue;
      }
      for (int32_t k = 0; k < TAPS; k++)
        out[k] = line[at[k]];
    }
  }
}

/* Weights of the cubic B-spline along an axis, a quad for each place between the second and the third tap. */
static void weigh_taps(fum_vf t, fum_quad weights[FUM_LANES]) {
  const fum_vf s = 1.0F - t;
  const float sixth = 0.16666667F;
  float values[TAPS][FUM_LANES];
  fum_vf_store(values[0], s * s * s * sixth);
  fum_vf_store(values[1], (4.0F + t * t * (3.0F * t - 6.0F)) * sixth);
  fum_vf_store(values[2], (4.0F + s * s * (3.0F * s - 6.0F)) * sixth);
  fum_vf_store(values[3], t * t * t * sixth);
  for (int32_t k = 0; k < FUM_LANES; k += TAPS) {
    for (int32_t tap = 0; tap < TAPS; tap++)
      memcpy(&weights[k + tap], values[tap] + k, sizeof *weights);
    fum_quad_transpose(weights + k);
  }
}

/* Places of spots, FUM_LANES of them. */
static void load_spots(const spot *from, fum_vf *column, fum_vf *row, fum_vf *range) {
  float values[TAPS][FUM_LANES];
  for (int32_t k = 0; k < FUM_LANES; k += 4) {
    fum_quad quads[4];
    memcpy(quads, from + k, sizeof quads);
    fum_quad_transpose(quads);
    for (int32_t r = 0; r < 4; r++)
      memcpy(values[r] + k, &quads[r], sizeof *quads);
  }
  *column = fum_vf_load(values[0]);
  *row = fum_vf_load(values[1]);
  *range = fum_vf_load(values[2]);
}

/* Optical depths in front of the first FUM_LANES of `count` receivers, which are behind face `before`, from the faces
 * taken. */
static void read_depths(const patch *p, const spot *receivers, int64_t count, int32_t before) {
  fum_quad weights[3][FUM_LANES];
  fum_vf column, row, range;
  int32_t firsts[FUM_LANES];
  load_spots(receivers, &column, &row, &range);
  const fum_vi x = __builtin_convertvector(column, fum_vi), y = __builtin_convertvector(row, fum_vi);
  const fum_vi is_here = (x >= 1) & (y >= 1) & (x + 2 < p->columns) & (y + 2 < p->rows);
  const fum_vi first = ((y - 1) * p->columns + x - 1) * TAPS & is_here;
  weigh_taps(column - __builtin_convertvector(x, fum_vf), weights[0]);
  weigh_taps(row - __builtin_convertvector(y, fum_vf), weights[1]);
  weigh_taps(range - (float)before, weights[2]);
  memcpy(firsts, &first, sizeof firsts);
  const uint32_t are_here = fum_vi_bits(is_here);
  const int64_t step = (int64_t)TAPS * p->columns;
  for (int32_t k = 0; k < FUM_LANES && k < count; k++) {
    const float *taps = p->faces + firsts[k], *const rows[TAPS] = {taps, taps + step, taps + 2 * step, taps + 3 * step};
    const float depth = fum_quad_contract(weights[0][k], weights[1][k], weights[2][k], rows);
    __builtin_prefetch(&p->job->depths[receivers[k + AHEAD].index]);
    if ((are_here >> k & 1) != 0) p->job->depths[receivers[k].index] += depth > 0.0F ? depth : 0.0F;
  }
}
