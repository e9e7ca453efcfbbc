/* SPDX-License-Identifier: GPL-3.0-or-later */
/* Puts particles in Morton order. They are first dealt out by the highest bits of their codes, straight into the
 * octree; what shares those bits fits into a processor's cache and is sorted there by one thread. */
#ifndef FUM_OCTREE_ORDER_H
#define FUM_OCTREE_ORDER_H

#include "octree/cube.h"
#include "octree/source.h"

/* Finds how many particles go in, and their cube. */
int32_t fum_order_measure(fum_context *context, const fum_source *source, int64_t *out_count, fum_cube *out_cube);

/* Fills in an octree made for as many; ties keep the order of the source. Levels, [octree->count], say at which level a
 * particle and the one before part: 1 is that of the finest cells, 0 means that they share one. */
int32_t fum_order_fill(fum_context *context, const fum_source *source, const fum_cube *cube, fum_octree *octree,
                       uint8_t **out_levels);

#endif
