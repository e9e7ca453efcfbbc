/* SPDX-License-Identifier: GPL-3.0-or-later */
/* Places in a pixel at which solids are looked at. */
#ifndef FUM_PASS_PLACES_H
#define FUM_PASS_PLACES_H

#include "scene/view.h"
#include "solid/solid.h"

/* In pixels with edges. */
enum { FUM_PLACES = 16 };

/* Place `index` of FUM_PLACES, from the pixel's lower left corner: no two share a column or a row, so that edges of any
 * slant are told to a sixteenth (Hammersley's points). */
static inline void fum_place_in_pixel(int32_t index, double out[2]) {
  static const uint8_t REVERSED[FUM_PLACES] = {0, 8, 4, 12, 2, 10, 6, 14, 1, 9, 5, 13, 3, 11, 7, 15};
  out[0] = (index + 0.5) / FUM_PLACES;
  out[1] = (REVERSED[index] + 0.5) / FUM_PLACES;
}

/* Steps from a pixel to its neighbours on one side, across and up; those on the other side are as far away. 0 at the
 * picture's border. */
enum { FUM_STEPS = 2 };
static inline void fum_steps_around(const fum_view *view, int32_t x, int32_t y, int64_t out_steps[FUM_STEPS]) {
  out_steps[0] = x > 0 && x < view->width - 1 ? 1 : 0;
  out_steps[1] = y > 0 && y < view->height - 1 ? view->width : 0;
}

/* What the camera sees of solids along one ray. */
typedef struct fum_sight {
  double start[3], direction[3]; /* of the ray, local space; the direction is a metre deep */
  float depth;                   /* along the camera's axis, m; clip_end where there is no solid */
  fum_solid_point solid;         /* there, undefined where there is none */
} fum_sight;

/* Looks through the place (x, y) of the picture, in pixels from its lower left corner. */
fum_sight fum_look(const fum_solids *solids, const fum_view *view, double x, double y);

#endif
