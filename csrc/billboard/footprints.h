/* SPDX-License-Identifier: GPL-3.0-or-later */
/* How far out particles are drawn. */
#ifndef FUM_BILLBOARD_FOOTPRINTS_H
#define FUM_BILLBOARD_FOOTPRINTS_H

typedef struct fum_footprints {
  double sigmas;      /* one of optical depth 1; others so that as much of them lies outside... */
  double thin_sigmas; /* ...but at least so far */
  double cut;         /* share of the first that lies outside */
  double thin;        /* optical depth of those that are drawn as far as thin ones */
  double per_kept;    /* what is within thin_sigmas times this is all of a Gaussian */
} fum_footprints;

fum_footprints fum_footprints_find(double sigmas, double thin_sigmas);

/* Sigmas at which a particle ends. What is cut off a thin one is seen nowhere but adds up where there are many: it is
 * spread over what is left. */
double fum_footprints_end(const fum_footprints *footprints, double *optical_depth);

#endif
