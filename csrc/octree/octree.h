/* SPDX-License-Identifier: GPL-3.0-or-later */
/* The density octree (paper, 3.1): particles as points in Morton order, cells subdivided only where they hold more than
 * the leaf size. Loose: a particle's radius may reach over its cell; each node knows how far its own particles reach.
 */
#ifndef FUM_OCTREE_OCTREE_H
#define FUM_OCTREE_OCTREE_H

#include "scene/scene.h"

typedef struct fum_octree_node {
  float lower[3], upper[3]; /* box of the centres, local space */
  uint32_t begin, count;    /* its particles */
  uint32_t children;        /* index of the first child; children are consecutive. 0: a leaf */
  uint8_t octants;          /* bit o is set: there is a child in octant o (x is bit 0) */
} fum_octree_node;

/* What a node's particles are together. */
typedef struct fum_node_sums {
  float least_inverse, most_inverse; /* 1 / sigma of the widest and of the narrowest, 1/m */
  double depth, mass, sigma;         /* of optical depths, of those times sigma^2 (m^2), and of sigmas (m) */
} fum_node_sums;

/* Float arrays have this many readable entries behind their last, so that vector loads may run over. */
enum { FUM_OCTREE_PAD = 16 };

enum { FUM_STRETCHES = 5 };

typedef struct fum_octree {
  double origin[3];                       /* world position of local zero */
  int64_t count;                          /* particles */
  uint32_t *indices;                      /* [count] index that the particle was built with, in Morton order; of
                                             several that were merged 0, of a bunch that of one */
  uint32_t *members;                      /* [count] how many are in a bunch; NULL: one each */
  float *x, *y, *z;                       /* [count] local space */
  float *inverse_sigmas, *optical_depths; /* [count] of one particle, through its centre; NULL in an octree of points */
  float
      *stretches; /* [FUM_STRETCHES][count + FUM_OCTREE_PAD] what Gaussians that aren't round have of covariance beside
                     sigma^2 in all directions, m^2: xx, yy, xy, xz, yz; zz is -(xx + yy). NULL: all are round */
  int64_t node_count;
  fum_octree_node *nodes; /* node 0 is the root; a child comes after its parent; none if there are no particles */
  fum_node_sums *sums;    /* [node_count] of an octree that was built for particles, or for which fum_octree_sum found
                             them; else NULL */
} fum_octree;

/* How many particles the one at a place stands for. */
static inline uint32_t fum_octree_members(const fum_octree *octree, int64_t place) {
  return octree->members != NULL ? octree->members[place] : 1;
}

typedef struct fum_octree_options {
  int32_t leaf_size;
  float subsampling; /* share of the particles that go in, chosen by identity; their density is divided by it */
  const bool *takes; /* [sets of particles] which sets go in; NULL: all */
} fum_octree_options;

/* Octree of the scene's particles; indices are scene indices. */
int32_t fum_octree_build(const fum_scene *scene, const fum_octree_options *options, fum_octree **out_octree);

/* Octree of points without density, [3 count] relative to `origin`; indices are the points'. */
int32_t fum_octree_build_points(fum_context *context, const double origin[3], int64_t count, const float *positions,
                                int32_t leaf_size, fum_octree **out_octree);

/* Room for particles (`has_density`) or points; no nodes yet. */
int32_t fum_octree_create(fum_context *context, const double origin[3], int64_t count, bool has_density,
                          fum_octree **out_octree);
void fum_octree_destroy(fum_context *context, fum_octree *octree);

/* Finds the boxes of nodes whose particles and children are known. */
void fum_octree_bound(fum_context *context, fum_octree *octree);

#endif
