/* SPDX-License-Identifier: GPL-3.0-or-later */
/* The part of the picture that a smeared particle may touch. */
#ifndef FUM_BILLBOARD_STREAK_H
#define FUM_BILLBOARD_STREAK_H

#include "lighting/smears.h"

enum {
  FUM_STREAK_NONE = 0,  /* so little blurred that it is drawn as if it stood in the middle of its path */
  FUM_STREAK_SWEPT = 1, /* a Gaussian swept along its path, widened by what it is out of focus */
  FUM_STREAK_BOKEH = 2  /* images of the aperture along its path */
};

typedef struct fum_streak {
  int32_t kind;
  float ends_px[2][2]; /* pixels from the centre of the first one */
  float radius_px;     /* around the line between them */
  float ranges[2];     /* along the rays, in an orthographic view depths, between which all of it lies */
} fum_streak;

/* Is a pixel nearer to the streak than `margin` pixels? */
static inline bool fum_streak_touches(const fum_streak *s, float x, float y, float margin) {
  const float dx = s->ends_px[1][0] - s->ends_px[0][0], dy = s->ends_px[1][1] - s->ends_px[0][1];
  const float px = x - s->ends_px[0][0], py = y - s->ends_px[0][1], length = dx * dx + dy * dy;
  const float along = length > 0.0F ? fum_min(fum_max((px * dx + py * dy) / length, 0.0F), 1.0F) : 0.0F;
  const float ax = px - along * dx, ay = py - along * dy, reach = s->radius_px + margin;
  return !(ax * ax + ay * ay > reach * reach);
}

/* Slopes between which a disc is seen from the origin; empty when it isn't in front. */
void fum_find_slopes(double lateral, double depth, double radius, double out[2]);

/* How a particle that looks `width` wide is drawn. `least`: sigmas by which blur may be off to be left out. */
int32_t fum_streak_kind(const fum_smears *smears, const fum_smear *smear, double width, double least);

/* Area of a Gaussian this wide over that which it is spread over. */
double fum_streak_share(const fum_view *view, const fum_smears *smears, const fum_smear *smear, double width);

/* The streak of a Gaussian that reaches out to `radius` metres, and its box, first and last along both axes in pixels;
 * false if none of it is between the clip planes and in the frame. Nothing is left of the box's limits where it reaches
 * over `beyond` pixels. */
bool fum_streak_find(const fum_view *view, const fum_smears *smears, const fum_smear *smear, double radius,
                     double beyond, double out_box[2][2], fum_streak *out);

/* Distances along the rays, in an orthographic view depths, between which all of it lies, when it reaches out to
 * `reach` metres along the view and to `width` across it. */
void fum_streak_ranges(const fum_view *view, const fum_smears *smears, const fum_smear *smear, double reach,
                       double width, double out[2]);

#endif
