/* SPDX-License-Identifier: GPL-3.0-or-later */
/* The reference's own solids: what a Lambertian surface shows of the light that reaches it. */
#ifndef FUM_REFERENCE_SURFACE_H
#define FUM_REFERENCE_SURFACE_H

#include "reference/ray.h"

/* Radiance of mesh `point->mesh` at `position`, towards the side of the point's normals. `distance` from the camera, m:
 * rays to lights start a hair in front of the surface. */
void fum_reference_surface_shine(const fum_reference_world *world, const fum_solid_point *point,
                                 const double position[3], double distance, double out_radiance[3]);

#endif
