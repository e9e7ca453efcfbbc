/* SPDX-License-Identifier: GPL-3.0-or-later */
/* Single scattering towards the camera: for every particle, the sum over lights of irradiance times phase function. */
#ifndef FUM_LIGHTING_INSCATTER_H
#define FUM_LIGHTING_INSCATTER_H

#include "lighting/gather.h"

/* Henyey-Greenstein, 1/sr: `cosine` between the light's way and the way on to the camera. Integral over the sphere: 1.
 */
float fum_phase(float anisotropy, float cosine);

/* Lamps of the scene in the local space of the gathering's receivers. [light_count], freed with fum_free. */
int32_t fum_lamps_find(const fum_scene *scene, const fum_octree *receivers, int32_t max_samples, fum_lamp **out_lamps);

/* out_light [3 count] in receivers' order, for receivers whose octree holds the scene's particles: sum over lamps of
 * irradiance times phase function, W / (m^2 sr). `gathering` comes without a response. */
int32_t fum_inscatter(const fum_scene *scene, const fum_gathering *gathering, const fum_lamp *lamps,
                      const fum_viewpoint *viewpoint, float *out_light);

#endif
