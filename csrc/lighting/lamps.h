/* SPDX-License-Identifier: GPL-3.0-or-later */
/* The scene's lights as lamps. An environment gives several: one for each channel, unless all of it has one colour, and
 * each of the particles' anisotropies, for the mean of what passes smoke differs between them. They come one after the
 * other and share their directions. */
#ifndef FUM_LIGHTING_LAMPS_H
#define FUM_LIGHTING_LAMPS_H

#include "lighting/emitter.h"
#include "octree/octree.h"

typedef struct fum_lamps {
  int32_t count, light_count;
  fum_lamp *items;               /* [count] by light */
  fum_environment *environments; /* [light_count] of lights that are none, nothing */
} fum_lamps;

/* In the local space of the receivers. */
int32_t fum_lamps_find(const fum_scene *scene, const fum_octree *receivers, int32_t max_samples, fum_lamps *out_lamps);
void fum_lamps_free(fum_context *context, fum_lamps *lamps);

/* How many lamps from this one on look the same ways: those of an environment; else 1. */
int32_t fum_lamps_alike(const fum_lamps *lamps, int32_t first);

/* The largest such number; at least 1. */
int32_t fum_lamps_most_alike(const fum_lamps *lamps);

/* Samples of all lights: those of lamps that look the same ways count once. */
int32_t fum_lamps_sample_count(const fum_lamps *lamps);

/* Goes through lamps that shine alike on all particles; each part of an environment counts as a sun of its own. Starts
 * as zeros. */
typedef struct fum_lamp_walk {
  fum_lamp lamp;
  int32_t next, part; /* lamp, and part of it */
} fum_lamp_walk;

/* Steps on to walk->lamp; false at the end. */
bool fum_lamps_walk(const fum_lamps *lamps, fum_lamp_walk *walk);

#endif
