/* SPDX-License-Identifier: GPL-3.0-or-later */
/* Which samples of the lattice are needed: those around particles that the camera sees. */
#ifndef FUM_LIGHTING_LATTICE_MARKS_H
#define FUM_LIGHTING_LATTICE_MARKS_H

#include "lighting/lattice.h"

/* A bit for each sample: a word holds a block of 8 x 8 samples of a face, bit 8 row + column, so that what a particle
 * needs is in a few words. */
typedef struct fum_marks {
  _Atomic uint64_t *words;
  int64_t *firsts; /* [face_count + 1] of each face */
} fum_marks;

static inline int64_t fum_blocks_across(const fum_lattice_face *grid) {
  return (grid->columns + 7) / 8;
}

typedef struct fum_mark_task {
  const fum_octree *octree;
  const fum_view *view;
  const fum_slabs *slabs;
  const fum_lattice *lattice; /* with its faces */
  float footprint_sigmas;
} fum_mark_task;

/* All unset. */
int32_t fum_marks_begin(fum_context *context, const fum_lattice *lattice, fum_marks *out_marks);
void fum_marks_end(fum_context *context, fum_marks *marks);

/* Sets those that interpolation needs within the particles' footprints. */
int32_t fum_marks_set(fum_context *context, const fum_mark_task *task, fum_marks *marks);

/* Unsets those of samples that the camera can't see (lattice->hidden). */
void fum_marks_unset_hidden(fum_context *context, const fum_lattice *lattice, fum_marks *marks);

#endif
