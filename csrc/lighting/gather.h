/* SPDX-License-Identifier: GPL-3.0-or-later */
/* Light gathered at receivers: every sample of a light, past solids (paper, 3.4) and through smoke. */
#ifndef FUM_LIGHTING_GATHER_H
#define FUM_LIGHTING_GATHER_H

#include "lighting/media.h"
#include "lighting/solver.h"
#include "solid/solid.h"

/* Turns what receivers from `first` on are sent by a sample of a light, irradiance [count], into what they make of it.
 */
typedef void (*fum_response_fn)(const void *user, const fum_emitter *emitter, int64_t first, int64_t count,
                                float *strengths);

/* Hears the optical depths that were found for a sample of a light, in receivers' order; only those that are lit count.
 */
typedef void (*fum_listen_fn)(void *user, const fum_lamp *lamp, const fum_emitter *sample, const uint8_t *is_lit,
                              const float *depths);

/* Where the camera sees particles from. */
typedef struct fum_viewpoint {
  bool is_directional;
  fum_vec3 position;  /* local space */
  fum_vec3 direction; /* unit, towards an orthographic camera */
} fum_viewpoint;

/* Unit direction from a point to the camera. */
fum_vec3 fum_direction_to_viewer(const fum_viewpoint *viewpoint, fum_vec3 point);

typedef struct fum_gathering {
  fum_context *context;
  fum_solver *solver;
  const fum_media *media;
  const fum_solids *solids;     /* NULL: none */
  float solid_shadow_intensity; /* share of the light that solids block */
  fum_receivers *receivers;
  const fum_viewpoint *viewpoint; /* that particles, and light from all around, are seen from; NULL: points */
  fum_response_fn response;       /* NULL: the light's samples count alike whatever they send; out is a transmittance */
  const void *response_user;
  fum_listen_fn listen; /* of fum_gather_light; NULL: nobody */
  void *listen_user;
} fum_gathering;

/* out_rgb [3 count], in receivers' order, is what arrives from the light; with `adds` that is added to it. */
int32_t fum_gather_light(const fum_gathering *gathering, const fum_lamp *lamp, const float progress[2], bool adds,
                         float *out_rgb);

/* For surfaces, on which solids' shadows have sharp edges: out_light[i] += what arrives, as a factor on the light's
 * colour, and out_clear[i] += what would arrive without smoke. Past solids a light with a size is seen as `fine_count`
 * samples; smoke is soft, and asked for those of the lamp. */
int32_t fum_gather_on_surfaces(const fum_gathering *gathering, const fum_lamp *lamp, int32_t fine_count,
                               const float progress[2], float *out_light, float *out_clear);

/* Optical depth through smoke and share that solids let through, [count of receivers] in receivers' order: means over
 * the light's samples, weighted with what each sends. `response` isn't used. `out_visible` may be NULL without solids.
 */
int32_t fum_gather_depths(const fum_gathering *gathering, const fum_lamp *lamp, const float progress[2],
                          float *out_depths, float *out_visible);

/* The same of an environment's lamps, `lamp_count` from `lamps` on, out_depths [lamp_count][count] and out_visible
 * alike. Samples are weighted with what smoke of the lamp's anisotropy scatters of them towards the viewpoint. */
int32_t fum_gather_around(const fum_gathering *gathering, const fum_lamp *lamps, int32_t lamp_count,
                          const float progress[2], float *out_depths, float *out_visible);

#endif
