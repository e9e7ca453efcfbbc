/* SPDX-License-Identifier: GPL-3.0-or-later */
#include "lighting/receivers.h"

#include <stdlib.h>

/* Nodes of at most this many points, and leaves, are cut into groups. Nodes of at most one group would leave groups
 * half empty: an octree's next larger nodes hold up to eight times as many. */
enum { UNCUT_SIZE = 192 };

static bool is_cut(const fum_octree_node *node) {
  return node->count <= UNCUT_SIZE || node->children == 0;
}

static int64_t groups_of(const fum_octree_node *node) {
  return (node->count + FUM_GROUP_SIZE - 1) / FUM_GROUP_SIZE;
}

/* Children of nodes that are cut are passed over; they come later than their parents. */
static int64_t count_groups(const fum_octree *octree, uint8_t *is_covered) {
  int64_t groups = 0;
  for (int64_t i = 0; i < octree->node_count; i++) {
    const fum_octree_node *node = &octree->nodes[i];
    const bool ends_here = is_cut(node);
    if (!is_covered[i] && ends_here) groups += groups_of(node);
    const int children = __builtin_popcount(node->octants);
    for (int c = 0; c < children; c++)
      is_covered[node->children + (uint32_t)c] = is_covered[i] || ends_here;
  }
  return groups;
}

static int compare_begins(const void *a, const void *b) {
  const uint32_t x = *(const uint32_t *)a, y = *(const uint32_t *)b;
  return (x > y) - (x < y);
}

int32_t fum_receivers_group(fum_context *context, fum_receivers *receivers) {
  const fum_octree *octree = receivers->octree;
  uint8_t *is_covered = NULL;
  uint32_t *begins = NULL;
  if (receivers->group_begins != NULL) return FUM_OK;
  int32_t status = fum_alloc(context, octree->node_count, sizeof *is_covered, "groups of receivers", &is_covered);
  if (status != FUM_OK) goto done;
  const int64_t count = count_groups(octree, is_covered);
  status = fum_alloc(context, count + 1, sizeof *begins, "groups of receivers", &begins);
  if (status != FUM_OK) goto done;
  int64_t n = 0;
  for (int64_t i = 0; i < octree->node_count; i++) {
    const fum_octree_node *node = &octree->nodes[i];
    if (is_covered[i] || !is_cut(node)) continue;
    for (int64_t parts = groups_of(node), part = 0; part < parts; part++)
      begins[n++] = node->begin + (uint32_t)(part * node->count / parts);
  }
  qsort(begins, (size_t)count, sizeof *begins, compare_begins);
  begins[count] = (uint32_t)octree->count;
  receivers->group_count = count;
  receivers->group_begins = begins;
  begins = NULL;
done:
  fum_free(context, &begins);
  fum_free(context, &is_covered);
  return status;
}

void fum_receivers_free(fum_context *context, fum_receivers *receivers) {
  fum_free(context, &receivers->group_begins);
}
