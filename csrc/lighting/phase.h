/* SPDX-License-Identifier: GPL-3.0-or-later */
/* How a particle shares out the light that it scatters. */
#ifndef FUM_LIGHTING_PHASE_H
#define FUM_LIGHTING_PHASE_H

#include "base/vector.h"

/* Henyey-Greenstein, 1/sr: `cosine` between the light's way and the way on to the camera. Integral over the sphere: 1.
 */
static inline float fum_phase(float anisotropy, float cosine) {
  const float g = anisotropy, base = 1.0F + g * g - 2.0F * g * cosine;
  return (1.0F - g * g) / (4.0F * (float)FUM_PI * base * sqrtf(base));
}

#endif
