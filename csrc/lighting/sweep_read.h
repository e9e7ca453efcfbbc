/* SPDX-License-Identifier: GPL-3.0-or-later */
/* Optical depth read from the grid of a patch of the sweep; a part of sweep_loop.h. */

static void spline(float t, float weights[4]) {
  const float s = 1.0F - t, sixth = 0.16666667F;
  weights[0] = s * s * s * sixth;
  weights[1] = (4.0F + t * t * (3.0F * t - 6.0F)) * sixth;
  weights[2] = (4.0F + s * s * (3.0F * s - 6.0F)) * sixth;
  weights[3] = t * t * t * sixth;
}

/* Weights of the faces around a range, as a line from entry `k` on: the same spline, 0 beyond two faces. */
static fum_vf weigh_faces(float range, int32_t k) {
  const float sixth = 0.16666667F, rounding = 12582912.0F; /* 1.5 * 2^23 */
  const fum_vf away = fum_vf_load(NUMBERS + k) - range;
  const fum_vf turns = (away * (1.0F / FACES) + rounding) - rounding;
  const fum_vf d = fum_vf_abs(away - turns * (float)FACES), rest = fum_vf_at_least(2.0F - d, 0.0F);
  const fum_vf inner = (4.0F + d * d * (3.0F * d - 6.0F)) * sixth;
  return fum_vf_select(d < 1.0F, inner, rest * rest * rest * sixth);
}

/* Optical depth in front of a receiver, from the four faces around it. */
static float read_depth(const patch *p, const spot *at) {
  const int32_t x = (int32_t)at->column, y = (int32_t)at->row;
  float across[4], up[4];
  fum_vf sums[FACES / FUM_LANES] = {{0}};
  if (x < 1 || y < 1 || x + 2 >= p->columns || y + 2 >= p->rows) return 0.0F;
  spline(at->column - (float)x, across);
  spline(at->row - (float)y, up);
  for (int32_t r = 0; r < 4; r++) {
    const float *taps = p->lines + ((int64_t)(y - 1 + r) * p->columns + x - 1) * FACES;
    for (int32_t k = 0; k < FACES / FUM_LANES; k++) {
      fum_vf row = across[0] * fum_vf_load(taps + k * FUM_LANES);
      for (int32_t c = 1; c < 4; c++)
        row += across[c] * fum_vf_load(taps + c * FACES + k * FUM_LANES);
      sums[k] += up[r] * row;
    }
  }
  fum_vf depth = {0};
  for (int32_t k = 0; k < FACES / FUM_LANES; k++)
    depth += sums[k] * weigh_faces(at->range, k * FUM_LANES);
  return fum_vf_sum(depth);
}
