/* SPDX-License-Identifier: GPL-3.0-or-later */
/* The loops of pairs.h, to be compiled once for each instruction set: pairs_*.c define FUM_LANES and FUM_PAIRS_NAME. */
#include "base/simd.h"
#include "lighting/pairs.h"

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
    sum += fum_vf_load(s->optical_depths + i) * fum_vf_exp2(p.distance_squared * -FUM_HALF_LOG2_E);
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
    const fum_vf gauss = fum_vf_exp2(p.distance_squared * -FUM_HALF_LOG2_E);
    sum += fum_vf_load(s->optical_depths + i) * gauss * fum_vf_normal_interval(a, b);
  }
  return fum_vf_sum(sum);
}

const fum_pairs FUM_PAIRS_NAME = {line, whole};
