/* SPDX-License-Identifier: GPL-3.0-or-later */
/* The loops of runs.h, to be compiled once for each instruction set: runs_*.c define FUM_LANES and FUM_RUN_LOOPS_NAME.
 */
#include "base/simd.h"
#include "lighting/runs.h"

static const float SIGMAS_PER_SCALE = 1.17741002F; /* sqrt(2 ln 2): scales to 1 / sigma */

/* 2^x for x <= 0 within 4e-6 relative, at least 1e-38 (Chebyshev fit): enough for sums that are known to 1e-5. */
static inline fum_vf exp2_of(fum_vf x) {
  const float magic = 12582912.0F; /* 1.5 * 2^23 */
  const fum_vf limited = fum_vf_at_least(x, -126.0F), rounded = limited + magic;
  const fum_vf f = limited - (rounded - magic);
  fum_vf p = 9.66636852e-3F * f + 5.59219758e-2F;
  p = p * f + 2.40223490e-1F;
  p = p * f + 6.93121045e-1F;
  p = p * f + 1.0F;
  return (fum_vf)((fum_vu)p + ((fum_vu)rounded << 23));
}

/* The upper tail of the normal distribution for z >= 0 within 9e-6 relative: exp(-z^2 / 2) t P(t), t = 1 / (1 + 0.31 z)
 * (minimax fit up to z = 12). */
static inline fum_vf tail_of(fum_vf z) {
  const fum_vf t = 1.0F / (1.0F + 0.31F * z);
  fum_vf p = -7.39212713e-2F * t + 1.80424328e-1F;
  p = p * t + 1.57779454e-2F;
  p = p * t + 1.33409387e-1F;
  p = p * t + 1.20447257e-1F;
  p = p * t + 1.23860036e-1F;
  return p * t * exp2_of(z * z * -FUM_HALF_LOG2_E);
}

static inline uint64_t lowest(int32_t count) {
  return count < 64 ? ((uint64_t)1 << count) - 1 : ~(uint64_t)0;
}

static uint64_t hear(const fum_beam *beam, const fum_spheres *spheres, uint32_t first, int32_t count) {
  const float far = 1e30F, last = beam->last < far ? beam->last : far;
  uint64_t heard = 0;
  for (int32_t i = 0; i < count; i += FUM_LANES) {
    const uint32_t at = first + (uint32_t)i;
    const fum_vf dx = fum_vf_load(spheres->x + at) - beam->start.x;
    const fum_vf dy = fum_vf_load(spheres->y + at) - beam->start.y;
    const fum_vf dz = fum_vf_load(spheres->z + at) - beam->start.z;
    const fum_vf s = dx * beam->axis.x + dy * beam->axis.y + dz * beam->axis.z;
    const fum_vf px = dx - s * beam->axis.x, py = dy - s * beam->axis.y, pz = dz - s * beam->axis.z;
    const fum_vf reach = fum_vf_load(spheres->hearing + at);
    const fum_vf slack = fabsf(beam->slope) * (reach + beam->radius);
    const fum_vf hearing = reach + fum_vf_at_least(beam->radius + beam->slope * s + slack, 0.0F);
    const fum_vi near = (px * px + py * py + pz * pz <= hearing * hearing * 1.00001F);
    heard |= (uint64_t)fum_vi_bits(near & (s > beam->first - reach) & (s < last + reach)) << i;
  }
  return heard & lowest(count);
}

/* A segment's own axes and, for each run of a batch, where its middle is along them. */
typedef struct seen {
  fum_vec3 direction, right, up; /* unit and perpendicular */
  float length;
  float along[FUM_BATCH_SIZE], across[FUM_BATCH_SIZE], above[FUM_BATCH_SIZE];
} seen;

/* Duff and others 2017, "Building an orthonormal basis, revisited". */
static inline void set_axes(seen *s, const float u[3]) {
  const float sign = copysignf(1.0F, u[2]), a = -1.0F / (sign + u[2]), b = u[0] * u[1] * a;
  s->direction = (fum_vec3){u[0], u[1], u[2]};
  s->right = (fum_vec3){1.0F + sign * u[0] * u[0] * a, sign * b, -sign * u[0]};
  s->up = (fum_vec3){b, sign + u[1] * u[1] * a, -u[1]};
}

static inline fum_vf dot(fum_vec3 axis, fum_vf x, fum_vf y, fum_vf z, fum_vf sum) {
  sum = x * axis.x + sum;
  sum = y * axis.y + sum;
  return z * axis.z + sum;
}

/* Which runs the segment hears, and which of them an end may cut. */
typedef struct heard {
  uint64_t runs, near_start, near_end;
} heard;

static inline heard see(seen *s, const fum_batch *batch, const fum_segment *segment) {
  const float *o = segment->origin, length = s->length;
  const fum_vec3 direction = s->direction, right = s->right, up = s->up;
  heard h = {0};
  for (int32_t i = 0; i < batch->count; i += FUM_LANES) {
    const fum_vf x = fum_vf_load(batch->x + i) - o[0], y = fum_vf_load(batch->y + i) - o[1];
    const fum_vf z = fum_vf_load(batch->z + i) - o[2], zero = {0};
    const fum_vf along = dot(direction, x, y, z, zero);
    const fum_vf across = dot(right, x, y, z, zero), above = dot(up, x, y, z, zero);
    fum_vf_store(s->along + i, along);
    fum_vf_store(s->across + i, across);
    fum_vf_store(s->above + i, above);
    const fum_vf hearing = fum_vf_load(batch->hearing + i), clear = fum_vf_load(batch->clear + i);
    const fum_vf to_end = length - along;
    const fum_vf before = fum_vf_at_least(-along, 0.0F), behind = fum_vf_at_least(-to_end, 0.0F);
    const fum_vf squared = across * across + above * above + before * before + behind * behind;
    h.runs |= (uint64_t)fum_vi_bits(squared <= hearing * hearing) << i;
    h.near_start |= (uint64_t)fum_vi_bits(along < clear) << i;
    h.near_end |= (uint64_t)fum_vi_bits(to_end < clear) << i;
  }
  h.runs &= lowest(batch->count);
  return h;
}

/* Particles of a run, seen from the segment. */
typedef struct particles {
  fum_vf x, y, z, scale, whole; /* whole: optical depth along the segment's line, without ends */
} particles;

static inline particles load(const seen *s, const fum_run *run, int32_t i, int32_t lane) {
  particles p = {fum_vf_load(run->x + lane),
                 fum_vf_load(run->y + lane),
                 fum_vf_load(run->z + lane),
                 fum_vf_load(run->scales + lane),
                 {0}};
  const fum_vf across = dot(s->right, p.x, p.y, p.z, fum_vf_set(s->across[i]));
  const fum_vf above = dot(s->up, p.x, p.y, p.z, fum_vf_set(s->above[i]));
  const fum_vf squared = across * across + above * above;
  p.whole = fum_vf_load(run->optical_depths + lane) * exp2_of(-squared * (p.scale * p.scale));
  return p;
}

static inline fum_vf sum_within(const seen *s, const fum_batch *batch, uint64_t runs, fum_vf sum) {
  for (; runs != 0; runs &= runs - 1) {
    const int32_t i = __builtin_ctzll(runs);
    for (int32_t lane = 0; lane < FUM_RUN_SIZE; lane += FUM_LANES)
      sum += load(s, batch->runs[i], i, lane).whole;
  }
  return sum;
}

/* Near one end: `sign` is 1 for the start and -1 for the end, `from` its place along the segment. */
static inline fum_vf sum_at_end(const seen *s, const fum_batch *batch, uint64_t runs, float sign, float from,
                                fum_vf sum) {
  for (; runs != 0; runs &= runs - 1) {
    const int32_t i = __builtin_ctzll(runs);
    for (int32_t lane = 0; lane < FUM_RUN_SIZE; lane += FUM_LANES) {
      const particles p = load(s, batch->runs[i], i, lane);
      const fum_vf along = dot(s->direction, p.x, p.y, p.z, fum_vf_set(s->along[i] - from));
      const fum_vf inside = along * (sign * SIGMAS_PER_SCALE) * p.scale; /* sigmas from the end into the segment */
      const fum_vf tail = tail_of(fum_vf_abs(inside));
      sum += p.whole * fum_vf_select(inside > 0.0F, 1.0F - tail, tail);
    }
  }
  return sum;
}

static inline fum_vf sum_at_both(const seen *s, const fum_batch *batch, uint64_t runs, fum_vf sum) {
  for (; runs != 0; runs &= runs - 1) {
    const int32_t i = __builtin_ctzll(runs);
    for (int32_t lane = 0; lane < FUM_RUN_SIZE; lane += FUM_LANES) {
      const particles p = load(s, batch->runs[i], i, lane);
      const fum_vf along = dot(s->direction, p.x, p.y, p.z, fum_vf_set(s->along[i]));
      const fum_vf inverse_sigma = p.scale * SIGMAS_PER_SCALE;
      sum += p.whole * fum_vf_normal_interval(-along * inverse_sigma, (s->length - along) * inverse_sigma);
    }
  }
  return sum;
}

static float sum(const fum_batch *batch, const fum_segment *segment) {
  const float far = 1e30F;
  seen s;
  s.length = segment->length < far ? segment->length : far;
  set_axes(&s, segment->direction);
  const heard h = see(&s, batch, segment);
  fum_vf depths = {0};
  depths = sum_within(&s, batch, h.runs & ~h.near_start & ~h.near_end, depths);
  depths = sum_at_end(&s, batch, h.runs & h.near_start & ~h.near_end, 1.0F, 0.0F, depths);
  depths = sum_at_end(&s, batch, h.runs & ~h.near_start & h.near_end, -1.0F, s.length, depths);
  depths = sum_at_both(&s, batch, h.runs & h.near_start & h.near_end, depths);
  return fum_vf_sum(depths);
}

const fum_run_loops FUM_RUN_LOOPS_NAME = {hear, sum};
