/* SPDX-License-Identifier: GPL-3.0-or-later */
/* Cells of a leaf, whose particles are taken as one Gaussian each: the loops of bunch.h. */
#ifndef FUM_OCTREE_CELLS_H
#define FUM_OCTREE_CELLS_H

#include "octree/octree.h"

/* Cells along each axis of a leaf, at most. */
enum { FUM_MOST_CELLS = 8, FUM_ALL_CELLS = FUM_MOST_CELLS * FUM_MOST_CELLS * FUM_MOST_CELLS };

/* How a leaf is cut. Lengths are in its sigmas, from its lower corner on. */
typedef struct fum_cells {
  float lower[3], per_metre, cells_per_metre[3], sigma_scale;
  int32_t cells[3], cell_count; /* along each axis, and in all */
} fum_cells;

typedef struct fum_cell_loops {
  /* Finds the cells of a leaf's particles, out_cells [count of the leaf]; returns how many hold any. */
  uint32_t (*find)(const fum_octree *octree, const fum_octree_node *leaf, const fum_cells *cells, uint16_t *out_cells);
  /* Writes what these cells hold to the places from `at` on. */
  void (*fill)(const fum_octree *octree, const fum_octree_node *leaf, const fum_cells *cells, const uint16_t *of_cells,
               uint32_t at, fum_octree *out);
} fum_cell_loops;

/* The loops for this processor. */
const fum_cell_loops *fum_cell_loops_get(void);

#endif
