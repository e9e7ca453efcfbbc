/* SPDX-License-Identifier: GPL-3.0-or-later */
/* Light at the particles' centres, where that has to be enough. */
#ifndef FUM_API_PARTICLE_LIGHT_H
#define FUM_API_PARTICLE_LIGHT_H

#include "api/combine.h"

/* Lights every particle and measures how well; says so where that misses the tolerance. out_light [3 count] as of
 * fum_inscatter, of all lights; by_light [light_count] of each that has an entry; NULL: none has. All are 0 before,
 * which they stay where no light is meant to shine. */
int32_t fum_light_particles(fum_rendering *r, fum_lighting *lighting, float *const *by_light, float *out_light);

#endif
