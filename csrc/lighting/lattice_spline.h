/* SPDX-License-Identifier: GPL-3.0-or-later */
/* Cubic B-splines through what a lattice holds across its faces. They are read from as many samples as Catmull and
 * Rom's cubics, 4 x 4, and are smoother and closer: at an error of half a percent samples may stand 1.2 to 1.5 times as
 * far apart, at a tenth of that nearly twice as far. */
#ifndef FUM_LIGHTING_LATTICE_SPLINE_H
#define FUM_LIGHTING_LATTICE_SPLINE_H

#include "lighting/lattice.h"

/* Turns the depths of a lattice that was lit into coefficients. Weighted by B-splines these give the depths back at
 * each sample whose eight neighbours are lit as well. */
int32_t fum_lattice_fit(fum_context *context, fum_lattice *lattice);

#endif
