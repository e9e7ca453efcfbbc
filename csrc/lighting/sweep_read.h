/* SPDX-License-Identifier: GPL-3.0-or-later */
/* Optical depth read from the grid of a patch of the sweep; a part of sweep_loop.h. */

/* Faces, rows and columns that a receiver is read from along each axis. */
enum { TAPS = 4 };

/* Cells from which receivers are read. */
static area find_area(const patch *p, const spot *receivers, int64_t count) {
  float low[2] = {INFINITY, INFINITY}, high[2] = {0.0F, 0.0F};
  for (int64_t i = 0; i < count; i++) {
    const float column = receivers[i].column, row = receivers[i].row;
    low[0] = column < low[0] ? column : low[0];
    high[0] = column > high[0] ? column : high[0];
    low[1] = row < low[1] ? row : low[1];
    high[1] = row > high[1] ? row : high[1];
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

/* Weights of the cubic B-spline along three axes, a quad each, from the places between the second and the third tap. */
static void weigh_taps(fum_quad t, fum_quad weights[TAPS]) {
  const fum_quad s = 1.0F - t;
  const float sixth = 0.16666667F;
  weights[0] = s * s * s * sixth;
  weights[1] = (4.0F + t * t * (3.0F * t - 6.0F)) * sixth;
  weights[2] = (4.0F + s * s * (3.0F * s - 6.0F)) * sixth;
  weights[3] = t * t * t * sixth;
  fum_quad_transpose(weights);
}

/* Optical depth in front of a receiver behind face `before`, from the faces taken. */
static float read_depth(const patch *p, const spot *at, int32_t before) {
  const int32_t x = (int32_t)at->column, y = (int32_t)at->row;
  fum_quad weights[TAPS], sums = {0.0F};
  if (x < 1 || y < 1 || x + 2 >= p->columns || y + 2 >= p->rows) return 0.0F;
  weigh_taps((fum_quad){at->column - (float)x, at->row - (float)y, at->range - (float)before, 0.0F}, weights);
  for (int32_t r = 0; r < TAPS; r++) {
    const float *taps = p->faces + TAPS * ((int64_t)(y - 1 + r) * p->columns + x - 1);
    fum_quad row = {0.0F};
    for (int32_t c = 0; c < TAPS; c++) {
      fum_quad faces;
      memcpy(&faces, taps + TAPS * c, sizeof faces);
      row += weights[0][c] * faces;
    }
    sums += weights[1][r] * row;
  }
  sums *= weights[2];
  return sums[0] + sums[1] + (sums[2] + sums[3]);
}
