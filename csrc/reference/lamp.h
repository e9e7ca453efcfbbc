/* SPDX-License-Identifier: GPL-3.0-or-later */
/* The reference's own lights: what shines on a point, sample by sample, in double precision. */
#ifndef FUM_REFERENCE_LAMP_H
#define FUM_REFERENCE_LAMP_H

#include "scene/scene.h"

/* Light of one sample: where it comes from and its irradiance on a surface that faces it, before smoke and solids, as a
 * factor on the light's colour. */
typedef struct fum_shine {
  double direction[3]; /* unit, from the point towards the light */
  double distance;     /* m; INFINITY for a sun */
  double strength;
  double tint[3]; /* what of it is in each channel */
} fum_shine;

typedef struct fum_reference_lamp {
  const fum_light_desc *desc;
  double position[3];              /* relative to the scene's origin */
  double right[3], up[3], back[3]; /* unit axes */
  double local_from_world[3][3];   /* the spot's own coordinates of a direction, scale included */
  int32_t side;                    /* its surface is divided into side x side patches; 1: a point or a direction */
  int32_t sky_count;               /* of an environment */
  fum_shine *sky;                  /* [sky_count] what shines from all around, on every point */
} fum_reference_lamp;

typedef void (*fum_shine_fn)(void *user, const fum_shine *shine);

/* `samples` of a light with a size, rounded up to a square. */
fum_reference_lamp fum_reference_lamp_make(const fum_light_desc *desc, const double origin[3], int32_t samples);

/* Finds the sky of an environment's lamp: side x side patches of the same size, or of its picture's pixels, each pixel
 * if there are no more of them. Freed with fum_free. */
int32_t fum_reference_sky_find(fum_context *context, fum_reference_lamp *lamp);

/* How many samples the lamp has. */
int32_t fum_reference_lamp_samples(const fum_reference_lamp *lamp);

/* Calls `visit` for every sample that shines on the point. Near an area light its patches are divided further, so that
 * their size stays small against the distance. */
void fum_reference_lamp_visit(const fum_reference_lamp *lamp, const double point[3], fum_shine_fn visit, void *user);

/* Parameters along start + t direction at which the light may change abruptly: nearest to it, nearest to its axis, in
 * its plane, at the rim of its cone. Gives how many. */
enum { FUM_LAMP_BREAKS = 5 };
int fum_reference_lamp_breaks(const fum_reference_lamp *lamp, const double start[3], const double direction[3],
                              double out_breaks[FUM_LAMP_BREAKS]);

#endif
