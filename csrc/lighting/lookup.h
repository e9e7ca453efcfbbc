/* SPDX-License-Identifier: GPL-3.0-or-later */
/* The lattice of light asked at a single point, as the tiles ask it for a whole slab of pixels. */
#ifndef FUM_LIGHTING_LOOKUP_H
#define FUM_LIGHTING_LOOKUP_H

#include "lighting/lattice.h"

/* Optical depth to the light (lattice->depths), or that per metre, at a place of the window and a range: cubic across
 * the two faces around it, linear between them. Where a face has no samples the other one stands for both; 0 where
 * neither has. */
double fum_lattice_look_up(const fum_lattice *lattice, const fum_slabs *slabs, int32_t light, const double window[2],
                           double range);

#endif
