/* SPDX-License-Identifier: GPL-3.0-or-later */
/* Sorts splats into the tiles of the picture that they touch. */
#ifndef FUM_BILLBOARD_SPLAT_TILES_H
#define FUM_BILLBOARD_SPLAT_TILES_H

#include "billboard/splats.h"

/* What a splat touches, remembered from counting to writing. Of a splat whose box is in 2 x 2 tiles: the first one's
 * number above FUM_TOUCHED_TILE, and below a bit for each, in order. Of a larger one, or a smeared one that may pass
 * their corners, FUM_TOUCHED_MANY. 0: none. */
typedef uint32_t fum_touched;

enum { FUM_TOUCHED_MANY = 16, FUM_TOUCHED_TILE = 5 };

/* `is_smeared`: what lies in the box isn't known yet. */
fum_touched fum_touched_find(const fum_view *view, const fum_splat *splat, bool is_smeared);

/* Splats on their way into the tiles. Each block of them counts its tiles, then writes to places of its own, so that
 * every tile's splats stay in order whatever the number of threads. */
typedef struct fum_splat_sorting {
  const fum_view *view;
  fum_splats *splats;
  const uint8_t *wanted; /* tiles; NULL: all */
  int blocks;
  int64_t tiles, stride; /* from a block's cursors to the next one's: a tile's neighbours have one, too */
  int64_t *cursors;      /* [block][stride] */
  fum_touched *touched;  /* of the splats */
} fum_splat_sorting;

/* `out` is freed with fum_splat_sorting_end also on failure. */
int32_t fum_splat_sorting_begin(fum_context *context, const fum_view *view, fum_splats *splats, const uint8_t *wanted,
                                fum_splat_sorting *out);
void fum_splat_sorting_end(fum_context *context, fum_splat_sorting *sorting);

/* Where a block of splats begins. */
static inline int64_t fum_splat_sorting_block(const fum_splat_sorting *s, int block) {
  return s->splats->count * block / s->blocks;
}

/* Counts what splats of a block touch. */
void fum_splat_sorting_count(const fum_splat_sorting *sorting, int block, int64_t begin, int64_t end);

/* Makes the lists of the tiles, once all is counted. */
int32_t fum_splat_sorting_write(fum_context *context, const fum_splat_sorting *sorting);

#endif
