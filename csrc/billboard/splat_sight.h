/* SPDX-License-Identifier: GPL-3.0-or-later */
/* What the camera sees of single particles, before they are sorted into tiles. */
#ifndef FUM_BILLBOARD_SPLAT_SIGHT_H
#define FUM_BILLBOARD_SPLAT_SIGHT_H

#include "billboard/splat_tiles.h"

/* Reach along the view over the footprint's sigmas: what lies beyond isn't lost, it is taken to be at the ends. */
static const double FUM_SIGHT_ALONG = 0.72;

/* Pixels beyond which outlines aren't followed. */
static const double FUM_SIGHT_BEYOND = 1e5;

/* What all particles are seen by. */
typedef struct fum_sight {
  const fum_octree *octree;
  const fum_view *view;
  const fum_slabs *slabs;
  const fum_splats_options *options;
  double pixels_per_unit[2]; /* of the window */
  double pixel;              /* width of the wider side of a pixel at unit depth */
  float slab_starts[FUM_SLAB_STARTS];
} fum_sight;

void fum_sight_find(const fum_octree *octree, const fum_view *view, const fum_slabs *slabs,
                    const fum_splats_options *options, fum_sight *out);

/* Particle `i` of the octree, in double precision. `out_streak` NULL: none are smeared; `out_stretch` is for bunches.
 */
fum_splat fum_sight_splat(const fum_sight *sight, int64_t i, fum_streak *out_streak, fum_stretch *out_stretch);

/* Several splats. */
typedef struct fum_sight_out {
  fum_splat *splats;
  fum_stretch *stretches; /* NULL: all are round */
  fum_touched *touched;
} fum_sight_out;

/* The particles from `begin` on, none of which is smeared. */
typedef void (*fum_sight_fn)(const fum_sight *sight, int64_t begin, int32_t count, const fum_sight_out *out);

/* The loop for this processor. */
fum_sight_fn fum_sight_get(void);

#endif
