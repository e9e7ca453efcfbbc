/* SPDX-License-Identifier: GPL-3.0-or-later */
/* The pass Error: light that the picture was made with, against light found exactly, in each pixel. */
#ifndef FUM_API_LIGHT_ERROR_H
#define FUM_API_LIGHT_ERROR_H

#include "api/combine.h"

/* Makes r->error of a lattice that was lit. */
int32_t fum_light_error_find(fum_rendering *r, const fum_lighting *lighting, const fum_slabs *slabs,
                             const fum_lattice *lattice);

#endif
