/* SPDX-License-Identifier: GPL-3.0-or-later */
#include "octree/neighbours.h"

#include <math.h>

static const float *longest_side(const fum_octree *octree, uint32_t count, const uint32_t *particles) {
  const float *coordinates[3] = {octree->x, octree->y, octree->z}, *longest = octree->x;
  float length = -1.0F;
  for (int axis = 0; axis < 3; axis++) {
    float lower = INFINITY, upper = -INFINITY;
    for (uint32_t i = 0; i < count; i++) {
      const float c = coordinates[axis][particles[i]];
      lower = c < lower ? c : lower;
      upper = c > upper ? c : upper;
    }
    if (upper - lower > length) {
      length = upper - lower;
      longest = coordinates[axis];
    }
  }
  return longest;
}

static void swap(uint32_t *a, uint32_t *b) {
  const uint32_t kept = *a;
  *a = *b;
  *b = kept;
}

/* Hoare's selection: the `first` particles of lowest coordinate come first. Equal ones are swapped as well, which keeps
 * the parts even where all are equal. */
static void select_lowest(const float *coordinate, uint32_t first, uint32_t count, uint32_t *particles) {
  int64_t low = 0, high = (int64_t)count - 1;
  while (low < high) {
    const float pivot = coordinate[particles[low + (high - low) / 2]];
    int64_t i = low, j = high;
    while (i <= j) {
      while (coordinate[particles[i]] < pivot)
        i++;
      while (coordinate[particles[j]] > pivot)
        j--;
      if (i <= j) swap(&particles[i++], &particles[j--]);
    }
    if ((int64_t)first <= j) {
      high = j;
    } else if ((int64_t)first >= i) {
      low = i;
    } else {
      return;
    }
  }
}

void fum_neighbours_sort(const fum_octree *octree, uint32_t size, uint32_t count, uint32_t *particles) {
  if (count <= size) return;
  const uint32_t first = ((count + size - 1) / size + 1) / 2 * size;
  select_lowest(longest_side(octree, count, particles), first, count, particles);
  fum_neighbours_sort(octree, size, first, particles);
  fum_neighbours_sort(octree, size, count - first, particles + first);
}
