/* SPDX-License-Identifier: GPL-3.0-or-later */
/* How much is lost of a picture between the points of a grid. */
#ifndef FUM_BILLBOARD_COARSE_ERROR_H
#define FUM_BILLBOARD_COARSE_ERROR_H

#include "billboard/spline.h"

#include <stdbool.h>

/* One of the pictures that are drawn on a grid: RGBA, or RGB. */
typedef struct fum_coarse_plane {
  fum_spline spline; /* samples, then coefficients */
  float *pixels;     /* [height][width][channels] the picture in full */
  float means[4];    /* of the channels where smoke is seen */
} fum_coarse_plane;

/* Points that are looked at on each side of those that are asked for. */
enum { FUM_COARSE_AROUND = 6 };

/* Finds the means of all planes, of which the first one is Combined. */
int32_t fum_coarse_find_means(fum_context *context, int32_t count, fum_coarse_plane *planes);

/* Is more lost between the points x[0] to x[1], y[0] to y[1] than a picture may that is wrong by `tolerance`? There are
 * FUM_COARSE_MOST points a side at most. */
enum { FUM_COARSE_MOST = 18 };
bool fum_coarse_is_rough(const fum_coarse_plane *plane, float tolerance, const int32_t x[2], const int32_t y[2]);

#endif
