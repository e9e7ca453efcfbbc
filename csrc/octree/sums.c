/* SPDX-License-Identifier: GPL-3.0-or-later */
#include "octree/sums.h"

#include "base/simd.h"

#include <math.h>

/* Vectors are added up in floats over so many particles; those sums are added in doubles. */
enum { STRETCH = 64 };

typedef struct lanes {
  fum_vf least_inverse, most_inverse, depth, mass, sigma;
} lanes;

static const lanes NOTHING_YET = {.least_inverse = {INFINITY, INFINITY, INFINITY, INFINITY}};

/* `is_here` is 0 in the lanes behind a node's last particle. */
static inline void add(const fum_octree *octree, uint32_t first, fum_vi is_here, lanes *l) {
  const fum_vf nothing = fum_vf_set(0.0F), inverse = fum_vf_load(octree->inverse_sigmas + first);
  const fum_vf depth = fum_vf_select(is_here, fum_vf_load(octree->optical_depths + first), nothing);
  const fum_vf sigma = fum_vf_select(is_here, 1.0F / inverse, nothing);
  l->least_inverse = fum_vf_min(l->least_inverse, fum_vf_select(is_here, inverse, fum_vf_set(INFINITY)));
  l->most_inverse = fum_vf_max(l->most_inverse, fum_vf_select(is_here, inverse, nothing));
  l->depth += depth;
  l->mass += depth * sigma * sigma;
  l->sigma += sigma;
}

static void sum_leaf(const fum_octree *octree, const fum_octree_node *leaf, fum_node_sums *out) {
  const fum_vi numbers = {0, 1, 2, 3}, everywhere = {-1, -1, -1, -1};
  const uint32_t end = leaf->begin + leaf->count;
  *out = (fum_node_sums){.least_inverse = INFINITY};
  for (uint32_t begin = leaf->begin; begin < end; begin += STRETCH) {
    const uint32_t next = end - begin < STRETCH ? end : begin + STRETCH, whole = next - (next - begin) % FUM_LANES;
    lanes l = NOTHING_YET;
    for (uint32_t i = begin; i < whole; i += FUM_LANES)
      add(octree, i, everywhere, &l);
    if (whole < next) add(octree, whole, numbers < (int32_t)(next - whole), &l);
    for (int k = 0; k < FUM_LANES; k++) {
      out->least_inverse = l.least_inverse[k] < out->least_inverse ? l.least_inverse[k] : out->least_inverse;
      out->most_inverse = l.most_inverse[k] > out->most_inverse ? l.most_inverse[k] : out->most_inverse;
    }
    out->depth += (double)fum_vf_sum(l.depth);
    out->mass += (double)fum_vf_sum(l.mass);
    out->sigma += (double)fum_vf_sum(l.sigma);
  }
}

static void sum_children(const fum_octree *octree, const fum_octree_node *node, fum_node_sums *out) {
  const int children = __builtin_popcount(node->octants);
  *out = (fum_node_sums){.least_inverse = INFINITY};
  for (int c = 0; c < children; c++) {
    const fum_node_sums *child = &octree->sums[node->children + (uint32_t)c];
    out->least_inverse = fminf(out->least_inverse, child->least_inverse);
    out->most_inverse = fmaxf(out->most_inverse, child->most_inverse);
    out->depth += child->depth;
    out->mass += child->mass;
    out->sigma += child->sigma;
  }
}

int32_t fum_octree_sum(fum_context *context, fum_octree *octree) {
  const int32_t status = fum_alloc(context, octree->node_count, sizeof *octree->sums, "density octree", &octree->sums);
  if (status != FUM_OK) return status;
#pragma omp parallel for num_threads(fum_thread_count(context)) schedule(static)
  for (int64_t i = 0; i < octree->node_count; i++) {
    if (octree->nodes[i].children == 0) sum_leaf(octree, &octree->nodes[i], &octree->sums[i]);
  }
  for (int64_t i = octree->node_count - 1; i >= 0; i--) {
    if (octree->nodes[i].children != 0) sum_children(octree, &octree->nodes[i], &octree->sums[i]);
  }
  return FUM_OK;
}
