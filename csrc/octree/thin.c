/* SPDX-License-Identifier: GPL-3.0-or-later */
#include "octree/thin.h"

#include <string.h>

/* Children come after their parents, and consecutive. */
static void count_up(const uint32_t *counts, int64_t node_count, fum_octree_node *nodes) {
  for (int64_t i = node_count - 1; i >= 0; i--) {
    const int children = __builtin_popcount(nodes[i].octants);
    nodes[i].count = nodes[i].children == 0 ? counts[i] : 0;
    for (int c = 0; c < children; c++)
      nodes[i].count += nodes[nodes[i].children + (uint32_t)c].count;
  }
}

static void number_down(int64_t node_count, fum_octree_node *nodes) {
  for (int64_t i = 0; i < node_count; i++) {
    uint32_t begin = nodes[i].begin;
    const int children = __builtin_popcount(nodes[i].octants);
    for (int c = 0; c < children; c++) {
      fum_octree_node *child = &nodes[nodes[i].children + (uint32_t)c];
      child->begin = begin;
      begin += child->count;
    }
  }
}

int32_t fum_octree_thin(fum_context *context, const fum_octree *octree, const uint32_t *counts, fum_octree **out_thin) {
  fum_octree_node *nodes = NULL;
  fum_octree *thin = NULL;
  int32_t status = fum_alloc(context, octree->node_count, sizeof *nodes, "merged particles", &nodes);
  if (status != FUM_OK) return status;
  memcpy(nodes, octree->nodes, (size_t)octree->node_count * sizeof *nodes);
  count_up(counts, octree->node_count, nodes);
  number_down(octree->node_count, nodes);
  const int64_t left = octree->node_count > 0 ? nodes[0].count : 0;
  status = fum_octree_create(context, octree->origin, left, true, &thin);
  if (status != FUM_OK) {
    fum_free(context, &nodes);
    return status;
  }
  thin->nodes = nodes;
  thin->node_count = octree->node_count;
  *out_thin = thin;
  return FUM_OK;
}

void fum_octree_copy(const fum_octree *from, uint32_t first, uint32_t count, fum_octree *to, uint32_t at) {
  const size_t bytes = count * sizeof(float);
  memcpy(to->indices + at, from->indices + first, count * sizeof *to->indices);
  memcpy(to->x + at, from->x + first, bytes);
  memcpy(to->y + at, from->y + first, bytes);
  memcpy(to->z + at, from->z + first, bytes);
  if (from->inverse_sigmas == NULL) return;
  memcpy(to->inverse_sigmas + at, from->inverse_sigmas + first, bytes);
  memcpy(to->optical_depths + at, from->optical_depths + first, bytes);
}
