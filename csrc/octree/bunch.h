/* SPDX-License-Identifier: GPL-3.0-or-later */
/* Particles that share a small cell, taken as one Gaussian: rough, but hardly slower than reading them. */
#ifndef FUM_OCTREE_BUNCH_H
#define FUM_OCTREE_BUNCH_H

#include "octree/octree.h"

/* How wide particles may look to a camera that bunches are made for. */
typedef struct fum_bunch_sight {
  float depth[4];    /* factors of x, y, z and 1 that make up a place's depth; in an orthographic view it is 1 */
  float least, most; /* sigma over depth */
} fum_bunch_sight;

typedef struct fum_bunch_options {
  float sigma_scale;            /* factor on every particle's sigma */
  float side;                   /* of a cell at most, in sigmas of the narrowest particle thereabouts */
  float most_left;              /* share of the particles; where more would be left they stay as they are */
  bool keeps_members;           /* of each bunch the number and the index of the first are asked for */
  const fum_bunch_sight *sight; /* others stay by themselves; NULL: none do */
} fum_bunch_options;

/* Fewer particles in fewer nodes: Gaussians with the mass (optical depth times sigma^2), centroid and second moments of
 * each cell's particles. NULL when too many would be left. */
int32_t fum_octree_bunch(fum_context *context, const fum_octree *octree, const fum_bunch_options *options,
                         fum_octree **out_bunched);

#endif
