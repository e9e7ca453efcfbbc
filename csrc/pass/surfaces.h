/* SPDX-License-Identifier: GPL-3.0-or-later */
/* The solids that the camera sees, as points on them. */
#ifndef FUM_PASS_SURFACES_H
#define FUM_PASS_SURFACES_H

#include "scene/view.h"
#include "solid/solid.h"

typedef struct fum_surfaces {
  int64_t count;
  float *positions, *normals; /* [3 count] local space, a hair in front of the solid; unit, of the smooth
                                 surface, towards the camera */
  float *depths;              /* [count] along the camera's axis */
  int32_t *meshes;            /* [count] of the scene */
  uint32_t *pixels;           /* [count] ascending */
} fum_surfaces;

/* What is seen at the middle, or at FUM_PLACES places, of each of the pixels in `pixels` [pixel_count], ascending;
 * places where no solid is seen are left out. */
int32_t fum_surfaces_find(fum_context *context, const fum_solids *solids, const fum_view *view, int64_t pixel_count,
                          const uint32_t *pixels, bool is_middle, fum_surfaces *out_surfaces);
void fum_surfaces_free(fum_context *context, fum_surfaces *surfaces);

#endif
