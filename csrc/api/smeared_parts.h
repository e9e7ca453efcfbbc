/* SPDX-License-Identifier: GPL-3.0-or-later */
/* Parts of the pass Combined, of smoke that is lit at its particles' centres: what each light makes of it, and what it
 * emits. */
#ifndef FUM_API_SMEARED_PARTS_H
#define FUM_API_SMEARED_PARTS_H

#include "api/attributes.h"

/* `by_light` [light_count]: of the lights that are asked for [3 count] as of fum_inscatter. `thinnest` as in
 * fum_tile_job. */
int32_t fum_smeared_parts_make(fum_rendering *r, float *const *by_light, float thinnest, fum_draw_values_fn draw_values,
                               void *user);

#endif
