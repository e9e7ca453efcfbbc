/* SPDX-License-Identifier: GPL-3.0-or-later */
#include "octree/beam.h"

/* Two bounds, both derived from a Gaussian cut at c sigmas. In smoke of many particles a share exp(-c^2 / 2) of the
 * optical depth is lost everywhere, and tau exp(-tau) is at most 1 / e. A single leaf, however dense, may be missed
 * only where it weighs less than the error divided among a few such leaves. */
float fum_cutoff_sigmas(float optical_depth, float transmittance_error) {
  const float leaves = 4.0F;
  const float ratio = fmaxf(0.5F, leaves * optical_depth) / transmittance_error;
  return sqrtf(2.0F * logf(fmaxf(ratio, 1.0F)));
}

static float leaf_reach(const fum_octree *octree, const fum_octree_node *node, float transmittance_error) {
  float smallest_inverse = INFINITY, optical_depth = 0.0F;
  for (uint32_t i = node->begin; i < node->begin + node->count; i++) {
    smallest_inverse = fminf(smallest_inverse, octree->inverse_sigmas[i]);
    optical_depth += octree->optical_depths[i];
  }
  if (!(optical_depth > 0.0F)) return 0.0F;
  return fum_cutoff_sigmas(optical_depth, transmittance_error) / smallest_inverse;
}

void fum_reach_raise(const fum_octree *octree, float *reaches) {
  for (int64_t i = octree->node_count - 1; i >= 0; i--) {
    const fum_octree_node *node = &octree->nodes[i];
    const int children = __builtin_popcount(node->octants);
    for (int c = 0; c < children; c++)
      reaches[i] = fmaxf(reaches[i], reaches[node->children + (uint32_t)c]);
  }
}

int32_t fum_reach_find(fum_context *context, const fum_octree *octree, float transmittance_error, float **out_reaches) {
  float *reaches = NULL;
  const int32_t status = fum_alloc(context, octree->node_count, sizeof *reaches, "octree's reach", &reaches);
  if (status != FUM_OK) return status;
#pragma omp parallel for num_threads(fum_thread_count(context)) schedule(static)
  for (int64_t i = 0; i < octree->node_count; i++) {
    const fum_octree_node *node = &octree->nodes[i];
    if (node->children == 0) reaches[i] = leaf_reach(octree, node, transmittance_error);
  }
  fum_reach_raise(octree, reaches);
  *out_reaches = reaches;
  return FUM_OK;
}

/* Separating-axis test between the node's box and the beam, along the axis and along the direction from the axis to the
 * middle of the box. Never refuses a box that the beam can hear. */
static bool hears(const fum_beam *beam, const fum_octree_node *node, float reach) {
  const fum_vec3 middle = {0.5F * (node->lower[0] + node->upper[0]), 0.5F * (node->lower[1] + node->upper[1]),
                           0.5F * (node->lower[2] + node->upper[2])};
  const fum_vec3 half = {0.5F * (node->upper[0] - node->lower[0]), 0.5F * (node->upper[1] - node->lower[1]),
                         0.5F * (node->upper[2] - node->lower[2])};
  const fum_vec3 d = fum_sub(middle, beam->start), axis = beam->axis;
  const float s = fum_dot(d, axis);
  const float extent = fabsf(axis.x) * half.x + fabsf(axis.y) * half.y + fabsf(axis.z) * half.z;
  if (s + extent + reach < beam->first || s - extent - reach > beam->last) return false;
  const fum_vec3 offset = fum_mad(axis, -s, d);
  const float distance = fum_length(offset);
  const float across = distance > 0.0F
                           ? (fabsf(offset.x) * half.x + fabsf(offset.y) * half.y + fabsf(offset.z) * half.z) / distance
                           : fum_length(half);
  const float widest = s + (beam->slope > 0.0F ? extent : -extent);
  /* 1e-6: rounding of the coordinates must not refuse a box that touches. */
  return distance - across <= 1.00001F * fum_beam_hearing(beam, widest, reach) + 1e-6F * (fabsf(s) + extent);
}

enum { STACK_SIZE = 8 * 22 };

void fum_beam_walk(const fum_octree *octree, const float *reaches, uint32_t largest, const fum_beam *beam,
                   fum_beam_visit visit, void *user) {
  if (octree->node_count == 0) return;
  /* Octants in the order in which a ray along the axis meets them. */
  const uint32_t mirror =
      (beam->axis.x < 0.0F ? 1U : 0U) | (beam->axis.y < 0.0F ? 2U : 0U) | (beam->axis.z < 0.0F ? 4U : 0U);
  uint32_t stack[STACK_SIZE];
  int depth = 0;
  stack[depth++] = 0;
  while (depth > 0) {
    const uint32_t index = stack[--depth];
    const fum_octree_node *node = &octree->nodes[index];
    if (!(reaches[index] > 0.0F) || !hears(beam, node, reaches[index])) continue;
    if (node->children == 0 || node->count <= largest) {
      if (!visit(user, node, reaches[index])) return;
      continue;
    }
    for (uint32_t i = 8; i-- > 0;) {
      const uint32_t octant = i ^ mirror;
      if ((node->octants >> octant & 1U) == 0) continue;
      const uint32_t before = (uint32_t)__builtin_popcount(node->octants & ((1U << octant) - 1U));
      stack[depth++] = node->children + before;
    }
  }
}
