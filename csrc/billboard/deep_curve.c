/* SPDX-License-Identifier: GPL-3.0-or-later */
#include "billboard/deep_curve.h"

#include "base/simd.h"
#include "base/vector.h"

#include <math.h>
#include <string.h>

enum { SUMS = FUM_DEEP_SUMS, ROWS = SUMS + 2 };

/* Behind this optical depth nothing is seen. */
static const float DARK = 12.0F;

/* Whole vectors are read at its end. */
static int64_t padded(int64_t points) {
  return points + FUM_LANES;
}

int64_t fum_deep_curve_size(int64_t points) {
  return ROWS * padded(points);
}

void fum_deep_curve_place(float *memory, int64_t points, fum_deep_curve *out_curve) {
  *out_curve = (fum_deep_curve){.depth = memory, .transmittance = memory + padded(points)};
  for (int k = 0; k < SUMS; k++)
    out_curve->sums[k] = memory + (2 + k) * padded(points);
}

void fum_deep_curve_add(fum_deep_curve *curve, float depth, const float sums[SUMS]) {
  const int32_t i = curve->count;
  if (i > 0 && !(depth > curve->depth[i - 1])) return;
  curve->depth[i] = depth;
  for (int k = 0; k < SUMS; k++)
    curve->sums[k][i] = i > 0 ? fum_max(sums[k], curve->sums[k][i - 1]) : sums[k]; /* whatever rounding does */
  curve->count++;
}

static void get_sums(const fum_deep_curve *curve, int32_t i, float out[SUMS]) {
  for (int k = 0; k < SUMS; k++)
    out[k] = curve->sums[k][i];
}

/* Is there no smoke from this point to the next? */
static bool is_empty(const fum_deep_curve *curve, int32_t from) {
  bool is_same = true;
  for (int k = 0; k < SUMS; k++)
    is_same = is_same && !(curve->sums[k][from + 1] > curve->sums[k][from]);
  return is_same;
}

/* ---- Interpolation ---------------------------------------------------------------------------------------------- */

/* Slope at the end of the interval of length `here` whose mean slope is `slope`: that of the parabola through it and
 * the next interval. */
static float end_slope(float here, float slope, float next, float next_slope) {
  const float bent = slope + (slope - next_slope) * here / (here + next);
  return fum_min(fum_max(bent, 0.0F), 2.0F * slope);
}

/* M. Steffen, A simple method for monotonic interpolation in one dimension, Astronomy and Astrophysics 239 (1990). */
static float slope_at(const fum_deep_curve *knots, int32_t i, const float *sums) {
  const float *x = knots->depth;
  const int32_t last = knots->count - 1;
  if (last == 1) return (sums[1] - sums[0]) / (x[1] - x[0]);
  const int32_t a = i == 0 ? 0 : i == last ? last - 2 : i - 1;
  const float first = x[a + 1] - x[a], second = x[a + 2] - x[a + 1];
  const float before = (sums[a + 1] - sums[a]) / first, behind = (sums[a + 2] - sums[a + 1]) / second;
  if (i == 0) return end_slope(first, before, second, behind);
  if (i == last) return end_slope(second, behind, first, before);
  const float parabola = (before * second + behind * first) / (first + second);
  return fum_min(2.0F * fum_min(before, behind), parabola);
}

/* Points inside of the interval that begins at knot i, of Hermite's cubic with the slopes at its ends. */
static void fill_interval(const fum_deep_curve *knots, int32_t i, const float *slopes, const float *next,
                          fum_deep_curve *out) {
  const float begin = knots->depth[i], end = knots->depth[i + 1], length = end - begin;
  for (int step = 1; step < FUM_DEEP_STEPS; step++) {
    const float s = (float)step / (float)FUM_DEEP_STEPS, r = 1.0F - s, depth = begin + s * length;
    float sums[SUMS];
    for (int k = 0; k < SUMS; k++) {
      const float low = knots->sums[k][i], high = knots->sums[k][i + 1];
      const float value = r * r * (1.0F + 2.0F * s) * low + s * s * (1.0F + 2.0F * r) * high +
                          s * r * length * (r * slopes[k] - s * next[k]);
      sums[k] = fum_min(value, high);
    }
    if (depth < end) fum_deep_curve_add(out, depth, sums);
  }
}

void fum_deep_bend(const fum_deep_curve *knots, fum_deep_curve *out) {
  float slopes[SUMS] = {0}, next[SUMS] = {0}, sums[SUMS];
  for (int32_t i = 0; i < knots->count; i++) {
    for (int k = 0; k < SUMS && knots->count > 1; k++)
      next[k] = slope_at(knots, i, knots->sums[k]);
    if (i > 0 && !is_empty(knots, i - 1)) fill_interval(knots, i - 1, slopes, next, out);
    get_sums(knots, i, sums);
    fum_deep_curve_add(out, knots->depth[i], sums);
    memcpy(slopes, next, sizeof slopes);
  }
}

/* ---- Mixture ---------------------------------------------------------------------------------------------------- */

/* Sums at a depth; `at` is the first point that isn't in front of it, and is moved on. */
static void look_up(const fum_deep_curve *curve, float depth, int32_t *at, float out[SUMS]) {
  const float *x = curve->depth;
  while (*at < curve->count && x[*at] < depth)
    ++*at;
  memset(out, 0, SUMS * sizeof *out);
  if (curve->count == 0 || (*at == 0 && x[0] > depth)) return;
  const int32_t behind = *at < curve->count ? *at : curve->count - 1;
  const int32_t before = *at > 0 && *at < curve->count ? behind - 1 : behind;
  const float share = before < behind ? (depth - x[before]) / (x[behind] - x[before]) : 1.0F;
  for (int k = 0; k < SUMS; k++)
    out[k] = curve->sums[k][before] + share * (curve->sums[k][behind] - curve->sums[k][before]);
}

void fum_deep_mix(int32_t count, const fum_deep_curve *curves, const fum_deep_share *shares, fum_deep_curve *out) {
  const float darkest = 16.0F;
  int32_t next[FUM_DEEP_MIXED] = {0}, at[FUM_DEEP_MIXED] = {0};
  for (;;) {
    float depth = INFINITY, opacity = 0.0F, of[SUMS], sums[SUMS] = {0};
    for (int32_t i = 0; i < count; i++) {
      while (next[i] < curves[i].count && out->count > 0 && !(curves[i].depth[next[i]] > out->depth[out->count - 1]))
        next[i]++;
      if (next[i] < curves[i].count) depth = fum_min(depth, curves[i].depth[next[i]]);
    }
    if (!(depth < INFINITY)) return;
    for (int32_t i = 0; i < count; i++) {
      look_up(&curves[i], depth, &at[i], of);
      opacity -= shares[i].opacity * expm1f(-of[0]);
      for (int k = 1; k < SUMS; k++)
        sums[k] += shares[i].rgb[k - 1] * of[k];
    }
    sums[0] = fum_min(-log1pf(-fum_min(opacity, 1.0F)), darkest);
    fum_deep_curve_add(out, depth, sums);
  }
}

void fum_deep_unfold(const fum_deep_sample *samples, int32_t count, fum_deep_curve *out) {
  float before[SUMS] = {0}, sums[SUMS];
  for (int32_t i = 0; i < count; i++) {
    const fum_deep_sample *s = &samples[i];
    const float rise = -log1pf(-s->rgba[3]), seen = expf(-before[0]);
    fum_deep_curve_add(out, s->depth, before);
    for (int step = 1; step <= FUM_DEEP_STEPS; step++) {
      const float share = (float)step / (float)FUM_DEEP_STEPS;
      const float colored = s->rgba[3] > 0.0F ? -expm1f(-share * rise) / s->rgba[3] : share;
      sums[0] = before[0] + share * rise;
      for (int k = 1; k < SUMS; k++)
        sums[k] = before[k] + seen * colored * s->rgba[k - 1];
      fum_deep_curve_add(out, step < FUM_DEEP_STEPS ? s->depth + share * (s->depth_back - s->depth) : s->depth_back,
                         sums);
    }
    memcpy(before, sums, sizeof before);
  }
}

/* ---- Samples ---------------------------------------------------------------------------------------------------- */

/* What is asked of a curve's samples. */
typedef struct bounds {
  float transmittance, radiance;
} bounds;

static bounds find_bounds(const fum_deep_curve *curve, const fum_deep_limits *limits) {
  const float thin = 0.25F;
  float sums[SUMS];
  get_sums(curve, curve->count - 1, sums);
  const float brightest = fum_max(sums[1], fum_max(sums[2], sums[3]));
  const float opacity = -expm1f(-sums[0]), counted = fum_max(opacity, thin);
  const float thinned = limits->is_scattered ? counted / fum_max(opacity, 1e-20F) : 1.0F;
  return (bounds){limits->error * counted, limits->error * brightest * thinned};
}

/* A sample from one point of a curve to another. */
typedef struct span {
  float depth, per_metre, rise, transmittance, per_opacity;
  bool is_thin;
} span;

static span find_span(const fum_deep_curve *curve, int32_t from, int32_t to) {
  const float rise = curve->sums[0][to] - curve->sums[0][from], thin = 0.02F;
  return (span){.depth = curve->depth[from],
                .per_metre = 1.0F / (curve->depth[to] - curve->depth[from]),
                .rise = rise,
                .transmittance = curve->transmittance[from],
                .per_opacity = rise > thin ? -1.0F / expm1f(-rise) : 0.0F,
                .is_thin = rise <= thin};
}

/* Opacity of the part of a span up to a share of its length, and its share of the whole opacity; to second order in
 * thin ones. */
static fum_vf opacity_of(const span *s, fum_vf share, fum_vf *out_colored) {
  if (s->is_thin) {
    *out_colored = share * (1.0F + (0.5F * s->rise) * (1.0F - share));
    return share * s->rise * (1.0F - (0.5F * s->rise) * share);
  }
  const fum_vf opacity = 1.0F - fum_vf_exp2(share * (s->rise * -1.44269504F));
  *out_colored = opacity * s->per_opacity;
  return opacity;
}

/* Is one sample good enough at all points between? */
static bool suffices(const fum_deep_curve *curve, const bounds *most, int32_t from, int32_t to) {
  const span s = find_span(curve, from, to);
  float starts[SUMS], rises[SUMS];
  fum_vi lanes;
  for (int lane = 0; lane < FUM_LANES; lane++)
    lanes[lane] = lane;
  for (int k = 1; k < SUMS; k++) {
    starts[k] = curve->sums[k][from];
    rises[k] = curve->sums[k][to] - starts[k];
  }
  for (int32_t i = from + 1; i < to; i += FUM_LANES) {
    const fum_vf share = (fum_vf_load(curve->depth + i) - s.depth) * s.per_metre;
    fum_vf colored;
    const fum_vf opacity = opacity_of(&s, share, &colored);
    const fum_vf left = s.transmittance - s.transmittance * opacity;
    fum_vi is_off = fum_vf_abs(left - fum_vf_load(curve->transmittance + i)) > most->transmittance;
    for (int k = 1; k < SUMS; k++) {
      const fum_vf value = starts[k] + colored * rises[k];
      is_off |= fum_vf_abs(value - fum_vf_load(curve->sums[k] + i)) > most->radiance;
    }
    if (fum_vi_bits(is_off & (lanes < to - i)) != 0) return false;
  }
  return true;
}

/* The end of a sample that begins at the point `from`: it is made longer in steps that double, then halve. `guess` is
 * the first. */
static int32_t find_end(const fum_deep_curve *curve, const bounds *most, int32_t from, int32_t end_of_smoke,
                        int32_t guess) {
  int32_t good = from + 1, step = guess;
  while (good < end_of_smoke) {
    const int32_t tried = good + step < end_of_smoke ? good + step : end_of_smoke;
    if (!suffices(curve, most, from, tried)) break;
    good = tried;
    step *= 2;
  }
  for (step /= 2; step > 0 && good < end_of_smoke; step /= 2) {
    const int32_t tried = good + step;
    if (tried <= end_of_smoke && suffices(curve, most, from, tried)) good = tried;
  }
  return good;
}

/* A sample that takes the sums from `before`, those up to the last sample, to `behind`. */
static fum_deep_sample make_sample(float depth, float depth_back, const float before[SUMS], const float behind[SUMS]) {
  const float opaque = 0.99999994F; /* the most that is less than 1, so that a sample can be cut */
  const float seen = expf(before[0]);
  fum_deep_sample sample = {.depth = depth, .depth_back = depth_back};
  sample.rgba[3] = fum_min(-expm1f(before[0] - behind[0]), opaque);
  for (int k = 1; k < SUMS; k++)
    sample.rgba[k - 1] = (behind[k] - before[k]) * seen;
  return sample;
}

/* Does next to nothing of the whole curve lie between this point and the next? Sums grow here and there by rounding. */
static bool is_faint(const fum_deep_curve *curve, const float all[SUMS], int32_t from) {
  const float faint = 1e-6F;
  bool is_less = true;
  for (int k = 0; k < SUMS; k++)
    is_less = is_less && curve->sums[k][from + 1] - curve->sums[k][from] <= faint * all[k];
  return is_less;
}

static int32_t find_end_of_smoke(const fum_deep_curve *curve, const float all[SUMS], int32_t from) {
  int32_t end = from + 1;
  while (end + 1 < curve->count && !is_faint(curve, all, end))
    end++;
  return end;
}

int32_t fum_deep_divide(const fum_deep_curve *curve, const fum_deep_limits *limits, fum_deep_sample *out_samples) {
  const int32_t last = curve->count - 1;
  if (last < 1) return 0;
  for (int32_t i = 0; i <= last; i += FUM_LANES)
    fum_vf_store(curve->transmittance + i, fum_vf_exp2(fum_vf_load(curve->sums[0] + i) * -1.44269504F));
  const bounds most = find_bounds(curve, limits);
  float all[SUMS], before[SUMS] = {0}, behind[SUMS];
  int32_t count = 0, from = 0, end_of_smoke = 0, length = 1;
  get_sums(curve, last, all);
  while (from < last && before[0] < DARK) {
    if (is_faint(curve, all, from)) {
      from++;
      continue;
    }
    if (end_of_smoke <= from) end_of_smoke = find_end_of_smoke(curve, all, from);
    const int32_t to = find_end(curve, &most, from, end_of_smoke, length);
    get_sums(curve, to, behind);
    out_samples[count++] = make_sample(curve->depth[from], curve->depth[to], before, behind);
    memcpy(before, behind, sizeof before);
    length = (to - from + 1) / 2;
    from = to;
  }
  return count;
}
