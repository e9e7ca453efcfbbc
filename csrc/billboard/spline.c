/* SPDX-License-Identifier: GPL-3.0-or-later */
#include "billboard/spline.h"

#include <math.h>

enum { DEGREE = FUM_SPLINE_TAPS - 1 };

/* The recursion of Cox and de Boor for knots 1 apart, `f` behind one of them. */
static void find_weights(double f, float out[FUM_SPLINE_TAPS]) {
  double w[FUM_SPLINE_TAPS] = {1.0};
  for (int d = 1; d <= DEGREE; d++) {
    for (int j = d; j >= 0; j--) {
      const double left = j > 0 ? w[j - 1] : 0.0, right = j < d ? w[j] : 0.0, begin = (double)(j - d);
      w[j] = ((f - begin) * left + (begin + (double)d + 1.0 - f) * right) / (double)d;
    }
  }
  for (int j = 0; j <= DEGREE; j++)
    out[j] = (float)w[j];
}

fum_spline_taps fum_spline_find_taps(int32_t step) {
  fum_spline_taps taps = {.step = step};
  for (int32_t k = 0; k < step; k++) {
    const double at = ((double)k + 0.5) / (double)step - 0.5, whole = floor(at);
    taps.first[k] = (int32_t)whole - DEGREE / 2;
    find_weights(at - whole, taps.weights[k]);
  }
  return taps;
}

/* Solves (before + a here + next) / (a + 2) = sample for `count` values, `stride` apart, of `width` side by side. The
 * first and the last stay as they are. */
static void solve(float a, float *values, int32_t count, int64_t stride, int64_t width) {
  enum { SETTLED = 32 }; /* pivots don't change any more */
  float pivots[SETTLED] = {0.0F};
  for (int k = 1; k < SETTLED; k++)
    pivots[k] = 1.0F / (a - pivots[k - 1]);
  for (int32_t i = 1; i < count - 1; i++) {
    const float pivot = pivots[i < SETTLED ? i : SETTLED - 1], *before = values + (i - 1) * stride;
    float *here = values + i * stride;
    for (int64_t k = 0; k < width; k++)
      here[k] = ((a + 2.0F) * here[k] - before[k]) * pivot;
  }
  for (int32_t i = count - 2; i > 0; i--) {
    const float pivot = pivots[i < SETTLED ? i : SETTLED - 1], *next = values + (i + 1) * stride;
    float *here = values + i * stride;
    for (int64_t k = 0; k < width; k++)
      here[k] -= pivot * next[k];
  }
}

/* At the knots a spline is (1, 26, 66, 26, 1) / 120 of its coefficients: the product of (1, a, 1) / (a + 2) for both
 * a. */
static void fit(float *values, int32_t count, int64_t stride, int64_t width) {
  const float root = 10.246950766F; /* of 105 */
  solve(13.0F + root, values, count, stride, width);
  solve(13.0F - root, values, count, stride, width);
}

void fum_spline_fit(fum_context *context, const fum_spline *s) {
  enum { CHUNK = 64 };
  const int64_t row = (int64_t)s->columns * s->channels;
#pragma omp parallel for num_threads(fum_thread_count(context)) schedule(static)
  for (int32_t y = 0; y < s->rows; y++)
    fit(s->values + y * row, s->columns, s->channels, s->channels);
#pragma omp parallel for num_threads(fum_thread_count(context)) schedule(static)
  for (int64_t x = 0; x < row; x += CHUNK)
    fit(s->values + x, s->rows, row, x + CHUNK < row ? CHUNK : row - x);
}

/* Where the coefficients of a finer point begin. */
static int32_t first_of(const fum_spline_taps *taps, int32_t point) {
  return point / taps->step + taps->first[point % taps->step];
}

void fum_spline_row(const fum_spline *s, const fum_spline_taps *taps, int32_t row, int32_t from, int32_t count,
                    float *out) {
  const int64_t width = (int64_t)s->columns * s->channels;
  const float *w = taps->weights[row % taps->step], *r = s->values + first_of(taps, row) * width;
  const int64_t end = (int64_t)(first_of(taps, from + count - 1) + FUM_SPLINE_TAPS) * s->channels;
  for (int64_t i = (int64_t)first_of(taps, from) * s->channels; i < end; i++) {
    out[i] = w[0] * r[i] + w[1] * r[width + i] + w[2] * r[2 * width + i] + w[3] * r[3 * width + i] +
             w[4] * r[4 * width + i] + w[5] * r[5 * width + i];
  }
}

static inline __attribute__((always_inline)) void
find_points(const fum_spline_taps *taps, int32_t channels, const float *row, int32_t from, int32_t count, float *out) {
  for (int32_t n = 0; n < count; n++) {
    const float *w = taps->weights[(from + n) % taps->step], *at = row + (int64_t)first_of(taps, from + n) * channels;
    float sums[4] = {0.0F};
    for (int32_t k = 0; k < FUM_SPLINE_TAPS; k++) {
      for (int32_t c = 0; c < channels; c++)
        sums[c] += w[k] * at[k * channels + c];
    }
    for (int32_t c = 0; c < channels; c++)
      out[(int64_t)n * channels + c] = sums[c];
  }
}

void fum_spline_points(const fum_spline_taps *taps, int32_t channels, const float *row, int32_t from, int32_t count,
                       float *out) {
  if (channels == 4) {
    find_points(taps, 4, row, from, count, out);
  } else {
    find_points(taps, 3, row, from, count, out);
  }
}
