/* SPDX-License-Identifier: GPL-3.0-or-later */
/* What goes into an octree: particles of a scene, or points. It is read in blocks, each by one thread. */
#ifndef FUM_OCTREE_SOURCE_H
#define FUM_OCTREE_SOURCE_H

#include "octree/octree.h"

typedef struct fum_source {
  const fum_scene *scene;            /* NULL: points */
  const fum_octree_options *options; /* of particles */
  int64_t point_count;
  const float *points; /* [3 point_count] local space */
} fum_source;

/* How many may go in: all of the sets that do, before a share of them is chosen. */
int64_t fum_source_count(const fum_source *source);

/* Blocks that so many are worth: one for each thread, or one. */
static inline int fum_source_blocks(const fum_context *context, int64_t count) {
  const int64_t serial_below = 1 << 14;
  return count < serial_below ? 1 : fum_thread_count(context);
}

/* The first of `blocks` ends where the second begins, and so on. */
static inline int64_t fum_block_begin(int64_t count, int block, int blocks) {
  return count * block / blocks;
}

enum { FUM_SOURCE_STRETCH = 256 };

/* Goes through a block, a stretch of it at a time. */
typedef struct fum_source_reader {
  const fum_source *source;
  const fum_particles *set; /* NULL: points */
  const float *positions;   /* of the set, or the points */
  int32_t set_index;
  int64_t next;                         /* in the set, behind the stretch */
  int64_t left;                         /* in the block behind it */
  int64_t stretches;                    /* that were read */
  int32_t count;                        /* of the stretch, of those that go in */
  uint32_t numbers[FUM_SOURCE_STRETCH]; /* in the set */
  float places[3][FUM_SOURCE_STRETCH];  /* local space */
} fum_source_reader;

void fum_source_begin(const fum_source *source, int block, int blocks, fum_source_reader *out_reader);

/* The next stretch; false at the end, or once the user has cancelled. */
bool fum_source_read(fum_context *context, fum_source_reader *reader);

/* What an octree has of the stretch's particles, or of its points, which have neither sigmas nor depths. */
void fum_source_describe(const fum_source_reader *reader, uint32_t indices[FUM_SOURCE_STRETCH],
                         float inverse_sigmas[FUM_SOURCE_STRETCH], float optical_depths[FUM_SOURCE_STRETCH]);

#endif
