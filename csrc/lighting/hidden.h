/* SPDX-License-Identifier: GPL-3.0-or-later */
/* How much smoke is in front of the samples of light: which stand so deep behind it that the camera can't see anything
 * of what they light. */
#ifndef FUM_LIGHTING_HIDDEN_H
#define FUM_LIGHTING_HIDDEN_H

#include "lighting/slabs.h"

/* The samples on one face: a rectangle of them, of which those near smoke are lit. */
typedef struct fum_lattice_face {
  float origin[2];       /* window coordinates of sample 0, 0 */
  float spacing[2];      /* in window coordinates: across, up */
  int32_t columns, rows; /* 0, 0: no samples here */
  int64_t first;         /* index of sample 0, 0 */
  bool is_on_pixels;     /* closer ones wouldn't be seen */
} fum_lattice_face;

/* Optical depth towards the camera at every FUM_HIDDEN_STEP-th sample of every FUM_HIDDEN_STEP-th face. It grows along
 * each ray, so what is dark on one face is dark on all faces behind. */
enum { FUM_HIDDEN_STEP = 4 };

typedef struct fum_hidden {
  int32_t face_count;
  const fum_lattice_face *faces; /* [face_count], the lattice's */
  int64_t *firsts; /* [face_count] index of the face's first value; used for every FUM_HIDDEN_STEP-th face */
  float *depths;   /* NULL: nothing is known to be hidden */
  float limit;     /* optical depth from which on nothing shows */
} fum_hidden;

/* `octree` of all particles. Knows nothing where smoke is cut by the near end of the clip range,
 * nor where it has holes. */
int32_t fum_hidden_find(fum_context *context, const fum_octree *octree, const fum_view *view, const fum_slabs *slabs,
                        const fum_lattice_face *faces, float tolerance, fum_hidden *out_hidden);
void fum_hidden_free(fum_context *context, fum_hidden *hidden);

/* Is the sample at (u, v) of a face hidden, and all around it? */
bool fum_hidden_ask(const fum_hidden *hidden, int32_t face, float u, float v);

/* Could any sample in a rectangle of the window be? */
bool fum_hidden_touches(const fum_hidden *hidden, int32_t face, const float lower[2], const float upper[2]);

/* Optical depth towards the camera about a place of the window and a range, roughly: the nearest samples' on the faces
 * before and behind. Only where hidden->depths aren't NULL. */
double fum_hidden_depth(const fum_hidden *hidden, const fum_slabs *slabs, const double window[2], double range);

#endif
