/* SPDX-License-Identifier: GPL-3.0-or-later */
/* The loops of pairs.h, to be compiled once for each instruction set: pairs_*.c define FUM_LANES and FUM_PAIRS_NAME. */
#include "base/simd.h"
#include "lighting/pairs.h"

static const float HALF_LOG2_E = 0.72134752F;

/* Scaled by 1 / sigma: the particle seen from the segment's start. Precise far from the origin too, because the
 * perpendicular is a vector and not a difference of squares. */
typedef struct seen {
  fum_vf along, distance_squared;
} seen;

static inline seen see(const fum_sources *s, const fum_segment *segment, int32_t i, fum_vf inverse_sigma) {
  const float *u = segment->direction;
  const fum_vf dx = fum_vf_load(s->x + i) - segment->origin[0];
  const fum_vf dy = fum_vf_load(s->y + i) - segment->origin[1];
  const fum_vf dz = fum_vf_load(s->z + i) - segment->origin[2];
  const fum_vf t = dx * u[0] + dy * u[1] + dz * u[2];
  const fum_vf px = dx - t * u[0], py = dy - t * u[1], pz = dz - t * u[2];
  return (seen){t, (px * px + py * py + pz * pz) * (inverse_sigma * inverse_sigma)};
}

static float line(const fum_sources *s, const fum_segment *segment) {
  fum_vf sum = {0};
  for (int32_t i = 0; i < s->count; i += FUM_LANES) {
    const seen p = see(s, segment, i, fum_vf_load(s->inverse_sigmas + i));
    sum += fum_vf_load(s->optical_depths + i) * fum_vf_exp2(p.distance_squared * -HALF_LOG2_E);
  }
  return fum_vf_sum(sum);
}

static float whole(const fum_sources *s, const fum_segment *segment) {
  fum_vf sum = {0};
  const float far = 1e30F;
  const fum_vf length = fum_vf_set(segment->length < far ? segment->length : far);
  for (int32_t i = 0; i < s->count; i += FUM_LANES) {
    const fum_vf inverse_sigma = fum_vf_load(s->inverse_sigmas + i);
    const seen p = see(s, segment, i, inverse_sigma);
    const fum_vf a = -p.along * inverse_sigma, b = (length - p.along) * inverse_sigma;
    const fum_vf gauss = fum_vf_exp2(p.distance_squared * -HALF_LOG2_E);
    sum += fum_vf_load(s->optical_depths + i) * gauss * fum_vf_normal_interval(a, b);
  }
  return fum_vf_sum(sum);
}

static inline fum_vf at_least_zero(fum_vf v) {
  return fum_vf_select(v > 0.0F, v, (fum_vf){0});
}

static void hear(const fum_beam *beam, float bend, float reach, float sigma_scale, int32_t count, const float *x,
                 const float *y, const float *z, const float *inverse_sigmas, int32_t *out_heard) {
  const float clear_sigmas = 4.0F; /* beyond it the tail of a particle is below 4e-5 of it */
  const float far = 1e30F, last = beam->last < far ? beam->last : far;
  const float slack = fabsf(beam->slope) * (reach + beam->radius);
  for (int32_t i = 0; i < count; i += FUM_LANES) {
    const fum_vf dx = fum_vf_load(x + i) - beam->start.x;
    const fum_vf dy = fum_vf_load(y + i) - beam->start.y;
    const fum_vf dz = fum_vf_load(z + i) - beam->start.z;
    const fum_vf s = dx * beam->axis.x + dy * beam->axis.y + dz * beam->axis.z;
    const fum_vf px = dx - s * beam->axis.x, py = dy - s * beam->axis.y, pz = dz - s * beam->axis.z;
    const fum_vf offset_squared = px * px + py * py + pz * pz;
    const fum_vf hearing = reach + at_least_zero(beam->radius + beam->slope * s + slack);
    const fum_vi heard =
        (offset_squared <= hearing * hearing * 1.00001F) & (s > beam->first - reach) & (s < last + reach);
    /* A segment's own coordinate along itself differs from s by at most the beam's radius and what its bend makes of
     * the distance; |offset| + |s| bounds that distance. */
    const fum_vf clear = clear_sigmas * sigma_scale / fum_vf_load(inverse_sigmas + i);
    const fum_vf distance = fum_vf_abs(s) + fum_vf_abs(px) + fum_vf_abs(py) + fum_vf_abs(pz);
    const fum_vf start_gap = s - beam->radius - (distance + beam->radius) * bend;
    const fum_vf end_gap = last - s - beam->radius - (last + distance) * bend;
    const fum_vi within = (start_gap > clear) & (end_gap > clear);
    const fum_vi result = heard & (FUM_HEARD_AT_END + within); /* within is -1 where true */
    memcpy(out_heard + i, &result, sizeof result);
  }
}

const fum_pairs FUM_PAIRS_NAME = {line, whole, hear};
