/* SPDX-License-Identifier: GPL-3.0-or-later */
/* Slabs: the camera's view of the smoke cut by faces of equal range, close enough together that light and optical depth
 * run smoothly from one to the next. Range is the distance along a ray, in an orthographic view the depth. */
#ifndef FUM_LIGHTING_SLABS_H
#define FUM_LIGHTING_SLABS_H

#include "octree/octree.h"
#include "scene/view.h"

/* A face: where it is, how closely light must be sampled on it, and which part of it has smoke near. */
typedef struct fum_face {
  float range;    /* m */
  float spacing;  /* m between samples of light */
  float lower[2]; /* in the view's window: left and bottom... */
  float upper[2]; /* ...right and top of the smoke near this face; empty when lower > upper */
} fum_face;

typedef struct fum_slabs {
  int32_t count; /* slabs; 0 when no smoke is in view */
  fum_face *faces; /* [count + 1], nearest first */
} fum_slabs;

/* `tolerance` is the relative error of the picture that the steps may cause; `thinnest` the optical depth that a particle
 * counts at least (above 0 where it may glow without absorbing). */
int32_t fum_slabs_find(fum_context *context, const fum_octree *octree, const fum_view *view, float tolerance,
                       float thinnest, fum_slabs *out_slabs);
void fum_slabs_free(fum_context *context, fum_slabs *slabs);

#endif
