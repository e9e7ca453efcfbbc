/* SPDX-License-Identifier: GPL-3.0-or-later */
/* Rays at times of the shutter and through places of the aperture, and the optical depth of moving particles along
 * them, for the meter of blur. */
#ifndef FUM_BILLBOARD_BLUR_RAYS_H
#define FUM_BILLBOARD_BLUR_RAYS_H

#include <stdint.h>

/* A time of the shutter, 0 to 1, and a place of the unit disc that the aperture is taken for. */
typedef struct fum_blur_instant {
  double time, lens[2];
} fum_blur_instant;

/* Of `pictures` (1, 4 or 16) each has one of as many parts of the shutter and, in another order, of the aperture: the
 * instant at `within` (0 to 1) the parts of one of them. */
fum_blur_instant fum_blur_find_instant(int32_t pictures, int32_t picture, const double within[3]);

/* Van der Corput's sequence. */
double fum_radical_inverse(uint32_t base, uint32_t index);

/* Entries of the arrays behind the last particle that may be read. */
enum { FUM_BLUR_PAD = 16 };

/* Particles in camera space: where they are when the shutter opens, and how they move until it closes. What is behind
 * the last has an optical depth of 0. */
typedef struct fum_blur_particles {
  int64_t count;
  float *x, *y, *z;
  float *move_x, *move_y, *move_z;
  float *inverse_sigmas;
  float *optical_depths; /* through their centres */
} fum_blur_particles;

/* A ray at a time of the shutter, 0 (open) to 1, from a point of the aperture; its direction is a metre deep. */
typedef struct fum_blur_ray {
  float time;
  float start[3], direction[3];
  float near, far; /* depths between which smoke counts, m */
} fum_blur_ray;

typedef float (*fum_blur_sum_fn)(const fum_blur_particles *particles, const fum_blur_ray *ray);

/* The loop for this processor. */
fum_blur_sum_fn fum_blur_sum_get(void);

#endif
