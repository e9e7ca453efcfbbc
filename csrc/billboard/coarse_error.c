/* SPDX-License-Identifier: GPL-3.0-or-later */
#include "billboard/coarse_error.h"

#include <math.h>
#include <string.h>

/* Error of what is interpolated, over the tolerance: relative to the pixel's own value and, where it is darker, to the
 * mean of what is seen of the smoke. */
static const float OPACITY_SHARE = 0.2F;
/* Light isn't smooth pixel by pixel either: between samples of light it is interpolated, and bends there. */
static const float LIGHT_SHARE = 0.4F;
/* Of a wave of w radians from point to point, splines of the fifth degree lose 2 / (1 + (2 pi / w - 1)^6) at most. Its
 * twelfth difference, (2 sin(w / 2))^12, over 16384 is that, for w from 1 to 2.5 within a factor of 1.6; waves come
 * together. */
static const float ERROR_PER_DIFFERENCE = 2.0F / 16384.0F;

/* Means of the channels where smoke is seen, weighted with its opacity. */
int32_t fum_coarse_find_means(fum_context *context, int32_t count, fum_coarse_plane *planes) {
  const int32_t columns = planes[0].spline.columns, rows = planes[0].spline.rows;
  const float *alphas = planes[0].spline.values;
  double *sums = NULL; /* of each row, so that they don't depend on the threads */
  const int32_t status = fum_alloc(context, rows, 5 * sizeof *sums, "picture of smooth smoke", &sums);
  for (int32_t k = 0; k < count && status == FUM_OK; k++) {
    fum_coarse_plane *of = &planes[k];
    const int32_t channels = of->spline.channels;
#pragma omp parallel for num_threads(fum_thread_count(context)) schedule(static)
    for (int32_t y = 0; y < rows; y++) {
      double row[5] = {0.0};
      for (int32_t x = 0; x < columns; x++) {
        const int64_t at = (int64_t)y * columns + x;
        const float alpha = alphas[4 * at + 3];
        for (int32_t c = 0; c < channels; c++)
          row[c] += (double)(alpha * of->spline.values[at * channels + c]);
        row[4] += (double)alpha;
      }
      memcpy(sums + 5 * y, row, sizeof row);
    }
    double total[5] = {0.0};
    for (int32_t i = 0; i < 5 * rows; i++)
      total[i % 5] += sums[i];
    for (int32_t c = 0; c < channels; c++)
      of->means[c] = total[4] > 0.0 ? (float)(total[c] / total[4]) : 0.0F;
  }
  fum_free(context, &sums);
  return status;
}

/* The twelfth difference of values `stride` apart. */
static inline float twelfth_difference(const float *at, int64_t stride) {
  const float *a = at - FUM_COARSE_AROUND * stride, *b = at + FUM_COARSE_AROUND * stride;
  return fabsf((a[0] + b[0]) - 12.0F * (a[stride] + b[-stride]) + 66.0F * (a[2 * stride] + b[-2 * stride]) -
               220.0F * (a[3 * stride] + b[-3 * stride]) + 495.0F * (a[4 * stride] + b[-4 * stride]) -
               792.0F * (a[5 * stride] + b[-5 * stride]) + 924.0F * at[0]);
}

/* Is more of the plane lost than is allowed, between the points of a rectangle? */
bool fum_coarse_is_rough(const fum_coarse_plane *p, float tolerance, const int32_t x[2], const int32_t y[2]) {
  enum { MOST = 4 * FUM_COARSE_MOST };
  const int32_t channels = p->spline.channels, count = (x[1] - x[0] + 1) * channels;
  const int64_t row = (int64_t)p->spline.columns * channels;
  float shares[MOST], allowed[MOST];
  int32_t rough = 0;
  for (int32_t i = 0; i < count; i++) {
    shares[i] = (i % channels == 3 ? OPACITY_SHARE : LIGHT_SHARE) * tolerance / ERROR_PER_DIFFERENCE;
    allowed[i] = shares[i] * p->means[i % channels] + 1e-30F;
  }
  for (int32_t j = y[0]; j <= y[1]; j++) {
    const float *at = p->spline.values + j * row + (int64_t)x[0] * channels;
    for (int32_t i = 0; i < count; i++) {
      const float lost = twelfth_difference(at + i, channels) + twelfth_difference(at + i, row);
      rough |= lost > allowed[i] + shares[i] * at[i];
    }
  }
  return rough != 0;
}
