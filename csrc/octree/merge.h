/* SPDX-License-Identifier: GPL-3.0-or-later */
/* Neighbours that lie close together against their sigmas, each such bunch taken as one Gaussian. Not by distance from
 * a ray (a shadow ray has no far field), but where the optical depth changes too little on any segment. */
#ifndef FUM_OCTREE_MERGE_H
#define FUM_OCTREE_MERGE_H

#include "octree/octree.h"

/* How the merged octree will be looked at, and what it may cost. */
typedef struct fum_merge_options {
  float sigma_scale, depth_scale; /* factors on every particle's sigma and optical depth */
  float transmittance_error;
} fum_merge_options;

/* The same nodes with fewer particles, without indices; NULL when there would be hardly fewer. */
int32_t fum_octree_merge(fum_context *context, const fum_octree *octree, const fum_merge_options *options,
                         fum_octree **out_merged);

#endif
