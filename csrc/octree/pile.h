/* SPDX-License-Identifier: GPL-3.0-or-later */
/* Sorts the particles of a pile, which fit into a processor's cache, by the codes of their cells. */
#ifndef FUM_OCTREE_PILE_H
#define FUM_OCTREE_PILE_H

#include "octree/cube.h"
#include "octree/octree.h"

/* Particles of a pile, at most, and what each of them needs while they are sorted. */
enum { FUM_PILE_MOST = 1 << 15, FUM_PILE_WORDS = 3 };

/* At which level of cells two codes part; 1 is that of the finest, 0 means that they don't. */
static inline uint8_t fum_pile_level(uint64_t difference) {
  return (uint8_t)(difference != 0 ? (63 - __builtin_clzll(difference)) / 3 + 1 : 0);
}

/* Sorts the particles of an octree from place `begin` on, all in one cell 2^shift of the finest wide; ties keep their
 * order. `room`: [FUM_PILE_WORDS count]. Writes at which level each parts from the one before; not that of the first.
 */
void fum_pile_sort(const fum_cube *cube, int shift, int64_t begin, int64_t count, uint64_t *room, fum_octree *octree,
                   uint8_t *levels);

#endif
