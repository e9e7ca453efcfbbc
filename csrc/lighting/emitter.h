/* SPDX-License-Identifier: GPL-3.0-or-later */
/* Lights as solvers see them: sample points (or directions) that each shine on a receiver with a known strength. */
#ifndef FUM_LIGHTING_EMITTER_H
#define FUM_LIGHTING_EMITTER_H

#include "lighting/environment.h"

/* A sample of a light: a point in local space, or a direction for a sun. */
typedef struct fum_emitter {
  bool is_directional;
  fum_vec3 position;  /* local space */
  fum_vec3 direction; /* unit, towards the light; of a directional one */
} fum_emitter;

/* A light in local space; of an environment what shines in one channel on particles of one anisotropy, or one part. */
typedef struct fum_lamp {
  fum_light_desc desc;
  int32_t index, light;     /* in the list of lamps, of the scene's light */
  float color[3];           /* what factors are multiplied with */
  double origin[3];         /* world position of local zero */
  fum_vec3 position;        /* local space */
  fum_vec3 right, up, back; /* unit axes of the light */
  fum_vec3 spot_rows[3];    /* the spot's own coordinates of a direction, scale included */
  int32_t sample_count;
  bool lights_smoke;                  /* shines on any that the camera sees; set by fum_lamps_find */
  const fum_environment *environment; /* borrowed: samples are its parts; NULL: another light */
  int32_t channel;                    /* whose irradiances the parts are weighted with */
  float anisotropy;                   /* of the particles that an environment's lamp is for */
} fum_lamp;

/* `bounds` is the box of all receivers, lower then upper, in local space: a soft light that looks small from everywhere
 * in it takes fewer samples, as its angular radius grows from 2 degrees (1) to 8 degrees (max_samples when 16). */
void fum_lamp_init(const fum_light_desc *desc, const double origin[3], const float bounds[6], int32_t max_samples,
                   fum_lamp *out_lamp);

/* Sample `index` of the light. The same light gives the same samples in every frame. */
fum_emitter fum_lamp_sample(const fum_lamp *lamp, int32_t index);

/* What the sample sends to a point, as a factor on the light's colour: irradiance on a surface facing the sample, its
 * share of the whole light. Sums over the samples to what BLENDER.md measured of Cycles for each type of light. */
float fum_emitter_irradiance(const fum_lamp *lamp, const fum_emitter *emitter, fum_vec3 point);

/* The same at points, places[axis][k] of point k. */
void fum_emitter_irradiances(const fum_lamp *lamp, const fum_emitter *emitter, const float *const places[3],
                             int64_t count, float *out_irradiances);

/* Way from a point to a sample of a light. */
typedef struct fum_way {
  fum_vec3 direction; /* unit */
  float length;       /* m; INFINITY of a directional light */
} fum_way;

static inline fum_way fum_emitter_way(const fum_emitter *emitter, fum_vec3 point) {
  if (emitter->is_directional) return (fum_way){emitter->direction, INFINITY};
  const fum_vec3 line = fum_sub(emitter->position, point);
  const float length = fum_length(line);
  return (fum_way){length > 0.0F ? fum_scaled(line, 1.0F / length) : (fum_vec3){0.0F, 0.0F, 1.0F}, length};
}

/* Share of its radiance that an area light sends at this cosine to its axis, above 0. */
float fum_lamp_spread(const fum_lamp *lamp, float cosine);

#endif
