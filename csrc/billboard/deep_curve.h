/* SPDX-License-Identifier: GPL-3.0-or-later */
/* What a pixel's ray gathers on its way through the smoke, as a curve over depth, and the few samples that stand for
 * it. */
#ifndef FUM_BILLBOARD_DEEP_CURVE_H
#define FUM_BILLBOARD_DEEP_CURVE_H

#include "fumarole.h"

#include <stdbool.h>

enum { FUM_DEEP_SUMS = 4, FUM_DEEP_MIXED = 3 /* most curves in a mixture */ };

/* Sums up to each of `count` depths along the camera's axis: optical depth, and radiance R, G, B as it arrives at the
 * camera. Depths grow, sums don't fall; where they stay the same there is no smoke. */
typedef struct fum_deep_curve {
  int32_t count;
  float *depth;
  float *sums[FUM_DEEP_SUMS];
  float *transmittance; /* of the optical depth; filled by fum_deep_divide */
} fum_deep_curve;

/* Floats that a curve of up to `points` points needs. */
int64_t fum_deep_curve_size(int64_t points);

/* An empty curve in `memory`, which stays its owner's. */
void fum_deep_curve_place(float *memory, int64_t points, fum_deep_curve *out_curve);

/* Adds a point, unless it isn't behind the last one. */
void fum_deep_curve_add(fum_deep_curve *curve, float depth, const float sums[FUM_DEEP_SUMS]);

/* Intervals that fum_deep_bend makes of one. */
enum { FUM_DEEP_STEPS = 2 };

/* The smooth curve through the points of `knots`; `out` is empty and has room for FUM_DEEP_STEPS times their number. */
void fum_deep_bend(const fum_deep_curve *knots, fum_deep_curve *out);

/* What a curve has in a mixture. */
typedef struct fum_deep_share {
  float opacity, rgb[3];
} fum_deep_share;

/* A mixture of curves: their opacities and radiances times their shares, added up; shares of opacity add up to 1. `out`
 * is empty and has room for the points of all. */
void fum_deep_mix(int32_t count, const fum_deep_curve *curves, const fum_deep_share *shares, fum_deep_curve *out);

/* The curve that samples stand for; `out` is empty and has room for (1 + FUM_DEEP_STEPS) times their number. */
void fum_deep_unfold(const fum_deep_sample *samples, int32_t count, fum_deep_curve *out);

/* How far what is in front of any depth may be off. */
typedef struct fum_deep_limits {
  float error;       /* of transmittance, as a share of the curve's opacity, and of radiance, of its brightest channel;
                        where the opacity is below a quarter it counts as that... */
  bool is_scattered; /* ...and radiance as what smoke like it would have, unless something glows */
} fum_deep_limits;

/* Divides a curve into samples, each as long as the limits allow. `out_samples` has room for as many as the curve has
 * points. Returns their number. */
int32_t fum_deep_divide(const fum_deep_curve *curve, const fum_deep_limits *limits, fum_deep_sample *out_samples);

#endif
