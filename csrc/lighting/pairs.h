/* SPDX-License-Identifier: GPL-3.0-or-later */
/* Optical depth of any particles along a segment (DESIGN.md, section 1).
 *
 * Along a segment with unit direction u, a particle at distance d from its line, with the ends at a and b measured from
 * the point nearest to it, in units of its sigma:
 *   tau = optical_depth exp(-d^2 / 2) (Phi(b) - Phi(a)) */
#ifndef FUM_LIGHTING_PAIRS_H
#define FUM_LIGHTING_PAIRS_H

#include <stdint.h>

/* Particles as the loop wants them. Arrays are padded with zero optical depth up to a multiple of FUM_PAIRS_PAD. */
typedef struct fum_sources {
  int32_t count;
  const float *x, *y, *z, *inverse_sigmas, *optical_depths;
} fum_sources;

enum { FUM_PAIRS_PAD = 16 };

typedef struct fum_segment {
  float origin[3];
  float direction[3]; /* unit */
  float length;       /* INFINITY towards a sun */
} fum_segment;

/* Sum over the sources of their optical depth along the segment. */
typedef float (*fum_pairs_fn)(const fum_sources *sources, const fum_segment *segment);

typedef struct fum_pairs {
  fum_pairs_fn line;    /* for sources that lie well within the segment: Phi(b) - Phi(a) taken as 1 */
  fum_pairs_fn segment; /* for any */
} fum_pairs;

/* The loops for this processor. */
const fum_pairs *fum_pairs_get(void);

#endif
