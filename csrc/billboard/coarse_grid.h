/* SPDX-License-Identifier: GPL-3.0-or-later */
/* The grid that smooth smoke is drawn on, and the tiles of the picture that it isn't for. */
#ifndef FUM_BILLBOARD_COARSE_GRID_H
#define FUM_BILLBOARD_COARSE_GRID_H

#include "billboard/tile.h"

/* Points of the grid around the picture on every side: splines take three beyond a pixel, and forget their ends by a
 * factor of 2.3 a point; errors are looked for in FUM_COARSE_AROUND. */
enum { FUM_COARSE_MARGIN = 8 };

typedef struct fum_coarse_grid {
  int32_t step;          /* pixels from point to point, 1: there is no grid */
  const fum_view *whole; /* the picture's */
  fum_view view;         /* in which points are pixels */
  int32_t columns, rows; /* of the picture's tiles */
  uint8_t *fine;         /* [rows][columns] tiles that are drawn pixel by pixel */
} fum_coarse_grid;

/* The largest step for which most particles are wide enough. */
int32_t fum_coarse_grid_begin(fum_context *context, const fum_tile_job *job, fum_coarse_grid *out);
void fum_coarse_grid_end(fum_context *context, fum_coarse_grid *grid);

/* Marks tiles that are touched by splats (of the grid's view) which are too narrow for its step. Returns how many
 * particles of the octree, whose splats they are, are in the picture. */
int64_t fum_coarse_grid_mark(fum_context *context, const fum_splats *splats, const fum_octree *octree,
                             const fum_coarse_grid *grid);

/* The point of the grid before a pixel's centre, or at it. */
static inline int32_t fum_coarse_grid_point(const fum_coarse_grid *grid, int32_t pixel) {
  return (2 * pixel + 1 + grid->step * (2 * FUM_COARSE_MARGIN - 1)) / (2 * grid->step);
}

#endif
