/* SPDX-License-Identifier: GPL-3.0-or-later */
/* Vectors of floats in the compiler's portable vector extension. The files that include this are compiled once for each
 * instruction set, with FUM_LANES set to its width; base/cpu.h says at run time which one to call. */
#ifndef FUM_BASE_SIMD_H
#define FUM_BASE_SIMD_H

#include <stdint.h>
#include <string.h>

#ifndef FUM_LANES
#define FUM_LANES 4
#endif

typedef float fum_vf __attribute__((vector_size(4 * FUM_LANES)));
typedef int32_t fum_vi __attribute__((vector_size(4 * FUM_LANES)));
typedef uint32_t fum_vu __attribute__((vector_size(4 * FUM_LANES))); /* wraps around without undefined behaviour */

static inline fum_vf fum_vf_set(float value) {
  return value - (fum_vf){0};
}

static inline fum_vf fum_vf_load(const float *values) {
  fum_vf v;
  memcpy(&v, values, sizeof v);
  return v;
}

static inline void fum_vf_store(float *values, fum_vf v) {
  memcpy(values, &v, sizeof v);
}

static inline float fum_vf_sum(fum_vf v) {
  float sum = 0.0F;
  for (int lane = 0; lane < FUM_LANES; lane++)
    sum += v[lane];
  return sum;
}

static inline fum_vf fum_vf_select(fum_vi mask, fum_vf yes, fum_vf no) {
  return (fum_vf)((mask & (fum_vi)yes) | (~mask & (fum_vi)no));
}

static inline fum_vf fum_vf_abs(fum_vf v) {
  return (fum_vf)((fum_vi)v & 0x7fffffff);
}

/* 2^x for x <= 0 within 2e-7 relative; 0 below -126. Rounding by a large constant leaves the integer in the low bits;
 * the polynomial is 2^f on [-1/2, 1/2] (Chebyshev fit). */
static inline fum_vf fum_vf_exp2(fum_vf x) {
  const float magic = 12582912.0F; /* 1.5 * 2^23 */
  const fum_vi is_zero = x < -126.0F;
  const fum_vf rounded = x + magic;
  const fum_vf f = x - (rounded - magic);
  fum_vf p = 1.5403530e-4F * f + 1.3398874e-3F;
  p = p * f + 9.6184370e-3F;
  p = p * f + 5.5503324e-2F;
  p = p * f + 2.4022651e-1F;
  p = p * f + 6.9314720e-1F;
  p = p * f + 1.0F;
  const fum_vu exponent = (fum_vu)rounded << 23;
  return (fum_vf)(((fum_vu)p + exponent) & ~(fum_vu)is_zero);
}

/* erfc(z / sqrt 2) / 2, the upper tail of the normal distribution, for z >= 0 within 3e-7 relative where it matters.
 * Rational Chebyshev form of erfc in t = 1 / (1 + x / 2), as in Numerical Recipes (Press and others), erfcc. */
static inline fum_vf fum_vf_normal_tail(fum_vf z) {
  const fum_vf x = z * 0.70710678F;
  const fum_vf t = 1.0F / (1.0F + 0.5F * x);
  fum_vf p = 0.17087277F * t - 0.82215223F;
  p = p * t + 1.48851587F;
  p = p * t - 1.13520398F;
  p = p * t + 0.27886807F;
  p = p * t - 0.18628806F;
  p = p * t + 0.09678418F;
  p = p * t + 0.37409196F;
  p = p * t + 1.00002368F;
  p = p * t - 1.26551223F;
  return 0.5F * t * fum_vf_exp2((p - x * x) * 1.44269504F);
}

/* Phi(b) - Phi(a) for a <= b, without cancellation in the tails. */
static inline fum_vf fum_vf_normal_interval(fum_vf a, fum_vf b) {
  const fum_vf tail_a = fum_vf_normal_tail(fum_vf_abs(a)), tail_b = fum_vf_normal_tail(fum_vf_abs(b));
  const fum_vi right = a > 0.0F, left = b < 0.0F;
  const fum_vf across = 1.0F - tail_a - tail_b;
  return fum_vf_select(right, tail_a - tail_b, fum_vf_select(left, tail_b - tail_a, across));
}

#endif
