/* SPDX-License-Identifier: GPL-3.0-or-later */
/* Vectors of floats in the compiler's portable vector extension. The files that include this are compiled once for each
 * instruction set, with FUM_LANES set to its width; base/cpu.h says at run time which one to call. */
#ifndef FUM_BASE_SIMD_H
#define FUM_BASE_SIMD_H

#include <stdint.h>
#include <string.h>

#if defined(__x86_64__)
#include <immintrin.h>
#endif

#ifndef FUM_LANES
#define FUM_LANES 4
#endif

typedef float fum_vf __attribute__((vector_size(4 * FUM_LANES)));
typedef int32_t fum_vi __attribute__((vector_size(4 * FUM_LANES)));
typedef uint32_t fum_vu __attribute__((vector_size(4 * FUM_LANES))); /* wraps around without undefined behaviour */

typedef float fum_quad __attribute__((vector_size(16)));

/* Writes past the caches what won't be read soon, to an address that is a multiple of 16. Other threads see it once
 * fum_quad_stream_end was called. */
static inline void fum_quad_stream(void *out, fum_quad v) {
#if defined(__x86_64__)
  _mm_stream_ps(out, (__m128)v);
#else
  memcpy(out, &v, sizeof v);
#endif
}

static inline void fum_quad_stream_end(void) {
#if defined(__x86_64__)
  _mm_sfence();
#endif
}

/* rows[i][k] becomes rows[k][i]. */
static inline void fum_quad_transpose(fum_quad rows[4]) {
  const fum_quad a = __builtin_shufflevector(rows[0], rows[1], 0, 4, 1, 5);
  const fum_quad b = __builtin_shufflevector(rows[0], rows[1], 2, 6, 3, 7);
  const fum_quad c = __builtin_shufflevector(rows[2], rows[3], 0, 4, 1, 5);
  const fum_quad d = __builtin_shufflevector(rows[2], rows[3], 2, 6, 3, 7);
  rows[0] = __builtin_shufflevector(a, c, 0, 1, 4, 5);
  rows[1] = __builtin_shufflevector(a, c, 2, 3, 6, 7);
  rows[2] = __builtin_shufflevector(b, d, 0, 1, 4, 5);
  rows[3] = __builtin_shufflevector(b, d, 2, 3, 6, 7);
}

/* Adds a b[0], a b[1], a b[2] and last b[3], one behind the other, to `sums`, which are aligned to 64 bytes. */
static inline void fum_quad_add_outer(fum_quad a, fum_quad last, fum_quad b, float sums[16]) {
#if defined(__AVX512F__)
  const __m512i each = _mm512_setr_epi32(0, 0, 0, 0, 1, 1, 1, 1, 2, 2, 2, 2, 3, 3, 3, 3);
  const __m512 all = _mm512_insertf32x4(_mm512_broadcast_f32x4((__m128)a), (__m128)last, 3);
  const __m512 weights = _mm512_permutexvar_ps(each, _mm512_castps128_ps512((__m128)b));
  _mm512_store_ps(sums, _mm512_fmadd_ps(all, weights, _mm512_load_ps(sums)));
#else
  for (int k = 0; k < 4; k++) {
    fum_quad sum;
    memcpy(&sum, sums + 4 * k, sizeof sum);
    sum += (k < 3 ? a : last) * b[k];
    memcpy(sums + 4 * k, &sum, sizeof sum);
  }
#endif
}

/* Four numbers that add up to the sum over i, j and k of x[i] y[FUM_LANES j] z[k] rows[j][4 i + k]. */
static inline fum_quad fum_quad_contract(fum_quad x, const float *y, fum_quad z, const float *const rows[4]) {
  typedef float quads __attribute__((vector_size(64)));
  quads values[4];
  for (int j = 0; j < 4; j++)
    memcpy(&values[j], rows[j], sizeof *values);
  quads sum =
      (y[0] * values[0] + y[FUM_LANES] * values[1]) + (y[2 * FUM_LANES] * values[2] + y[3 * FUM_LANES] * values[3]);
#if defined(__AVX512F__) /* compilers widen quads on ways through memory */
  const __m512i each = _mm512_setr_epi32(0, 0, 0, 0, 1, 1, 1, 1, 2, 2, 2, 2, 3, 3, 3, 3);
  sum *=
      (quads)_mm512_permutexvar_ps(each, _mm512_castps128_ps512((__m128)x)) * (quads)_mm512_broadcast_f32x4((__m128)z);
#else
  sum *= __builtin_shufflevector(x, x, 0, 0, 0, 0, 1, 1, 1, 1, 2, 2, 2, 2, 3, 3, 3, 3) *
         __builtin_shufflevector(z, z, 0, 1, 2, 3, 0, 1, 2, 3, 0, 1, 2, 3, 0, 1, 2, 3);
#endif
  return (__builtin_shufflevector(sum, sum, 0, 1, 2, 3) + __builtin_shufflevector(sum, sum, 8, 9, 10, 11)) +
         (__builtin_shufflevector(sum, sum, 4, 5, 6, 7) + __builtin_shufflevector(sum, sum, 12, 13, 14, 15));
}

/* From four vectors to a quad for each lane. */
static inline void fum_quads_from(const fum_vf rows[4], fum_quad out[FUM_LANES]) {
  float values[4][FUM_LANES];
  for (int r = 0; r < 4; r++)
    memcpy(values[r], &rows[r], sizeof values[r]);
  for (int k = 0; k < FUM_LANES; k += 4) {
    for (int r = 0; r < 4; r++)
      memcpy(&out[k + r], values[r] + k, sizeof *out);
    fum_quad_transpose(out + k);
  }
}

/* The sum of each of FUM_LANES quads, which are lost. */
static inline fum_vf fum_quads_sum(fum_quad quads[FUM_LANES]) {
  float sums[FUM_LANES];
  for (int k = 0; k < FUM_LANES; k += 4) {
    fum_quad_transpose(quads + k);
    const fum_quad sum = (quads[k] + quads[k + 1]) + (quads[k + 2] + quads[k + 3]);
    memcpy(sums + k, &sum, sizeof sum);
  }
  fum_vf all;
  memcpy(&all, sums, sizeof all);
  return all;
}

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

static inline fum_vi fum_vi_load(const int32_t *values) {
  fum_vi v;
  memcpy(&v, values, sizeof v);
  return v;
}

/* values[indices[i]] */
static inline fum_vf fum_vf_gather(const float *values, fum_vi indices) {
#if defined(__AVX512F__) && FUM_LANES == 16
  return (fum_vf)_mm512_i32gather_ps((__m512i)indices, values, 4);
#elif defined(__AVX2__) && FUM_LANES == 8
  return (fum_vf)_mm256_i32gather_ps(values, (__m256i)indices, 4);
#else
  fum_vf gathered;
  for (int lane = 0; lane < FUM_LANES; lane++)
    gathered[lane] = values[indices[lane]];
  return gathered;
#endif
}

/* Halves are added to each other: in order, each addition would wait for the one before. */
static inline float fum_vf_sum(fum_vf v) {
#if FUM_LANES == 16
  const __m256 eight = _mm512_castps512_ps256((__m512)v) + _mm512_extractf32x8_ps((__m512)v, 1);
  const fum_quad four = (fum_quad)(_mm256_castps256_ps128(eight) + _mm256_extractf128_ps(eight, 1));
#elif FUM_LANES == 8
  const fum_quad four = (fum_quad)(_mm256_castps256_ps128((__m256)v) + _mm256_extractf128_ps((__m256)v, 1));
#else
  const fum_quad four = v;
#endif
  return (four[0] + four[2]) + (four[1] + four[3]);
}

static inline fum_vf fum_vf_select(fum_vi mask, fum_vf yes, fum_vf no) {
  return (fum_vf)((mask & (fum_vi)yes) | (~mask & (fum_vi)no));
}

/* Bit i is set where entry i is true. */
static inline uint32_t fum_vi_bits(fum_vi mask) {
#if defined(__AVX512DQ__) && FUM_LANES == 16
  return (uint32_t)_mm512_movepi32_mask((__m512i)mask);
#elif defined(__AVX2__) && FUM_LANES == 8
  return (uint32_t)_mm256_movemask_ps((__m256)mask);
#elif defined(__x86_64__) && FUM_LANES == 4
  return (uint32_t)_mm_movemask_ps((__m128)mask);
#else
  uint32_t bits = 0;
  for (int lane = 0; lane < FUM_LANES; lane++)
    bits |= (uint32_t)(mask[lane] & 1) << lane;
  return bits;
#endif
}

static inline fum_vf fum_vf_min(fum_vf a, fum_vf b) {
  return fum_vf_select(a < b, a, b);
}

static inline fum_vf fum_vf_max(fum_vf a, fum_vf b) {
  return fum_vf_select(a > b, a, b);
}

static inline fum_vf fum_vf_at_least(fum_vf v, float least) {
#if defined(__AVX512F__) && FUM_LANES == 16
  return (fum_vf)_mm512_max_ps((__m512)v, _mm512_set1_ps(least));
#elif defined(__AVX2__) && FUM_LANES == 8
  return (fum_vf)_mm256_max_ps((__m256)v, _mm256_set1_ps(least));
#elif defined(__x86_64__) && FUM_LANES == 4
  return (fum_vf)_mm_max_ps((__m128)v, _mm_set1_ps(least));
#else
  return fum_vf_select(v > least, v, fum_vf_set(least));
#endif
}

/* The entries whose bits are set, moved to the front; what is behind them doesn't matter. */
static inline fum_vf fum_vf_pack(fum_vf v, uint32_t bits) {
#if defined(__AVX512F__) && FUM_LANES == 16
  return (fum_vf)_mm512_maskz_compress_ps((__mmask16)bits, (__m512)v);
#else
  float values[FUM_LANES], packed[FUM_LANES];
  fum_vf_store(values, v);
  fum_vf_store(packed, v);
  for (int to = 0; bits != 0; bits &= bits - 1)
    packed[to++] = values[__builtin_ctz(bits)];
  return fum_vf_load(packed);
#endif
}

static inline fum_vf fum_vf_abs(fum_vf v) {
  return (fum_vf)((fum_vi)v & 0x7fffffff);
}

static inline fum_vf fum_vf_sqrt(fum_vf v) {
#if defined(__AVX512F__) && FUM_LANES == 16
  return (fum_vf)_mm512_sqrt_ps((__m512)v);
#elif defined(__AVX2__) && FUM_LANES == 8
  return (fum_vf)_mm256_sqrt_ps((__m256)v);
#elif defined(__x86_64__) && FUM_LANES == 4
  return (fum_vf)_mm_sqrt_ps((__m128)v);
#else
  fum_vf roots;
  for (int lane = 0; lane < FUM_LANES; lane++)
    roots[lane] = __builtin_sqrtf(v[lane]);
  return roots;
#endif
}

/* exp(-z^2 / 2) is 2^(-this z^2). */
static const float FUM_HALF_LOG2_E = 0.72134752F;

/* 2^x for x <= 0 within 2e-7 relative; 0 below `least`, which is -126 or more. Rounding by a large constant leaves the
 * integer in the low bits; the polynomial is 2^f on [-1/2, 1/2] (Chebyshev fit). */
static inline fum_vf fum_vf_exp2_from(float least, fum_vf x) {
  const float magic = 12582912.0F; /* 1.5 * 2^23 */
  const fum_vi is_zero = x < least;
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

static inline fum_vf fum_vf_exp2(fum_vf x) {
  return fum_vf_exp2_from(-126.0F, x);
}

/* Natural logarithm of normal numbers above 0, within 2e-7 absolute, or relative where it is above 1. x is 2^e (1 + f),
 * with 1 + f from the root of 1/2 to that of 2; the polynomial is logf's of Moshier, Cephes. */
static inline fum_vf fum_vf_log(fum_vf x) {
  const fum_vi exponent = ((fum_vi)x - 0x3f3504f3) >> 23;
  const fum_vf f = (fum_vf)((fum_vi)x - (exponent << 23)) - 1.0F, e = __builtin_convertvector(exponent, fum_vf);
  const fum_vf squared = f * f;
  fum_vf p = 7.0376836292e-2F * f - 1.1514610310e-1F;
  p = p * f + 1.1676998740e-1F;
  p = p * f - 1.2420140846e-1F;
  p = p * f + 1.4249322787e-1F;
  p = p * f - 1.6668057665e-1F;
  p = p * f + 2.0000714765e-1F;
  p = p * f - 2.4999993993e-1F;
  p = p * f + 3.3333331174e-1F;
  const fum_vf low = f * squared * p - 2.12194440e-4F * e - 0.5F * squared;
  return f + low + 0.693359375F * e;
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

/* Vectors of doubles, half as many lanes. */
enum { FUM_DOUBLE_LANES = FUM_LANES / 2 };

typedef double fum_vd __attribute__((vector_size(4 * FUM_LANES)));
typedef int64_t fum_vl __attribute__((vector_size(4 * FUM_LANES)));

static inline fum_vd fum_vd_set(double value) {
  return value - (fum_vd){0};
}

static inline fum_vd fum_vd_load(const double *values) {
  fum_vd v;
  memcpy(&v, values, sizeof v);
  return v;
}

static inline fum_vd fum_vd_load_floats(const float *values) {
  typedef float narrow __attribute__((vector_size(2 * FUM_LANES)));
  narrow v;
  memcpy(&v, values, sizeof v);
  return __builtin_convertvector(v, fum_vd);
}

static inline void fum_vd_store_floats(float *values, fum_vd v) {
  typedef float narrow __attribute__((vector_size(2 * FUM_LANES)));
  const narrow floats = __builtin_convertvector(v, narrow);
  memcpy(values, &floats, sizeof floats);
}

static inline double fum_vd_sum(fum_vd v) {
  double sum = 0.0;
  for (int lane = 0; lane < FUM_DOUBLE_LANES; lane++)
    sum += v[lane];
  return sum;
}

static inline fum_vd fum_vd_select(fum_vl mask, fum_vd yes, fum_vd no) {
  return (fum_vd)((mask & (fum_vl)yes) | (~mask & (fum_vl)no));
}

/* Bit i is set where entry i is true. */
static inline uint32_t fum_vl_bits(fum_vl mask) {
#if defined(__AVX512DQ__) && FUM_LANES == 16
  return (uint32_t)_mm512_movepi64_mask((__m512i)mask);
#elif defined(__AVX2__) && FUM_LANES == 8
  return (uint32_t)_mm256_movemask_pd((__m256d)mask);
#elif defined(__x86_64__) && FUM_LANES == 4
  return (uint32_t)_mm_movemask_pd((__m128d)mask);
#else
  uint32_t bits = 0;
  for (int lane = 0; lane < FUM_DOUBLE_LANES; lane++)
    bits |= (uint32_t)(mask[lane] & 1) << lane;
  return bits;
#endif
}

static inline fum_vd fum_vd_abs(fum_vd v) {
  return (fum_vd)((fum_vl)v & INT64_MAX);
}

/* sum of coefficients[i] x^i */
static inline fum_vd fum_vd_polynomial(const double *coefficients, int count, fum_vd x) {
  fum_vd sum = fum_vd_set(coefficients[count - 1]);
#pragma GCC unroll 32
  for (int i = count - 2; i >= 0; i--)
    sum = sum * x + coefficients[i];
  return sum;
}

/* e^x for x <= 0 within 1e-13 relative; 0 below -708. As fum_vf_exp2. */
static inline fum_vd fum_vd_exp(fum_vd x) {
  static const double coefficients[10] = {1.0000000000000135,     0.69314718055994998,   0.240226506956403,
                                          0.05550410866444768,    0.0096181291939421675, 0.0013333558230170627,
                                          0.00015403433746224196, 1.5252657257186042e-5, 1.325964625027045e-6,
                                          1.0208690835930371e-7};
  typedef uint64_t bits __attribute__((vector_size(4 * FUM_LANES)));
  const double magic = 6755399441055744.0; /* 1.5 * 2^52 */
  const fum_vl is_zero = x < -708.0;
  const fum_vd scaled = x * 1.4426950408889634;
  const fum_vd rounded = scaled + magic;
  const fum_vd p = fum_vd_polynomial(coefficients, 10, scaled - (rounded - magic));
  return (fum_vd)(((bits)p + ((bits)rounded << 52)) & ~(bits)is_zero);
}

/* erfc(z / sqrt 2) / 2, the upper tail of the normal distribution, for z >= 0 within 1e-12 relative: erfc(x) is
 * t exp(-x^2 + P(2 t - 1)) with t = 2 / (2 + x) (Chebyshev fit). */
static inline fum_vd fum_vd_normal_tail(fum_vd z) {
  static const double coefficients[20] = {
      -0.67179408405700333,    0.67264322398018864,    0.047343306903951094,   -0.046895610419282323,
      -0.0098726914059102578,  0.0088249426843899561,  0.0017589595095939519,  -0.0023458541746151143,
      -0.00014641398873181324, 0.00067391122646920421, -9.3120652135823682e-5, -0.0001750876339915449,
      7.004280095859738e-5,    3.342285369413773e-5,   -2.8380892765328893e-5, -2.164352692287398e-6,
      7.2226048080973408e-6,   -9.569063754683688e-7,  -9.0256539995308732e-7, 2.3448464321650952e-7};
  const fum_vd x = z * 0.70710678118654752;
  const fum_vd t = 2.0 / (2.0 + x);
  return 0.5 * t * fum_vd_exp(fum_vd_polynomial(coefficients, 20, 2.0 * t - 1.0) - x * x);
}

#endif
