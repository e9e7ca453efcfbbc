/* SPDX-License-Identifier: GPL-3.0-or-later */
/* Particles that share a small cell, taken as one Gaussian: rough, but hardly slower than reading them. */
#ifndef FUM_OCTREE_BUNCH_H
#define FUM_OCTREE_BUNCH_H

#include "octree/octree.h"

typedef struct fum_bunch_options {
  float sigma_scale; /* factor on every particle's sigma */
  float side;        /* of a cell at most, in sigmas of the narrowest particle thereabouts */
} fum_bunch_options;

/* Fewer particles in fewer nodes, without indices: Gaussians with the mass (optical depth times sigma^2), centroid
 * and second moments of each cell's particles. NULL when there would be more than half as many. */
int32_t fum_octree_bunch(fum_context *context, const fum_octree *octree, const fum_bunch_options *options,
                         fum_octree **out_bunched);

#endif
