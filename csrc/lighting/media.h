/* SPDX-License-Identifier: GPL-3.0-or-later */
/* The smoke as the lights meet it: what blocks one need not block another. */
#ifndef FUM_LIGHTING_MEDIA_H
#define FUM_LIGHTING_MEDIA_H

#include "lighting/emitter.h"
#include "lighting/medium.h"

/* A medium for each choice of sets that lights make; without linking there is one. */
typedef struct fum_media {
  uint64_t present; /* shadow_sets that there are particles in */
  int32_t count;    /* at least 1 */
  fum_medium *items;
} fum_media;

/* Place of the medium that blocks the lamp. One that casts no shadows asks for none, and may get any. */
static inline int32_t fum_media_find(const fum_media *media, const fum_lamp *lamp) {
  const uint64_t wanted = lamp->desc.shadow_sets & media->present;
  int32_t k = media->count - 1;
  while (k > 0 && media->items[k].sets != wanted)
    k--;
  return k;
}

#endif
