/* SPDX-License-Identifier: GPL-3.0-or-later */
/* Beams: bundles of neighbouring segments that go through the octree together. A walk hands out, nearest first, the
 * particles that can matter to any segment of the beam. */
#ifndef FUM_OCTREE_BEAM_H
#define FUM_OCTREE_BEAM_H

#include "base/vector.h"
#include "octree/octree.h"

/* Distance in sigmas beyond which a leaf whose particles add up to `optical_depth` is not heard. */
float fum_cutoff_sigmas(float optical_depth, float transmittance_error);

/* Distance in metres over which each node's particles are heard, [node_count]: each node's own, never one for all. */
int32_t fum_reach_find(fum_context *context, const fum_octree *octree, float transmittance_error, float **out_reaches);

/* Every node's reach becomes the largest of its own and all below it. */
void fum_reach_raise(const fum_octree *octree, float *reaches);

/* A tapered cylinder: at distance s from `start` along `axis`, all segments of the beam run within radius + slope s of
 * the axis, for s from `first` to `last`. */
typedef struct fum_beam {
  fum_vec3 start, axis; /* axis is a unit vector */
  float first, last;    /* m along the axis; last may be INFINITY */
  float radius, slope;
} fum_beam;

/* Called with nodes near the beam, roughly from its start outwards. `reach` holds for all of a node's particles.
 * Returns false to end the walk. */
typedef bool (*fum_beam_visit)(void *user, const fum_octree_node *node, float reach);

/* Hands out nodes that hold at most `largest` particles, and leaves. */
void fum_beam_walk(const fum_octree *octree, const float *reaches, uint32_t largest, const fum_beam *beam,
                   fum_beam_visit visit, void *user);

/* Largest distance from the axis, at distance s along it, at which something that is heard over `reach` matters. */
static inline float fum_beam_hearing(const fum_beam *beam, float s, float reach) {
  const float slack = fabsf(beam->slope) * (reach + beam->radius);
  const float radius = beam->radius + beam->slope * s + slack;
  return reach + (radius > 0.0F ? radius : 0.0F);
}

#endif
