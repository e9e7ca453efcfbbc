/* SPDX-License-Identifier: GPL-3.0-or-later */
/* The walk of truth_walk.h, to be compiled once for each instruction set: truth_*.c define FUM_LANES and
 * FUM_TRUTH_WALK. */
#include "base/simd.h"
#include "lighting/truth_walk.h"

/* The lanes of the first `count` entries. */
static inline fum_vl lanes_below(uint32_t count) {
  fum_vl lanes;
  for (int lane = 0; lane < FUM_DOUBLE_LANES; lane++)
    lanes[lane] = lane;
  return lanes < (int64_t)count;
}

/* Phi(last) - Phi(first). The tail beyond `last` is left out where all lanes have it above `reach`. */
static inline fum_vd share_between(fum_vd first, fum_vd last, double reach) {
  const fum_vd before = fum_vd_normal_tail(fum_vd_abs(first));
  const fum_vd after = fum_vl_bits(last < reach) != 0 ? fum_vd_normal_tail(fum_vd_abs(last)) : fum_vd_set(0.0);
  const fum_vd across = 1.0 - before - after;
  return fum_vd_select(first > 0.0, before - after, fum_vd_select(last < 0.0, after - before, across));
}

/* DESIGN.md, section 1: the closed form of a leaf's particles. `is_cut`: an end of the segment may be near to some. */
static inline double sum_leaf(const fum_truth *truth, const fum_truth_segment *s, const fum_octree_node *leaf,
                              bool is_cut) {
  const fum_octree *octree = truth->octree;
  const double inverse_scale = 1.0 / truth->sigma_scale, reach = sqrt(2.0 * truth->cutoff), *u = s->direction;
  fum_vd sum = {0};
  for (uint32_t i = 0; i < leaf->count; i += FUM_DOUBLE_LANES) {
    const uint32_t p = leaf->begin + i;
    const fum_vd inverse = fum_vd_load_floats(octree->inverse_sigmas + p) * inverse_scale;
    const fum_vd x = fum_vd_load_floats(octree->x + p) - s->start[0];
    const fum_vd y = fum_vd_load_floats(octree->y + p) - s->start[1];
    const fum_vd z = fum_vd_load_floats(octree->z + p) - s->start[2];
    const fum_vd along = x * u[0] + y * u[1] + z * u[2];
    const fum_vd dx = x - along * u[0], dy = y - along * u[1], dz = z - along * u[2];
    const fum_vd squared = 0.5 * (dx * dx + dy * dy + dz * dz) * (inverse * inverse);
    fum_vd depth = fum_vd_load_floats(octree->optical_depths + p) * fum_vd_exp(-squared);
    if (is_cut) {
      const fum_vd first = -along * inverse, last = (s->length - along) * inverse;
      const fum_vl is_near = (first > -reach) | (last < reach);
      if (fum_vl_bits(is_near & (squared <= truth->cutoff)) != 0) depth *= share_between(first, last, reach);
    }
    sum += fum_vd_select(lanes_below(leaf->count - i), depth, fum_vd_set(0.0));
  }
  return fum_vd_sum(sum) * truth->depth_scale;
}

/* Bits of the nodes that may hold particles near the segment, and of those that may hold some near its ends. */
typedef struct found {
  uint32_t near, cut;
} found;

/* Boxes of centres against the segment: along it, and towards each box's middle across it. */
static inline found find_near(const fum_truth *truth, const fum_truth_segment *s, uint32_t node, uint32_t count) {
  const fum_truth_nodes *n = &truth->nodes;
  const double reach_sigmas = sqrt(2.0 * truth->cutoff) * truth->sigma_scale;
  found f = {0, 0};
  for (uint32_t i = 0; i < count; i += FUM_DOUBLE_LANES) {
    const fum_vd reach = fum_vd_load(n->sigmas + node + i) * reach_sigmas;
    fum_vd offset[3], half[3], along = {0}, extent = {0}, squared = {0}, across = {0};
    for (int axis = 0; axis < 3; axis++) {
      offset[axis] = fum_vd_load(n->middle[axis] + node + i) - s->start[axis];
      half[axis] = fum_vd_load(n->half[axis] + node + i);
      along += offset[axis] * s->direction[axis];
      extent += half[axis] * fabs(s->direction[axis]);
    }
    for (int axis = 0; axis < 3; axis++) {
      const fum_vd aside = offset[axis] - along * s->direction[axis];
      squared += aside * aside;
      across += half[axis] * fum_vd_abs(aside);
    }
    /* distance - across / distance <= reach, without roots and quotients */
    const fum_vd gap = squared - across;
    fum_vl near = (gap <= 0.0) | (gap * gap <= reach * reach * squared);
    near &= (along + extent + reach >= 0.0) & (along - extent - reach <= s->length) & lanes_below(count - i);
    f.near |= fum_vl_bits(near) << i;
    f.cut |= fum_vl_bits(near & ((along - extent < reach) | (along + extent + reach > s->length))) << i;
  }
  return f;
}

/* As many as a path from the root can leave waiting: 21 levels of codes, and the root. */
enum { STACK_SIZE = 8 * 22 };

typedef struct stack {
  int count;
  struct waiting {
    uint32_t node;
    bool is_cut;
  } entries[STACK_SIZE];
} stack;

/* Children that the segment meets first are to be taken from the stack first: they lie in front of what is to be
 * summed up to a limit. */
static inline void push_near(const fum_truth *truth, const fum_truth_segment *s, const fum_octree_node *node,
                             stack *waiting) {
  const double *u = s->direction;
  const uint32_t mirror = (u[0] < 0.0 ? 1U : 0U) | (u[1] < 0.0 ? 2U : 0U) | (u[2] < 0.0 ? 4U : 0U);
  const found f = find_near(truth, s, node->children, (uint32_t)__builtin_popcount(node->octants));
  for (uint32_t i = 8; i-- > 0 && f.near != 0;) {
    const uint32_t octant = i ^ mirror;
    const uint32_t child = (uint32_t)__builtin_popcount(node->octants & ((1U << octant) - 1U));
    if ((node->octants >> octant & 1U) == 0 || (f.near >> child & 1U) == 0) continue;
    waiting->entries[waiting->count++] = (struct waiting){node->children + child, (f.cut >> child & 1U) != 0};
  }
}

double FUM_TRUTH_WALK(const fum_truth *truth, const fum_truth_segment *segment, double limit) {
  const found root = find_near(truth, segment, 0, 1);
  stack waiting = {.count = root.near != 0 ? 1 : 0};
  double depth = 0.0;
  waiting.entries[0] = (struct waiting){0, root.cut != 0};
  while (waiting.count > 0 && depth <= limit) {
    const struct waiting next = waiting.entries[--waiting.count];
    const fum_octree_node *node = &truth->octree->nodes[next.node];
    if (node->children != 0) {
      push_near(truth, segment, node, &waiting);
    } else {
      depth += sum_leaf(truth, segment, node, next.is_cut);
    }
  }
  return depth;
}
