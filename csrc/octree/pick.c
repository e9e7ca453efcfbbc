/* SPDX-License-Identifier: GPL-3.0-or-later */
#include "octree/pick.h"

static void copy_picked(const fum_octree *from, const uint8_t *is_picked, fum_octree *to) {
  int64_t n = 0;
  for (int64_t i = 0; i < from->count; i++) {
    if (!is_picked[i]) continue;
    to->x[n] = from->x[i];
    to->y[n] = from->y[i];
    to->z[n] = from->z[i];
    to->inverse_sigmas[n] = from->inverse_sigmas[i];
    to->optical_depths[n] = from->optical_depths[i];
    n++;
  }
}

/* [count + 1] how many are picked before each. */
static void count_before(int64_t count, const uint8_t *is_picked, uint32_t *before) {
  for (int64_t i = 0; i < count; i++)
    before[i + 1] = before[i] + (is_picked[i] != 0);
}

static uint32_t picked_in(const fum_octree_node *node, const uint32_t *before) {
  return before[node->begin + node->count] - before[node->begin];
}

/* [node_count] the number of each node once those without picked particles are gone; returns how many are left. */
static int64_t number_nodes(const fum_octree *octree, const uint32_t *before, uint32_t *numbers) {
  int64_t count = 0;
  for (int64_t i = 0; i < octree->node_count; i++) {
    numbers[i] = (uint32_t)count;
    count += picked_in(&octree->nodes[i], before) > 0;
  }
  return count;
}

/* Children stay consecutive and behind their parents, as the order stays the same. */
static void fill_nodes(const fum_octree *octree, const uint32_t *before, const uint32_t *numbers, fum_octree *picked) {
  for (int64_t i = 0; i < octree->node_count; i++) {
    const fum_octree_node *node = &octree->nodes[i];
    if (picked_in(node, before) == 0) continue;
    fum_octree_node *left = &picked->nodes[numbers[i]];
    *left = (fum_octree_node){.begin = before[node->begin], .count = picked_in(node, before)};
    uint32_t child = node->children;
    for (int octant = 0; octant < 8; octant++) {
      if ((node->octants >> octant & 1) == 0) continue;
      if (picked_in(&octree->nodes[child], before) > 0) {
        if (left->octants == 0) left->children = numbers[child];
        left->octants |= (uint8_t)(1 << octant);
      }
      child++;
    }
  }
}

int32_t fum_octree_pick(fum_context *context, const fum_octree *octree, const uint8_t *is_picked,
                        fum_octree **out_picked) {
  const char *what = "picked particles";
  uint32_t *before = NULL, *numbers = NULL;
  fum_octree *picked = NULL;
  int32_t status = fum_alloc(context, octree->count + 1, sizeof *before, what, &before);
  if (status == FUM_OK) status = fum_alloc(context, octree->node_count, sizeof *numbers, what, &numbers);
  if (status != FUM_OK) goto done;
  count_before(octree->count, is_picked, before);
  status = fum_octree_create(context, octree->origin, before[octree->count], true, &picked);
  if (status != FUM_OK) goto done;
  picked->node_count = number_nodes(octree, before, numbers);
  status = fum_alloc(context, picked->node_count, sizeof *picked->nodes, what, &picked->nodes);
  if (status != FUM_OK) goto done;
  copy_picked(octree, is_picked, picked);
  fill_nodes(octree, before, numbers, picked);
  fum_octree_bound(context, picked);
  *out_picked = picked;
  picked = NULL;
done:
  fum_octree_destroy(context, picked);
  fum_free(context, &numbers);
  fum_free(context, &before);
  return status;
}
