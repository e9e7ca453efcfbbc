/* SPDX-License-Identifier: GPL-3.0-or-later */
/* What is drawn: particles, or fewer Gaussians where those that share a small cell may be taken as one. */
#ifndef FUM_BILLBOARD_DRAWN_H
#define FUM_BILLBOARD_DRAWN_H

#include "billboard/tile.h"
#include "octree/bunch.h"

/* Bunches of the job's particles, whose picture differs from theirs by a fifth of the tolerance, root mean square. NULL
 * where each is drawn by itself: few ones, dense ones, those that differ in look. */
int32_t fum_drawn_bunch(fum_context *context, const fum_tile_job *job, float tolerance, fum_octree **out_bunched);

#endif
