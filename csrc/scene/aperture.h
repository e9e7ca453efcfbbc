/* SPDX-License-Identifier: GPL-3.0-or-later */
/* The shape of a camera's aperture: a polygon, or a disc, in the lens's plane, its corners one unit from the centre
 * before it is narrowed. */
#ifndef FUM_SCENE_APERTURE_H
#define FUM_SCENE_APERTURE_H

#include "fumarole.h"

#include <stdbool.h>

enum { FUM_MOST_BLADES = 64 };

typedef struct fum_aperture {
  int32_t corner_count;               /* 0: an ellipse */
  double corners[FUM_MOST_BLADES][2]; /* counter-clockwise */
  double half_width;                  /* of the ellipse; its half height is 1 */
  double area;                        /* square units */
  double extent;                      /* of what lies farthest from the centre */
  double variance;                    /* mean of the second moments along both axes */
} fum_aperture;

void fum_aperture_find(const fum_camera *camera, fum_aperture *out_aperture);

/* The part of the line at height y that lies within; false if none does. */
bool fum_aperture_cut(const fum_aperture *aperture, double y, double out_ends[2]);

#endif
