/* SPDX-License-Identifier: GPL-3.0-or-later */
/* Light between the camera and the smoke: optical depth to each light, sampled on a lattice that follows the view.
 *
 * The optical depth to a light is a sum of Gaussian shapes, hence nearly band-limited at the particles' sigma: sampled
 * about a sigma apart on the faces of the slabs and interpolated as optical depth, not as transmittance, it is known
 * everywhere, inside particles too. How many particles there are doesn't matter (DESIGN.md, section 2). */
#ifndef FUM_LIGHTING_LATTICE_H
#define FUM_LIGHTING_LATTICE_H

#include "lighting/gather.h"
#include "lighting/hidden.h"
#include "lighting/lamps.h"

typedef struct fum_lattice {
  int32_t face_count, lamp_count;
  fum_lattice_face *faces; /* [face_count] */
  int64_t sample_count;    /* over all faces, lit or not */
  int64_t lit_count;
  uint32_t *samples; /* [lit_count] those that are lit, group by group */
  int64_t group_count;
  uint32_t *group_begins; /* [group_count + 1] in samples: neighbours, FUM_GROUP_SIZE at most */
  float *depths; /* NULL before they are lit. [lamp_count][sample_count] optical depth to the light, or that per metre,
                    as coefficients of splines (lattice_spline.h); NaN where it isn't lit */
  fum_hidden hidden;
  float *visible; /* the same at the samples: share of the light that solids let through; NULL without solids */
} fum_lattice;

/* Optical depth has a tip at a small light amid smoke, where it is nothing. Divided by the distance to the light it
 * runs smoothly past it: so it is held for lights with a position and a single sample. */
static inline bool fum_lattice_is_per_metre(const fum_lamp *lamp) {
  return lamp->sample_count == 1 && (lamp->desc.type == FUM_LIGHT_POINT || lamp->desc.type == FUM_LIGHT_SPOT);
}

/* Places samples wherever a particle's footprint (in sigmas) comes near and the camera sees something. */
int32_t fum_lattice_place(fum_context *context, const fum_octree *octree, const fum_view *view, const fum_slabs *slabs,
                          float footprint_sigmas, float tolerance, fum_lattice *out_lattice);

/* Lights the samples of a lattice that was placed. `gathering` comes without receivers. */
int32_t fum_lattice_light(const fum_gathering *gathering, const fum_view *view, const fum_slabs *slabs,
                          const fum_lamps *lamps, fum_lattice *lattice);
/* Forgets the light, not the samples. */
void fum_lattice_forget(fum_context *context, fum_lattice *lattice);
/* Forgets what only lighting asks for. */
void fum_lattice_settle(fum_context *context, fum_lattice *lattice);
void fum_lattice_free(fum_context *context, fum_lattice *lattice);

#endif
