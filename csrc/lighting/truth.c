/* SPDX-License-Identifier: GPL-3.0-or-later */
#include "lighting/truth_walk.h"

#include "base/cpu.h"

/* Vectors of siblings are read from any child on. */
enum { SIBLINGS = 8 };

static int32_t allocate(fum_context *context, int64_t node_count, fum_truth_nodes *nodes) {
  const int64_t padded = node_count + SIBLINGS;
  int32_t status = fum_alloc(context, padded, sizeof *nodes->sigmas, "meter", &nodes->sigmas);
  for (int axis = 0; axis < 3; axis++) {
    if (status == FUM_OK) status = fum_alloc(context, padded, sizeof(double), "meter", &nodes->middle[axis]);
    if (status == FUM_OK) status = fum_alloc(context, padded, sizeof(double), "meter", &nodes->half[axis]);
  }
  return status;
}

static double largest_sigma(const fum_octree *octree, const fum_octree_node *node) {
  const float *inverse_sigmas = octree->inverse_sigmas + node->begin;
  float smallest = inverse_sigmas[0];
  for (uint32_t i = 1; i < node->count; i++)
    smallest = inverse_sigmas[i] < smallest ? inverse_sigmas[i] : smallest;
  return 1.0 / (double)smallest;
}

static void find_nodes(fum_context *context, const fum_octree *octree, fum_truth_nodes *nodes) {
#pragma omp parallel for num_threads(fum_thread_count(context)) schedule(static)
  for (int64_t i = 0; i < octree->node_count; i++) {
    const fum_octree_node *node = &octree->nodes[i];
    for (int axis = 0; axis < 3; axis++) {
      nodes->middle[axis][i] = 0.5 * ((double)node->lower[axis] + (double)node->upper[axis]);
      nodes->half[axis][i] = 0.5 * ((double)node->upper[axis] - (double)node->lower[axis]);
    }
    if (node->children == 0) nodes->sigmas[i] = largest_sigma(octree, node);
  }
  for (int64_t i = octree->node_count - 1; i >= 0; i--) {
    const fum_octree_node *node = &octree->nodes[i];
    const int children = __builtin_popcount(node->octants);
    for (int c = 0; c < children; c++)
      nodes->sigmas[i] = fmax(nodes->sigmas[i], nodes->sigmas[node->children + (uint32_t)c]);
  }
}

/* A particle of optical depth D that is c sigmas or more away adds at most D exp(-c^2 / 2). If every particle were left
 * out there, all of them together would add half of the error. */
double fum_truth_cutoff(const fum_medium *medium, double error) {
  double total = 0.0;
  for (int64_t i = 0; i < medium->octree->count; i++)
    total += (double)medium->octree->optical_depths[i];
  return log(fmax(1.0, 2.0 * total * (double)medium->depth_scale / error));
}

/* No more than half of the error is left from there on. */
double fum_truth_dark(double error) {
  return -log(0.5 * error);
}

int32_t fum_truth_begin(fum_context *context, const fum_medium *medium, double cutoff, fum_truth *out_truth) {
  fum_truth truth = {.octree = medium->octree,
                     .sigma_scale = (double)medium->sigma_scale,
                     .depth_scale = (double)medium->depth_scale,
                     .cutoff = cutoff};
  const int32_t status = allocate(context, truth.octree->node_count, &truth.nodes);
  if (status != FUM_OK) {
    fum_truth_end(context, &truth);
    return status;
  }
  find_nodes(context, truth.octree, &truth.nodes);
  *out_truth = truth;
  return FUM_OK;
}

void fum_truth_end(fum_context *context, fum_truth *truth) {
  for (int axis = 0; axis < 3; axis++) {
    fum_free(context, &truth->nodes.middle[axis]);
    fum_free(context, &truth->nodes.half[axis]);
  }
  fum_free(context, &truth->nodes.sigmas);
}

static fum_truth_segment segment_to(const fum_emitter *emitter, const double from[3]) {
  const fum_vec3 d = emitter->direction, p = emitter->position;
  const double to[3] = {emitter->is_directional ? (double)d.x : (double)p.x - from[0],
                        emitter->is_directional ? (double)d.y : (double)p.y - from[1],
                        emitter->is_directional ? (double)d.z : (double)p.z - from[2]};
  const double length = sqrt(to[0] * to[0] + to[1] * to[1] + to[2] * to[2]);
  fum_truth_segment s = {.length = emitter->is_directional ? INFINITY : length};
  for (int axis = 0; axis < 3; axis++) {
    s.start[axis] = from[axis];
    s.direction[axis] = length > 0.0 ? to[axis] / length : 0.0;
  }
  return s;
}

static fum_truth_walk find_walk(void) {
  return FUM_CPU_CHOOSE(fum_truth_walk_plain, fum_truth_walk_avx2, fum_truth_walk_avx512);
}

double fum_truth_depth(const fum_truth *truth, const double from[3], const fum_emitter *emitter, double limit) {
  const fum_truth_segment s = segment_to(emitter, from);
  if (!(s.length > 0.0) || truth->octree->node_count == 0) return 0.0;
  return find_walk()(truth, &s, limit);
}
