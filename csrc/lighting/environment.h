/* SPDX-License-Identifier: GPL-3.0-or-later */
/* Light from all around as a small set of directions, chosen by importance from what shines there alone: wherever the
 * camera looks, they stay the same. */
#ifndef FUM_LIGHTING_ENVIRONMENT_H
#define FUM_LIGHTING_ENVIRONMENT_H

#include "base/vector.h"
#include "scene/scene.h"

/* A part of the surroundings. */
typedef struct fum_sky {
  fum_vec3 direction;  /* unit, towards the middle of its energy */
  float irradiance[3]; /* on a surface that faces it, W/m^2: radiance times solid angle */
  float closeness;     /* mean cosine between the direction and what is shining around it; 1: a point */
  float spread;        /* sine of the same angle, over the root of 2 */
} fum_sky;

typedef struct fum_environment {
  int32_t count; /* 0: nothing shines */
  fum_sky *parts;
  int32_t fine_count; /* of a finer division, for what light in the clear scatters; 0: shines evenly from everywhere */
  fum_sky *fine_parts;
  float total[3]; /* sum of the irradiances */
  fum_vec3 mean;  /* mean of the directions, weighted with what they send: shorter than 1 */
} fum_environment;

/* Most parts that an environment is divided into. */
enum { FUM_MOST_SKY_PARTS = 1024 };

/* About `count` parts, and `fine_count`: as many as shine, and as the picture has pixels. Energy is conserved. */
int32_t fum_environment_choose(fum_context *context, const fum_light_desc *light, int32_t count, int32_t fine_count,
                               fum_environment *out_environment);
void fum_environment_free(fum_context *context, fum_environment *environment);

/* What smoke of this anisotropy scatters towards the unit direction `to_viewer` of light from a part, in one channel,
 * W / (m^2 sr): irradiance times phase function; of a part that is as wide as it is, and of one that is a point. */
float fum_sky_scatter_wide(const fum_sky *part, int32_t channel, float anisotropy, fum_vec3 to_viewer);
float fum_sky_scatter(const fum_sky *part, int32_t channel, float anisotropy, fum_vec3 to_viewer);

/* What all parts as points lack of all parts as wide as they are: the peak of a phase function may lie between
 * directions, or on one. It belongs to the part that is nearest to the peak. */
typedef struct fum_sky_peak {
  int32_t part;
  float lacking; /* W / (m^2 sr), or below 0 */
} fum_sky_peak;

fum_sky_peak fum_environment_peak(const fum_environment *environment, int32_t channel, float anisotropy,
                                  fum_vec3 to_viewer);

/* What part `part` counts: as a point, with what is lacking there. Sums over the parts to what they scatter as wide as
 * they are. */
static inline float fum_sky_weight(const fum_environment *environment, int32_t part, int32_t channel, float anisotropy,
                                   fum_vec3 to_viewer, const fum_sky_peak *peak) {
  const float scattered = fum_sky_scatter(&environment->parts[part], channel, anisotropy, to_viewer);
  return part == peak->part ? scattered + peak->lacking : scattered;
}

#endif
