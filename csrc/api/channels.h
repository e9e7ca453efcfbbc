/* SPDX-License-Identifier: GPL-3.0-or-later */
/* Red, green and blue light where smoke weakens them by different shares: each is rendered in a scene of its own, the
 * same but for the particles' densities. */
#ifndef FUM_API_CHANNELS_H
#define FUM_API_CHANNELS_H

#include "scene/scene.h"

typedef struct fum_channels {
  int32_t count;        /* scenes that differ: 1 where extinction is grey; 0: not known yet */
  int32_t of[3];        /* which of them red, green and blue are rendered in */
  fum_scene *scenes[3]; /* [count] the scene itself, or one made from it */
  float *densities[3];  /* [particle_count] of those that were made; NULL: the scene itself */
} fum_channels;

/* Brings the caches of the scene and its channels up to date; gives the channels, which the scene's caches keep. */
int32_t fum_channels_update(fum_scene *scene, const fum_settings *settings, const fum_channels **out_channels);

/* Frees the scenes that were made and their caches. */
void fum_channels_free(fum_context *context, fum_channels *channels);

#endif
