/* SPDX-License-Identifier: GPL-3.0-or-later */
/* Runs of neighbours: halves of halves of a node's particles along the longest side. Cut in Morton order instead, a run
 * would often reach over a corner and be twice as long. */
#ifndef FUM_OCTREE_NEIGHBOURS_H
#define FUM_OCTREE_NEIGHBOURS_H

#include "octree/octree.h"

/* Reorders `count` particles of the octree so that each `size` of them, but the last ones, are neighbours. */
void fum_neighbours_sort(const fum_octree *octree, uint32_t size, uint32_t count, uint32_t *particles);

#endif
