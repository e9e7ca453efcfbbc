/* SPDX-License-Identifier: GPL-3.0-or-later */
/* What is lit through: the density octree with the paper's controls, its particles laid out in runs. */
#ifndef FUM_LIGHTING_MEDIUM_H
#define FUM_LIGHTING_MEDIUM_H

#include "lighting/runs.h"
#include "octree/merge.h"

/* Nodes of at most this many particles, and leaves, are cut into runs of neighbours. */
enum { FUM_PACKET_SIZE = 256 };

typedef struct fum_medium {
  uint64_t sets;            /* shadow_sets of the particles */
  const fum_octree *octree; /* of the particles */
  fum_octree *merged;       /* of fewer, which do as well; NULL: there are none */
  float bunch_side;         /* in sigmas, of the cells of... */
  fum_octree *bunched;      /* ...fewer still, for what may be rougher; NULL: there are none */
  float sigma_scale;        /* intersection test size */
  float depth_scale;        /* shadowing density times sigma_scale: a wider particle of the same density is thicker */
  float depth_limit;        /* optical depth above which a receiver counts as dark: the walk ends early */
  double mass;              /* sum of optical depths times sigma^2 over the casters, scales included, m^2 */
  double thickness;         /* extinction times sigma, mean over the smoke */
  float error;              /* of the transmittance, that what is left out may cause */
  fum_run *runs;            /* NULL: not laid out yet */
  fum_spheres spheres;
  uint32_t *first_runs; /* [node_count] of nodes that were cut */
  float *reaches;       /* [node_count] m, as of fum_reach_find, for runs instead of leaves */
} fum_medium;

/* What is walked through. */
static inline const fum_octree *fum_medium_casters(const fum_medium *medium) {
  return medium->merged != NULL ? medium->merged : medium->octree;
}

/* Merges close particles of a medium whose octree (with its sums), scales and limit are set. `transmittance_error` is
 * what may be lost by not hearing far particles, and half as much again by merging. */
int32_t fum_medium_begin(fum_context *context, float transmittance_error, fum_medium *medium);

/* Lays out the runs, unless they are there. */
int32_t fum_medium_lay_runs(fum_context *context, fum_medium *medium);

/* Finds `bunched` for cells this wide, unless it is known. */
int32_t fum_medium_bunch(fum_context *context, float side, fum_medium *medium);

/* Forgets `bunched`: a tenth of what a picture takes. */
void fum_medium_forget_bunches(fum_context *context, fum_medium *medium);

void fum_medium_end(fum_context *context, fum_medium *medium);

#endif
