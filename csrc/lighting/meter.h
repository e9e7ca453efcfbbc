/* SPDX-License-Identifier: GPL-3.0-or-later */
/* The meter: the light of a random sample of receivers, found again exactly and compared with what a render uses. */
#ifndef FUM_LIGHTING_METER_H
#define FUM_LIGHTING_METER_H

#include "lighting/lookup.h"
#include "lighting/truth.h"

/* Errors of transmittances through smoke to the lights, those of a light's sample points averaged. */
typedef struct fum_accuracy {
  int64_t count; /* receivers that any light shines on */
  double rms, p95, worst, bias;
  double level; /* RMS of the exact transmittances themselves */
} fum_accuracy;

/* A point at which transmittances are compared. */
typedef struct fum_meter_point {
  double position[3];      /* local space */
  uint32_t receiver;       /* in the octree's order, the particle that it is in... */
  int32_t light_set;       /* ...and what that is lit by */
  double window[2], range; /* of a point on a pixel's ray */
} fum_meter_point;

/* Chosen at random, by particles' identities: the same from frame to frame, as long as they are there and seen. */
typedef struct fum_meter {
  fum_context *context;
  const fum_lamps *lamps; /* borrowed */
  fum_viewpoint viewpoint;
  const fum_media *media; /* borrowed */
  fum_truth *truths;      /* [media->count] */
  double dark;            /* optical depth at which the truth may give up */
  int64_t count;
  fum_meter_point *points; /* [count] */
  double *exact, *found;   /* [lamps->count][count] what arrives past smoke... */
  double *sent;            /* ...of this; 0 where the light doesn't shine or isn't compared */
  double seconds;          /* that the meter has taken */
} fum_meter;

/* What the meter is told about a render. `error` of the transmittance is small against the errors to be found. */
typedef struct fum_meter_options {
  const fum_scene *scene;
  const fum_octree *octree; /* of the particles that points are chosen at */
  const fum_media *media;
  const fum_lamps *lamps;
  fum_viewpoint viewpoint; /* the camera's */
  double error;
} fum_meter_options;

/* Chooses particles. fum_meter_listen is to be given to the gathering that lights them. */
int32_t fum_meter_begin_particles(fum_context *context, const fum_meter_options *options, fum_meter *out_meter);

/* What is known of the smoke that the camera sees. */
typedef struct fum_meter_sight {
  const fum_view *view;
  double footprint_sigmas;   /* in which particles ask for light */
  const float *solid_depths; /* [height][width]; NULL: none */
  const fum_slabs *slabs;
  const fum_hidden *hidden; /* how much smoke is in front; found by walks where it doesn't know */
} fum_meter_sight;

/* Chooses points in smoke as the camera sees it: about a sigma around random particles, on pixels' rays, within the
 * footprint, and the rarer the more smoke is in front. What they are compared with is told by fum_meter_listen or,
 * after fum_meter_find_exact, by fum_meter_ask. */
int32_t fum_meter_begin_points(fum_context *context, const fum_meter_options *options, const fum_meter_sight *sight,
                               fum_meter *out_meter);
int32_t fum_meter_find_exact(fum_meter *meter);
void fum_meter_end(fum_meter *meter);

/* A fum_listen_fn; `user` is the meter. Takes what the light at a particle's centre is for its point. */
void fum_meter_listen(void *user, const fum_lamp *lamp, const fum_emitter *sample, const uint8_t *is_lit,
                      const float *depths);

/* Takes what the lattice says at the meter's points. */
void fum_meter_ask(fum_meter *meter, const fum_slabs *slabs, const fum_lattice *lattice);

int32_t fum_meter_read(const fum_meter *meter, fum_accuracy *out_accuracy);

#endif
