/* SPDX-License-Identifier: GPL-3.0-or-later */
/* How deep the camera sees up to a solid in each pixel; in pixels through which a solid's edge runs, how deep beside it
 * as well. */
#ifndef FUM_PASS_EDGES_H
#define FUM_PASS_EDGES_H

#include "scene/view.h"
#include "solid/solid.h"

/* Depths are along the axis, clip_end where there is no solid; [height][width]. */
typedef struct fum_solid_view {
  float *depths;  /* in the part of the pixel where the nearer solid is; NULL: no solid is in front of the camera... */
  float *behind;  /* ...in the rest of it; NULL: no edge runs through any pixel */
  float *shares;  /* of the nearer solid in the pixel: 1 where no edge runs through it; NULL as `behind` */
  float *between; /* a depth that parts the two; INFINITY where no edge runs; NULL as `behind` */
} fum_solid_view;

int32_t fum_solid_view_find(fum_context *context, const fum_solids *solids, const fum_view *view,
                            fum_solid_view *out_solid_view);
void fum_solid_view_free(fum_context *context, fum_solid_view *solid_view);

#endif
