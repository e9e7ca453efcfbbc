/* SPDX-License-Identifier: GPL-3.0-or-later */
/* What the particles of an octree's nodes are together. */
#ifndef FUM_OCTREE_SUMS_H
#define FUM_OCTREE_SUMS_H

#include "octree/octree.h"

/* Finds octree->sums of an octree whose nodes are known, and which isn't one of points. */
int32_t fum_octree_sum(fum_context *context, fum_octree *octree);

#endif
