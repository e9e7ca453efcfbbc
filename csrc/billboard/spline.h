/* SPDX-License-Identifier: GPL-3.0-or-later */
/* B-splines of the fifth degree through the samples of a picture (Unser 1999, Splines: a perfect fit for signal and
 * image processing): of what is nearly band-limited they keep much more than cubic ones. Beyond the ends the picture is
 * taken to go on as its mirror image, upside down, so that whatever is linear stays so. */
#ifndef FUM_BILLBOARD_SPLINE_H
#define FUM_BILLBOARD_SPLINE_H

#include "base/context.h"

/* Values at the points of a grid, side by side in each: [rows][columns][channels]. */
typedef struct fum_spline {
  int32_t columns, rows, channels;
  float *values;
} fum_spline;

/* The most points that are asked for between two of the grid. */
enum { FUM_SPLINE_STEPS = 8, FUM_SPLINE_TAPS = 6 };

/* Where points lie that are 1 / step apart: each stands in the middle of its share of a point of the grid, so that
 * point p * step + k begins with grid point p + first[k] and has these weights. */
typedef struct fum_spline_taps {
  int32_t step, first[FUM_SPLINE_STEPS];
  float weights[FUM_SPLINE_STEPS][FUM_SPLINE_TAPS];
} fum_spline_taps;

fum_spline_taps fum_spline_find_taps(int32_t step);

/* Turns samples into the coefficients of splines through them. */
void fum_spline_fit(fum_context *context, const fum_spline *spline);

/* The spline on one of the finer rows: coefficients along that row, [columns][channels], of those columns of the grid
 * that fum_spline_points takes for `count` finer points from column `from` on. */
void fum_spline_row(const fum_spline *spline, const fum_spline_taps *taps, int32_t row, int32_t from, int32_t count,
                    float *out);

/* Those points, [count][channels]. */
void fum_spline_points(const fum_spline_taps *taps, int32_t channels, const float *row, int32_t from, int32_t count,
                       float *out);

#endif
