/* SPDX-License-Identifier: GPL-3.0-or-later */
/* The pass Combined of the smoke, by either device. */
#ifndef FUM_API_COMBINE_H
#define FUM_API_COMBINE_H

#include "api/caches.h"
#include "api/lighting.h"
#include "lighting/meter.h"
#include "pass/edges.h"
#include "scene/view.h"

/* One call of fum_render: what it was asked for and what it has made so far. */
typedef struct fum_rendering {
  fum_context *context;
  fum_scene *scene;
  fum_settings settings;
  const fum_camera *camera;
  fum_view view;
  fum_solid_view solid;
  /* Passes; NULL: not needed. */
  float *combined; /* [height][width][4] */
  float *depth;    /* [height][width], as those below */
  float *depth_front, *depth_back;
  float *opacity;
  float *position; /* [height][width][3], as those below */
  float *emission; /* a part of combined */
  float *holdout;  /* of what is behind the smoke */
  float *shadow;   /* of smoke on solids */
  float *albedo;
  float *solid_shadow;         /* of solids on smoke */
  float *error;                /* [height][width] */
  float *vector;               /* [height][width][4] */
  float **lights;              /* [light_count] parts of combined */
  float **light_shadows;       /* [light_count] */
  float **light_solid_shadows; /* [light_count] */
  float channel_share;         /* of red, green and blue that are seen in this scene */
  int32_t crypto_count;
  float *crypto[FUM_MAX_RANK_PAIRS]; /* [crypto_count] [height][width][4] */
  struct fum_deep *deep;             /* the smoke in depth */
  /* [height][width] transmittance from the camera up to the nearer solid, and to what is beside it; NULL: not needed.
   */
  float *through[2];
  fum_render_stats stats;
} fum_rendering;

/* Every particle lit at its centre, billboards blended by OpenGL. */
int32_t fum_combine_with_gl(fum_rendering *r);

/* Particles added up in slabs, lit by a lattice or where that is enough at their centres. */
int32_t fum_combine_with_tiles(fum_rendering *r);

/* Sigmas out to which a particle is looked at: a quarter of the tolerance of its optical depth may lie outside, also
 * where its map is thickest at the border. */
float fum_footprint_sigmas(const fum_scene *scene, float tolerance);

/* Notes what lighting took. */
void fum_note_lighting(const fum_lighting *lighting, fum_rendering *r);

fum_viewpoint fum_find_viewpoint(const fum_view *view);
fum_meter_options fum_find_meter_options(const fum_rendering *r, const fum_lighting *lighting);
void fum_note_accuracy(const fum_accuracy *accuracy, fum_render_stats *stats);

#endif
