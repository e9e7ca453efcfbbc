/* SPDX-License-Identifier: GPL-3.0-or-later */
/* Cryptomatte: who covers a pixel, ranked (Friedman and Jones 2015, Fully automatic ID mattes with support for motion
 * blur and transparency). */
#ifndef FUM_PASS_CRYPTO_H
#define FUM_PASS_CRYPTO_H

#include "fumarole.h"

/* Enters somebody into the ranks of all pixels, or adds to what was entered. `coverage` [pixel_count], `stride` floats
 * apart, times `share`: of the pixel. `pairs` [pair_count][pixel_count][4]: id and coverage of two ranks each, the
 * greatest coverage first, earlier entries first among equals; zeroed before the first entry. */
void fum_crypto_enter(uint32_t hash, int64_t pixel_count, const float *coverage, int32_t stride, float share,
                      int32_t pair_count, float *const *pairs);

#endif
