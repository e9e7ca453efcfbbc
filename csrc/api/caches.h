/* SPDX-License-Identifier: GPL-3.0-or-later */
/* What is built from a scene's particles and meshes, kept until they change. */
#ifndef FUM_API_CACHES_H
#define FUM_API_CACHES_H

#include "lighting/medium.h"
#include "solid/solid.h"

typedef struct fum_caches {
  fum_octree *all;     /* every particle: what is lit and drawn */
  fum_octree *density; /* what casts shadows: `all`, or an octree of its own when subsampled */
  fum_solids *solids;  /* NULL: no triangle */
  fum_medium medium;   /* of `density`; no octree: not yet */
  int32_t leaf_size;
  float subsampling;
  double build_s; /* that the last fum_caches_update took */
} fum_caches;

/* Builds what is missing or was built with other options. */
int32_t fum_caches_update(fum_scene *scene, const fum_settings *settings);

/* Makes the medium of updated caches, for `error` of the transmittance, unless it is there already. */
int32_t fum_caches_find_medium(fum_scene *scene, const fum_settings *settings, float error);

#endif
