/* SPDX-License-Identifier: GPL-3.0-or-later */
/* The Depth pass: where the transmittance from the camera passes one half, from the closed form along each pixel's ray
 * and not from the order of billboards. */
#ifndef FUM_PASS_DEPTH_H
#define FUM_PASS_DEPTH_H

#include "octree/octree.h"
#include "scene/view.h"

/* out_depths [height][width]. `octree` of all particles; `reaches` of fum_reach_find; `solid_depths`
 * [height][width] with clip_end where there is none, or NULL. */
int32_t fum_depth_find(fum_context *context, const fum_octree *octree, const float *reaches, const fum_view *view,
                       const float *solid_depths, float *out_depths);

#endif
