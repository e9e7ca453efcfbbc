/* SPDX-License-Identifier: GPL-3.0-or-later */
/* An octree's nodes around fewer particles. */
#ifndef FUM_OCTREE_THIN_H
#define FUM_OCTREE_THIN_H

#include "octree/octree.h"

/* The same nodes, in which leaf i has counts[i] particles, [node_count]; room for these, unwritten. */
int32_t fum_octree_thin(fum_context *context, const fum_octree *octree, const uint32_t *counts, fum_octree **out_thin);

/* Copies `count` particles from place `first` on to place `at` of another octree. */
void fum_octree_copy(const fum_octree *from, uint32_t first, uint32_t count, fum_octree *to, uint32_t at);

#endif
