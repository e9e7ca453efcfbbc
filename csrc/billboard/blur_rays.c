/* SPDX-License-Identifier: GPL-3.0-or-later */
#include "billboard/blur_rays.h"

#include "base/cpu.h"
#include "base/vector.h"

float fum_blur_sum_plain(const fum_blur_particles *particles, const fum_blur_ray *ray);
float fum_blur_sum_avx2(const fum_blur_particles *particles, const fum_blur_ray *ray);
float fum_blur_sum_avx512(const fum_blur_particles *particles, const fum_blur_ray *ray);

fum_blur_sum_fn fum_blur_sum_get(void) {
  return FUM_CPU_CHOOSE(fum_blur_sum_plain, fum_blur_sum_avx2, fum_blur_sum_avx512);
}

double fum_radical_inverse(uint32_t base, uint32_t index) {
  double inverse = 0.0, digit = 1.0;
  for (; index > 0; index /= base) {
    digit /= (double)base;
    inverse += digit * (double)(index % base);
  }
  return inverse;
}

/* A point of the unit square on the disc, areas kept (Shirley and Chiu 1997, "A low distortion map between disk and
 * square"). */
static void to_disc(double a, double b, double out[2]) {
  const double x = 2.0 * a - 1.0, y = 2.0 * b - 1.0;
  const bool is_wide = fabs(x) > fabs(y);
  const double radius = is_wide ? x : y, ratio = radius != 0.0 ? (is_wide ? y : x) / radius : 0.0;
  const double angle = is_wide ? 0.25 * FUM_PI * ratio : 0.5 * FUM_PI - 0.25 * FUM_PI * ratio;
  out[0] = radius * cos(angle);
  out[1] = radius * sin(angle);
}

fum_blur_instant fum_blur_find_instant(int32_t pictures, int32_t picture, const double within[3]) {
  const int32_t cells = pictures == 16 ? 4 : pictures == 4 ? 2 : 1; /* of the aperture, a side */
  const int32_t cell = picture * 7 % pictures;                      /* 7 has no divisor in common with them */
  const double a = ((double)(cell % cells) + within[1]) / cells, b = ((double)(cell / cells) + within[2]) / cells;
  fum_blur_instant i = {.time = ((double)picture + within[0]) / pictures};
  to_disc(a, b, i.lens);
  return i;
}
