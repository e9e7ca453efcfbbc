/* SPDX-License-Identifier: GPL-3.0-or-later */
/* An octree of some of the particles of another. */
#ifndef FUM_OCTREE_PICK_H
#define FUM_OCTREE_PICK_H

#include "octree/octree.h"

/* Those of `octree` that are picked, [count], in the same cells and with boxes of their own; without indices. */
int32_t fum_octree_pick(fum_context *context, const fum_octree *octree, const uint8_t *is_picked,
                        fum_octree **out_picked);

#endif
