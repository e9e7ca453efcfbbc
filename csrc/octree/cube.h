/* SPDX-License-Identifier: GPL-3.0-or-later */
/* The cube that an octree divides: 2^FUM_CUBE_LEVELS cells along each axis at the finest level. A Morton code is the
 * bits of a cell's numbers along the axes in turn, x lowest. */
#ifndef FUM_OCTREE_CUBE_H
#define FUM_OCTREE_CUBE_H

#include <stdint.h>

enum { FUM_CUBE_LEVELS = 21 };

/* As large as the longest side of the box of all that goes in. */
typedef struct fum_cube {
  float lower[3];
  double cells_per_metre;
} fum_cube;

/* Cells along each axis of the finest level. */
void fum_cube_find_cells(const fum_cube *cube, const float place[3], uint32_t out[3]);

/* Codes are found between two levels: of cells 2^shift of the finest wide, within one that is 2^levels as wide as they.
 * Places: local space. */
typedef struct fum_cube_band {
  int shift, levels;
} fum_cube_band;

/* Of at most FUM_CUBE_STEP places; at most 10 levels. */
enum { FUM_CUBE_STEP = 256, FUM_CUBE_SHORT = 10 };
void fum_cube_find_short_codes(const fum_cube *cube, fum_cube_band band, int64_t count, const float *const places[3],
                               uint32_t *out);

/* Of any number of places, for all levels below one of at most 2 FUM_CUBE_SHORT. */
void fum_cube_find_codes(const fum_cube *cube, int levels, int64_t count, const float *const places[3], uint64_t *out);

#endif
