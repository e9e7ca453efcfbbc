/* SPDX-License-Identifier: GPL-3.0-or-later */
/* Passes that show what particles are instead of how they are lit: Albedo, Vector and Cryptomatte. */
#ifndef FUM_API_ATTRIBUTES_H
#define FUM_API_ATTRIBUTES_H

#include "api/combine.h"

/* Draws `values` [3 count], in the octree's order, as what particles show of themselves: out_rgba [height][width][4] is
 * zeroed, and RGB becomes the sum along the ray of value times what each adds to A. Colours are multiplied by those of
 * particles' maps. */
typedef int32_t (*fum_draw_values_fn)(void *user, const float *values, bool are_colors, float *out_rgba);

bool fum_attributes_are_wanted(const fum_rendering *r);

/* Makes those of the passes that are asked for. */
int32_t fum_attributes_make(fum_rendering *r, fum_draw_values_fn draw, void *user);

#endif
