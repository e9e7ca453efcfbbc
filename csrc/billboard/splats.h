/* SPDX-License-Identifier: GPL-3.0-or-later */
/* Particles as the camera sees them, sorted into the tiles of the picture that they touch. */
#ifndef FUM_BILLBOARD_SPLATS_H
#define FUM_BILLBOARD_SPLATS_H

#include "octree/octree.h"
#include "scene/view.h"

enum { FUM_TILE = 32 }; /* pixels a side */

typedef struct fum_splat {
  float center[3];            /* camera space */
  float sigma;                /* along the view, m */
  float width;                /* sigma across the view: at least 0.6 of a pixel */
  float optical_depth;        /* through the centre, lowered when it was widened */
  float reach;                /* m along the view beyond which it holds nothing that is seen */
  float range;                /* distance of the centre, in an orthographic view its depth */
  float self_shade;           /* factor on what it scatters, of particles thinner than a pixel; 1 else */
  int32_t lower[2], upper[2]; /* pixels of the footprint, upper not included; empty if it isn't seen */
} fum_splat;

typedef struct fum_splats {
  int64_t count;
  fum_splat *splats;     /* [count] in the octree's order */
  int64_t seen_count;    /* those with pixels */
  int32_t columns, rows; /* of tiles */
  int64_t *tile_begins;  /* [columns rows + 1] into tile_splats */
  uint32_t *tile_splats; /* splats of each tile, in the octree's order */
} fum_splats;

/* `thinnest` as in fum_slabs_find. */
int32_t fum_splats_find(fum_context *context, const fum_octree *octree, const fum_view *view, float footprint_sigmas,
                        float thinnest, fum_splats *out_splats);
void fum_splats_free(fum_context *context, fum_splats *splats);

#endif
