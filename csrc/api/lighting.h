/* SPDX-License-Identifier: GPL-3.0-or-later */
/* Everything that lighting needs of a scene, set up once for a call. */
#ifndef FUM_API_LIGHTING_H
#define FUM_API_LIGHTING_H

#include "api/caches.h"
#include "lighting/gather.h"
#include "lighting/lamps.h"

typedef struct fum_lighting {
  const fum_media *media; /* the caches' */
  fum_receivers receivers;
  fum_lamps lamps;
  fum_solver solver;
  fum_gathering gathering;
} fum_lighting;

/* What a surface makes of light: the cosine to its normal, or 1 without normals. The user of fum_surface_respond. */
typedef struct fum_surface {
  const fum_octree *points;    /* the receivers' */
  const float *normals;        /* [3 points]; NULL: none */
  const fum_mesh *meshes;      /* the scene's... */
  const int32_t *mesh_indices; /* [points] ...and which one each point is on; NULL: every light shines on them */
  uint64_t light_sets;         /* of the light; with mesh_indices */
} fum_surface;

void fum_surface_respond(const void *user, const fum_emitter *emitter, int64_t first, int64_t count, float *strengths);

/* Largest error of a receiver's transmittance to a light. */
float fum_transmittance_error(const fum_settings *settings);

/* `receivers` is the octree of the points to be lit. The scene's caches must be current. */
int32_t fum_lighting_begin(fum_scene *scene, const fum_settings *settings, const fum_octree *receivers,
                           fum_lighting *out_lighting);
void fum_lighting_end(fum_context *context, fum_lighting *lighting);

#endif
