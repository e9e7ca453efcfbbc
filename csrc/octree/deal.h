/* SPDX-License-Identifier: GPL-3.0-or-later */
/* Deals particles out into piles: those that share a cell, in the order in which they come. */
#ifndef FUM_OCTREE_DEAL_H
#define FUM_OCTREE_DEAL_H

#include "octree/cube.h"
#include "octree/source.h"

/* Piles are the cells of one level within one of a level above. */
typedef struct fum_deal {
  const fum_cube *cube;
  fum_cube_band band;
  int32_t piles;
  uint32_t *begins; /* [piles + 1] where each pile is in the octree */
  int blocks;       /* each dealt out by one thread */
  uint32_t *next;   /* [blocks][piles] where each block continues each pile */
} fum_deal;

/* For as many particles in a cell 2^above of the finest wide. */
int32_t fum_deal_begin(fum_context *context, const fum_cube *cube, int above, int64_t count, fum_deal *out_deal);
void fum_deal_end(fum_context *context, fum_deal *d);

/* Deals all of the source into an octree made for as many. */
int32_t fum_deal_source(fum_context *context, const fum_source *source, fum_deal *d, fum_octree *octree);

/* Deals all of `from` into a larger octree, from place `begin` on. */
int32_t fum_deal_octree(fum_context *context, const fum_octree *from, int64_t begin, fum_deal *d, fum_octree *octree);

#endif
