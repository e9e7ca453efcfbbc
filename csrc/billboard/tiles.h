/* SPDX-License-Identifier: GPL-3.0-or-later */
/* Draws the picture in C: particles added up in slabs, tile by tile, lit by the lattice. */
#ifndef FUM_BILLBOARD_TILES_H
#define FUM_BILLBOARD_TILES_H

#include "billboard/tile.h"

/* Fills in what the job needs to know of the particles' looks; `classes` are to live as long as the job. Fails when
 * there are too many. */
int32_t fum_tiles_find_looks(const fum_scene *scene, fum_tile_class classes[FUM_MAX_CLASSES], fum_tile_job *job);

/* Finds splats' self_shade. */
void fum_tiles_shade_dust(fum_context *context, fum_tile_job *job, fum_splats *splats);

/* Renders all tiles, or those that are wanted, into job->rgba, which is zeroed there. */
int32_t fum_tiles_draw(fum_context *context, const fum_tile_job *job);

#endif
