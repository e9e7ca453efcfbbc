/* SPDX-License-Identifier: GPL-3.0-or-later */
/* The sum of blur_rays.h, to be compiled once for each instruction set: blur_rays_*.c define FUM_LANES and
 * FUM_BLUR_SUM. */
#include "base/simd.h"
#include "billboard/blur_rays.h"

#include <math.h>

float FUM_BLUR_SUM(const fum_blur_particles *particles, const fum_blur_ray *ray) {
  const float *s = ray->start, *d = ray->direction;
  const float length = sqrtf(d[0] * d[0] + d[1] * d[1] + d[2] * d[2]), per_length = 1.0F / length;
  const float unit[3] = {d[0] * per_length, d[1] * per_length, d[2] * per_length};
  const float near = ray->near * length, far = ray->far * length;
  fum_vf sum = {0};
  for (int64_t i = 0; i < particles->count; i += FUM_LANES) {
    const fum_vf x = fum_vf_load(particles->x + i) + fum_vf_load(particles->move_x + i) * ray->time - s[0];
    const fum_vf y = fum_vf_load(particles->y + i) + fum_vf_load(particles->move_y + i) * ray->time - s[1];
    const fum_vf z = fum_vf_load(particles->z + i) + fum_vf_load(particles->move_z + i) * ray->time - s[2];
    const fum_vf inverse = fum_vf_load(particles->inverse_sigmas + i);
    const fum_vf along = x * unit[0] + y * unit[1] + z * unit[2];
    const fum_vf dx = x - along * unit[0], dy = y - along * unit[1], dz = z - along * unit[2];
    const fum_vf gauss = fum_vf_exp2((dx * dx + dy * dy + dz * dz) * (inverse * inverse) * -FUM_HALF_LOG2_E);
    fum_vf depth = fum_vf_load(particles->optical_depths + i) * gauss;
    const fum_vf first = (near - along) * inverse, last = (far - along) * inverse;
    const float reach = 6.0F;
    if (fum_vi_bits((first > -reach) | (last < reach)) != 0) depth *= fum_vf_normal_interval(first, last);
    sum += depth;
  }
  return fum_vf_sum(sum);
}
