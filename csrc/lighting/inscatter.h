/* SPDX-License-Identifier: GPL-3.0-or-later */
/* Single scattering towards the camera: for every particle, the sum over lights of irradiance times phase function. */
#ifndef FUM_LIGHTING_INSCATTER_H
#define FUM_LIGHTING_INSCATTER_H

#include "lighting/gather.h"
#include "lighting/lamps.h"

/* out_light [3 count] in receivers' order, for receivers whose octree holds the scene's particles: sum over lamps of
 * irradiance times phase function, W / (m^2 sr). `gathering` comes without a response. A light that has an entry in
 * `by_light` [light_count of lamps] goes there instead; NULL: none has. What no light shines on is left alone. */
int32_t fum_inscatter(const fum_scene *scene, const fum_gathering *gathering, const fum_lamps *lamps,
                      const fum_viewpoint *viewpoint, float *const *by_light, float *out_light);

#endif
