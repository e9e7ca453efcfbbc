/* SPDX-License-Identifier: GPL-3.0-or-later */
/* The smoke in depth, made while tiles are drawn: tiles note their sums behind every slab, and each pixel's are turned
 * into samples when its tile is done. */
#ifndef FUM_BILLBOARD_DEEP_H
#define FUM_BILLBOARD_DEEP_H

#include "billboard/tile.h"

/* Samples of the pixels of one tile, row by row, as long as the picture isn't done. */
typedef struct fum_deep_part {
  int64_t count, taken; /* taken: put into the picture */
  fum_deep_sample *samples;
} fum_deep_part;

struct fum_deep {
  fum_context *context;
  int32_t width, height, columns, rows; /* of the picture in pixels and tiles */
  fum_deep_part *parts;                 /* [columns rows]; NULL once gathered */
  uint32_t *counts;                     /* [height][width] */
  int64_t sample_count;
  fum_deep_sample *samples; /* [sample_count] */
};

/* A picture without samples, to be destroyed with fum_deep_destroy. */
int32_t fum_deep_create(fum_context *context, const fum_view *view, fum_deep **out_deep);

/* Puts the samples of all tiles in the order of the pixels. */
int32_t fum_deep_gather(fum_deep *deep);

/* First sample of each row, and behind the last one: [height + 1]. */
void fum_deep_find_rows(const fum_deep *deep, int64_t *out_firsts);

/* Makes one picture of several of the same view: `count` of them, in which red, green and blue are drawn as `of` says.
 * Opacity is the mean of the three channels'. `out` is as fum_deep_create made it. */
int32_t fum_deep_join(fum_deep *const *parts, int32_t count, const int32_t of[3], float tolerance, fum_deep *out);

/* ---- While a tile is drawn; nothing here touches another thread's tile ------------------------------------------- */

/* Buffers of one thread. */
typedef struct fum_deep_tile fum_deep_tile;

/* NULL without memory. */
fum_deep_tile *fum_deep_tile_create(void);
/* NULL is allowed. */
void fum_deep_tile_free(fum_deep_tile *tile);

/* The rays of a tile's pixels, [FUM_TILE_PIXELS]; see struct tile. */
typedef struct fum_deep_rays {
  const float *near, *far, *inverse_length, *weights;
} fum_deep_rays;

/* A tile is drawn, the first time or once more beside solids; at most `most_slabs` will be noted. False without
 * memory. */
bool fum_deep_begin(fum_deep_tile *tile, const fum_deep_rays *rays, int32_t most_slabs);

/* Notes the optical depth [FUM_TILE_PIXELS] up to the back of a slab; radiance is to be put where this points. */
fum_tile_rgb *fum_deep_note(fum_deep_tile *tile, int32_t slab, const float *optical_depth);

/* Turns what was noted since the last call into samples of tile `index`. False without memory. */
bool fum_deep_end(fum_deep_tile *tile, const fum_tile_job *job, int64_t index);

#endif
