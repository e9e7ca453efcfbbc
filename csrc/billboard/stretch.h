/* SPDX-License-Identifier: GPL-3.0-or-later */
/* Gaussians that aren't round, as the camera sees them. */
#ifndef FUM_BILLBOARD_STRETCH_H
#define FUM_BILLBOARD_STRETCH_H

#include "octree/octree.h"
#include "scene/view.h"

/* What the exponent of a splat that isn't round has beside that of its width, to the base 2: a sum of these times x^2,
 * x y and y^2 of how far a ray passes beside the centre, in m along the picture's sides, at the centre's depth. */
typedef struct fum_stretch {
  float xx, xy, yy;
} fum_stretch;

/* Far from the camera against its size. */
typedef struct fum_stretched {
  double width;     /* m, sigma along the ray through its centre; across, what differs is in... */
  fum_stretch of;   /* ...this */
  double peak;      /* factor on the optical depth through the centre */
  double across[2]; /* m, sigma along the picture's sides */
  double lean;      /* 0..1, how far its outline lies along the diagonal of the box around it */
} fum_stretched;

/* Gaussian `i` of an octree of bunches, whose centre is at `center` in camera space. */
fum_stretched fum_stretch_find(const fum_octree *octree, int64_t i, const fum_view *view, const float center[3]);

#endif
