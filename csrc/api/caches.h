/* SPDX-License-Identifier: GPL-3.0-or-later */
/* What is built from a scene's particles and meshes, kept until they change. */
#ifndef FUM_API_CACHES_H
#define FUM_API_CACHES_H

#include "api/channels.h"
#include "lighting/media.h"
#include "solid/solid.h"

typedef struct fum_caches {
  fum_octree *all;      /* every particle that the camera sees: what is lit and drawn */
  fum_solids *solids;   /* NULL: no triangle */
  bool borrows_solids;  /* from the scene that a colour channel's is made from */
  fum_octree **casters; /* [media.count] what blocks lights: `all`, or octrees of their own where that is subsampled, or
                           seen by the camera or blocking in part */
  fum_media media;      /* of `casters` */
  int32_t leaf_size;
  float subsampling;
  fum_channels channels; /* of a scene that isn't one itself */
  double build_s;        /* that the last fum_caches_update took */
} fum_caches;

/* Builds what is missing or was built with other options, and what blocks the lights there are. */
int32_t fum_caches_update(fum_scene *scene, const fum_settings *settings);

/* Makes the media of updated caches, for `error` of the transmittance, unless they are there already. */
int32_t fum_caches_find_media(fum_scene *scene, const fum_settings *settings, float error);

#endif
