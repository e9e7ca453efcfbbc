/* SPDX-License-Identifier: GPL-3.0-or-later */
/* Light on the solids that the camera sees, through smoke and without. */
#ifndef FUM_API_SURFACE_LIGHT_H
#define FUM_API_SURFACE_LIGHT_H

#include "api/combine.h"
#include "pass/surfaces.h"

/* Hears of one lamp: irradiance at surface points[i] of those that were asked for, i below count, as a factor on the
 * lamp's colour; `smoky` through smoke and past solids, `clear` past solids alone. An environment comes as many lamps.
 */
typedef void (*fum_surface_light_fn)(void *user, const fum_lamp *lamp, const fum_surfaces *surfaces,
                                     const uint32_t *points, const float *smoky, const float *clear);

/* Finds what arrives at surfaces, lamp by lamp. */
int32_t fum_surface_light_find(const fum_rendering *r, const fum_surfaces *surfaces, fum_surface_light_fn hear,
                               void *user);

#endif
