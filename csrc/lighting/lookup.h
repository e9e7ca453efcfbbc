/* SPDX-License-Identifier: GPL-3.0-or-later */
/* The lattice of light asked at a single point, as the tiles ask it for a whole slab of pixels. */
#ifndef FUM_LIGHTING_LOOKUP_H
#define FUM_LIGHTING_LOOKUP_H

#include "lighting/lattice.h"

#include <math.h>

/* Where one of the slab's own faces, held[1] and held[2], holds nothing the other one stands for both; 0 where neither
 * does. */
static inline void fum_lattice_fill(float held[4]) {
  if (isnan(held[1])) held[1] = isnan(held[2]) ? 0.0F : held[2];
  if (isnan(held[2])) held[2] = held[1];
}

/* What a lattice holds along a ray runs from face to face as a parabola: linear, plus bow * 4 share (1 - share). `held`
 * and `ranges` are those of the faces before, at the begin, at the end of and behind a slab; NaN: nothing is held
 * there. Returns the bow: the mean of what the faces on either side ask for, 0 where they disagree on its sign. */
static inline float fum_lattice_bow(const float held[4], const float ranges[4]) {
  const float length = ranges[2] - ranges[1], slope = (held[2] - held[1]) / length;
  const float before = (held[1] - held[0]) / (ranges[1] - ranges[0]);
  const float behind = (held[3] - held[2]) / (ranges[3] - ranges[2]);
  const float first = (before - slope) * length * length / (4.0F * (ranges[2] - ranges[0]));
  const float second = (slope - behind) * length * length / (4.0F * (ranges[3] - ranges[1]));
  if (isnan(first)) return isnan(second) ? 0.0F : second;
  if (isnan(second)) return first;
  return first * second > 0.0F ? 0.5F * (first + second) : 0.0F;
}

/* Optical depth to the light (lattice->depths), or that per metre, at a place of the window and a range: splines across
 * the faces, a parabola between them. Where a face holds nothing the other one stands for both; 0 where neither does.
 */
double fum_lattice_look_up(const fum_lattice *lattice, const fum_slabs *slabs, int32_t light, const double window[2],
                           double range);

/* Optical depth to the light at that place, which is at `position` in local space. */
double fum_lattice_depth(const fum_lattice *lattice, const fum_slabs *slabs, const fum_lamp *lamp, int32_t light,
                         const double window[2], double range, const double position[3]);

#endif
