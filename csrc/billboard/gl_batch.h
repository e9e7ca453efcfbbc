/* SPDX-License-Identifier: GPL-3.0-or-later */
/* Cuts the billboards into batches that each keep the device busy for a short while, so that a cancel is seen soon. */
#ifndef FUM_BILLBOARD_GL_BATCH_H
#define FUM_BILLBOARD_GL_BATCH_H

#include "billboard/gl_program.h"

enum { FUM_GL_MOST_BILLBOARDS = 1 << 18 }; /* a batch, and so the vertex buffer, holds at most: 8 MiB */

typedef struct fum_gl_batch {
  int64_t first, count;
  int32_t bands; /* a single large billboard is drawn in so many bands of the tile's rows, each as long as a batch */
  double cost;   /* estimated fragments, and what a vertex costs in fragments */
} fum_gl_batch;

/* The next billboards from `first` whose cost stays within `budget`, at least one. */
fum_gl_batch fum_gl_batch_next(const fum_frame *frame, const fum_gl_tile *tile, const fum_billboard *billboards,
                               int64_t first, int64_t count, double budget);

#endif
