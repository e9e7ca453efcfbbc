/* SPDX-License-Identifier: GPL-3.0-or-later */
/* Which samples of light stand so deep behind smoke that the camera can't see anything of what they light. */
#ifndef FUM_LIGHTING_HIDDEN_H
#define FUM_LIGHTING_HIDDEN_H

#include "lighting/lattice.h"

/* Optical depth towards the camera at every FUM_HIDDEN_STEP-th sample of every FUM_HIDDEN_STEP-th face. It grows along
 * each ray, so what is dark on one face is dark on all faces behind. */
enum { FUM_HIDDEN_STEP = 4 };

typedef struct fum_hidden {
  int64_t *firsts; /* [face_count] index of the face's first value; used for every FUM_HIDDEN_STEP-th face */
  float *depths;   /* NULL: nothing is known to be hidden */
  float limit;     /* optical depth from which on nothing shows */
} fum_hidden;

/* `octree` of all particles. Knows nothing where smoke is cut by the near end of the clip range. */
int32_t fum_hidden_find(fum_context *context, const fum_octree *octree, const fum_view *view, const fum_slabs *slabs,
                        const fum_lattice *lattice, float tolerance, fum_hidden *out_hidden);
void fum_hidden_free(fum_context *context, fum_hidden *hidden);

/* Is the sample at (u, v) of a face hidden, and all around it? */
bool fum_hidden_ask(const fum_hidden *hidden, const fum_lattice *lattice, int32_t face, float u, float v);

#endif
