/* SPDX-License-Identifier: GPL-3.0-or-later */
/* The exact solver: for every receiver, the closed-form optical depth of all particles between it and a light. */
#ifndef FUM_LIGHTING_EXACT_H
#define FUM_LIGHTING_EXACT_H

#include "lighting/emitter.h"
#include "lighting/medium.h"
#include "lighting/receivers.h"

#include <math.h>

/* Optical depth from each receiver to the emitter; only where is_lit (receivers' order) is nonzero, elsewhere
 * out_depths is left alone. Progress runs from `progress[0]` to `progress[1]` of the lighting stage. */
int32_t fum_exact_solve(fum_context *context, fum_medium *medium, fum_receivers *receivers, const fum_emitter *emitter,
                        const uint8_t *is_lit, const float progress[2], float *out_depths);

/* Predicted time, on all threads together: a receiver takes as long as it meets casters, whose number grows with the
 * cube root. Of measured times. */
static inline double fum_exact_predict_us(int64_t casters, int64_t receivers) {
  return 0.018 * cbrt((double)casters) * (double)receivers;
}

#endif
