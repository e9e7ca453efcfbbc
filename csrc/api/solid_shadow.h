/* SPDX-License-Identifier: GPL-3.0-or-later */
/* The passes Solid Shadow: the share of smoke's light that solids let through. */
#ifndef FUM_API_SOLID_SHADOW_H
#define FUM_API_SOLID_SHADOW_H

#include "api/combine.h"
#include "billboard/tile.h"

/* Is one of them asked for? */
bool fum_solid_shadow_is_wanted(const fum_rendering *r);

/* Fills them with what holds where there is nothing. */
void fum_solid_shadow_begin(fum_rendering *r);

/* Makes them by drawing the tiles of `job`, lit by a lattice, with solids' shadows and without. */
int32_t fum_solid_shadow_find(fum_rendering *r, const fum_tile_job *job);

#endif
