/* SPDX-License-Identifier: GPL-3.0-or-later */
/* A Gaussian out of focus: the image of the aperture, blurred by the Gaussian. Tables of it for a number of ratios
 * between the two, scaled so that their second moments stay the same. */
#ifndef FUM_BILLBOARD_BOKEH_H
#define FUM_BILLBOARD_BOKEH_H

#include "base/context.h"
#include "scene/aperture.h"

enum { FUM_BOKEH_LEVELS = 21 };

/* The confusion over the Gaussian's width: at the first level, from one to the next, and at the last. Below, all is a
 * Gaussian; above, edges are as soft as there. */
static const float FUM_BOKEH_LEAST = 0.35F, FUM_BOKEH_STEP = 1.3F, FUM_BOKEH_MOST = 66.5F;

/* A table: side x side values in the picture of all, from row `first` on. The middle one is at the centre. */
typedef struct fum_bokeh_level {
  int32_t first, side;
  float per_unit; /* values a unit of length: the root of the variance along an axis, the mean of both */
} fum_bokeh_level;

/* Values are what a Gaussian of this variance and a peak of 1 becomes: their integral is 2 pi. */
typedef struct fum_bokeh {
  float variance; /* of the aperture */
  int32_t width, height;
  fum_bokeh_level levels[FUM_BOKEH_LEVELS];
  float *values; /* [height][width] */
} fum_bokeh;

int32_t fum_bokeh_find(fum_context *context, const fum_camera *camera, fum_bokeh *out_bokeh);
void fum_bokeh_free(fum_context *context, fum_bokeh *bokeh);

/* How a Gaussian is to be looked up that is out of focus. */
typedef struct fum_bokeh_place {
  int32_t level;
  float blend;    /* share of the level behind it */
  float units[3]; /* of a metre: what offsets are multiplied with, a symmetric matrix (xx, xy, yy) */
  float density;  /* 1/m^2: a Gaussian's peak over that of its values, if its area over 2 pi were 1 m^2 */
} fum_bokeh_place;

/* `variances`: of the Gaussian, in the plane of its depth (xx, xy, yy), m^2. It and the aperture's image are as wide in
 * any direction as what is looked up. */
fum_bokeh_place fum_bokeh_at(const fum_bokeh *bokeh, double confusion, const double variances[3]);

#endif
