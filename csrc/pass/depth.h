/* SPDX-License-Identifier: GPL-3.0-or-later */
/* The passes of depth: where the transmittance from the camera passes one half, and where smoke begins and ends to be
 * seen, from the closed form along each pixel's ray and not from the order of billboards. */
#ifndef FUM_PASS_DEPTH_H
#define FUM_PASS_DEPTH_H

#include "octree/octree.h"
#include "scene/scene.h"
#include "scene/view.h"

/* Which depth. */
typedef enum fum_depth_of {
  FUM_DEPTH_OF_HALF,   /* where half of the light gets through to the camera */
  FUM_DEPTH_OF_FRONT,  /* where a twentieth of the pixel's opacity lies in front */
  FUM_DEPTH_OF_MIDDLE, /* where half of it does */
  FUM_DEPTH_OF_BACK    /* where a twentieth of it lies behind */
} fum_depth_of;

/* out_depths [height][width]. `octree` of all particles of the scene; `reaches` of fum_reach_find; `solid_depths`
 * [height][width] with clip_end where there is none, or NULL. */
int32_t fum_depth_find(const fum_scene *scene, const fum_octree *octree, const float *reaches, const fum_view *view,
                       const float *solid_depths, fum_depth_of of, float *out_depths);

#endif
