/* SPDX-License-Identifier: GPL-3.0-or-later */
/* The reference's own reading of maps on particles: at full resolution, in double precision. */
#ifndef FUM_REFERENCE_MAP_H
#define FUM_REFERENCE_MAP_H

#include "scene/scene.h"
#include "scene/view.h"

typedef struct fum_reference_map {
  const fum_map *map; /* of which the first level is read; NULL: no map */
  double mean;        /* of its opacity, weighted with the Gaussian */
} fum_reference_map;

/* Fails with FUM_ERROR_MEMORY. */
int32_t fum_reference_map_make(fum_context *context, const fum_map *map, fum_reference_map *out_map);

/* Factors on what a particle scatters and emits, red, green and blue, and on its extinction, along a ray of the camera
 * that passes `centre` at `distance`. Local space; `sigma` in metres; `turn` in radians. */
void fum_reference_map_read(const fum_reference_map *map, const fum_view *view, const double centre[3], double sigma,
                            double turn, const double start[3], const double direction[3], double distance,
                            double out_factors[4]);

#endif
