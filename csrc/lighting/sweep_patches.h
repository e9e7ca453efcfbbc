/* SPDX-License-Identifier: GPL-3.0-or-later */
/* A light's view of smoke and receivers, cut into patches that are worked on one by one: each has a plane of its own
 * that faces the light, so that footprints are right at every angle, and lists of the leaves whose casters may reach
 * into it and of those that may have receivers in it. */
#ifndef FUM_LIGHTING_SWEEP_PATCHES_H
#define FUM_LIGHTING_SWEEP_PATCHES_H

#include "lighting/receivers.h"
#include "lighting/sweep_view.h"

/* Casters whose sigmas, as seen from the light, are alike: they share a grid. */
typedef struct fum_sweep_level {
  float smallest, largest; /* sigmas, in tangents or m; casters from smallest on and below largest */
  float cell;              /* between grid lines, in the same unit */
  float slab;              /* between faces, in ranges */
  float first;             /* range of face 0 */
  double begin;            /* m from a light that isn't parallel: receivers nearer than this see none of the casters */
  int32_t slab_count;
} fum_sweep_level;

typedef struct fum_sweep_patch {
  int64_t index, leaf_count;
} fum_sweep_patch;

typedef struct fum_sweep_patches {
  int64_t count;
  fum_sweep_patch *order;                   /* [count] those with most leaves first */
  int64_t *caster_begins, *receiver_begins; /* [count + 1] */
  uint32_t *casters;                        /* leaves of their octree */
  uint32_t *receivers;                      /* nodes of theirs, with... */
} fum_sweep_patches;

/* ...this where the whole node is in the patch. */
static const uint32_t FUM_SWEEP_WHOLE = UINT32_C(1) << 31;

/* A ball around the centres of a node. */
static inline fum_vec3 fum_sweep_middle(const fum_octree_node *node) {
  const float *l = node->lower, *u = node->upper;
  return (fum_vec3){0.5F * (l[0] + u[0]), 0.5F * (l[1] + u[1]), 0.5F * (l[2] + u[2])};
}

static inline float fum_sweep_radius(const fum_octree_node *node) {
  const float *l = node->lower, *u = node->upper;
  return 0.5F * fum_length((fum_vec3){u[0] - l[0], u[1] - l[1], u[2] - l[2]});
}

/* Sigmas along the rays over which a caster is spread; what lies beyond is at its ends. */
static const float FUM_SWEEP_SPREAD = 3.3F;

/* Grid lines around a point that it is read from, and one for rounding. */
static const float FUM_SWEEP_MARGIN = 3.0F;

/* Lays the patches of a level over the view's faces. False if they would be too many. */
bool fum_sweep_lay(const fum_sweep_level *level, fum_sweep_view *view, int64_t *out_count);

int32_t fum_sweep_sort(fum_context *context, const fum_medium *medium, const fum_receivers *receivers,
                       const uint8_t *is_lit, const fum_sweep_view *view, const fum_sweep_level *level,
                       fum_sweep_patches *patches);
void fum_sweep_patches_free(fum_context *context, fum_sweep_patches *patches);

#endif
