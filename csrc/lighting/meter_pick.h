/* SPDX-License-Identifier: GPL-3.0-or-later */
/* The particles that the meter looks at. */
#ifndef FUM_LIGHTING_METER_PICK_H
#define FUM_LIGHTING_METER_PICK_H

#include "octree/octree.h"

/* A random sample of an octree's particles. What hangs on a particle's identity alone stays the same from frame to
 * frame, wherever it moves and whatever is born and dies around it, so that figures don't jump. */
typedef struct fum_meter_picks {
  int64_t count;
  uint64_t *keys;  /* [count] ascending random numbers, each its particle's own */
  uint32_t *ranks; /* [count] in the octree's order */
} fum_meter_picks;

/* Those with the smallest keys: about `most`, all where there are fewer. */
int32_t fum_meter_pick(fum_context *context, const fum_scene *scene, const fum_octree *octree, int64_t most,
                       fum_meter_picks *out_picks);
void fum_meter_picks_free(fum_context *context, fum_meter_picks *picks);

#endif
