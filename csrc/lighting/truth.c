/* SPDX-License-Identifier: GPL-3.0-or-later */
#include "lighting/truth.h"

static double largest_sigma(const fum_octree *octree, const fum_octree_node *node) {
  float smallest_inverse = INFINITY;
  for (uint32_t i = node->begin; i < node->begin + node->count; i++) {
    smallest_inverse = fminf(smallest_inverse, octree->inverse_sigmas[i]);
  }
  return 1.0 / (double)smallest_inverse;
}

int32_t fum_truth_begin(fum_context *context, const fum_medium *medium, double error, fum_truth *out_truth) {
  const fum_octree *octree = medium->octree;
  double *sigmas = NULL, total = 0.0;
  const int32_t status = fum_alloc(context, octree->node_count, sizeof *sigmas, "meter", &sigmas);
  if (status != FUM_OK) return status;
#pragma omp parallel for num_threads(fum_thread_count(context)) schedule(static)
  for (int64_t i = 0; i < octree->node_count; i++) {
    if (octree->nodes[i].children == 0) sigmas[i] = largest_sigma(octree, &octree->nodes[i]);
  }
  for (int64_t i = octree->node_count - 1; i >= 0; i--) {
    const fum_octree_node *node = &octree->nodes[i];
    const int children = __builtin_popcount(node->octants);
    for (int c = 0; c < children; c++)
      sigmas[i] = fmax(sigmas[i], sigmas[node->children + (uint32_t)c]);
  }
  for (int64_t i = 0; i < octree->count; i++)
    total += (double)octree->optical_depths[i];
  /* A particle of optical depth D that is c sigmas or more away adds at most D exp(-c^2 / 2). If every particle were
   * left out there, all of them together would add half of the error. */
  total *= (double)medium->depth_scale;
  *out_truth = (fum_truth){.octree = octree,
                           .sigma_scale = (double)medium->sigma_scale,
                           .depth_scale = (double)medium->depth_scale,
                           .sigmas = sigmas,
                           .cutoff = log(fmax(1.0, 2.0 * total / error)),
                           .dark = -log(0.5 * error)};
  return FUM_OK;
}

void fum_truth_end(fum_context *context, fum_truth *truth) {
  fum_free(context, &truth->sigmas);
}

typedef struct segment {
  double start[3], direction[3], length; /* direction of length 1 */
} segment;

static segment segment_to(const fum_emitter *emitter, const double from[3]) {
  const fum_vec3 d = emitter->direction, p = emitter->position;
  const double to[3] = {emitter->is_directional ? (double)d.x : (double)p.x - from[0],
                        emitter->is_directional ? (double)d.y : (double)p.y - from[1],
                        emitter->is_directional ? (double)d.z : (double)p.z - from[2]};
  const double length = sqrt(to[0] * to[0] + to[1] * to[1] + to[2] * to[2]);
  segment s = {.length = emitter->is_directional ? INFINITY : length};
  for (int axis = 0; axis < 3; axis++) {
    s.start[axis] = from[axis];
    s.direction[axis] = length > 0.0 ? to[axis] / length : 0.0;
  }
  return s;
}

/* Is every point of the node's box farther than `reach` from the segment? */
static bool is_far(const segment *s, const fum_octree_node *node, double reach) {
  double offset[3], half[3], along = 0.0, extent = 0.0, squared = 0.0, across = 0.0, diagonal = 0.0;
  for (int axis = 0; axis < 3; axis++) {
    offset[axis] = 0.5 * ((double)node->lower[axis] + (double)node->upper[axis]) - s->start[axis];
    half[axis] = 0.5 * ((double)node->upper[axis] - (double)node->lower[axis]);
    along += offset[axis] * s->direction[axis];
    extent += half[axis] * fabs(s->direction[axis]);
  }
  if (along + extent + reach < 0.0 || along - extent - reach > s->length) return true;
  for (int axis = 0; axis < 3; axis++) {
    offset[axis] -= along * s->direction[axis];
    squared += offset[axis] * offset[axis];
    across += half[axis] * fabs(offset[axis]);
    diagonal += half[axis] * half[axis];
  }
  const double distance = sqrt(squared);
  return distance - (distance > 0.0 ? across / distance : sqrt(diagonal)) > reach;
}

enum { RUN = 64 };

/* DESIGN.md, section 1: the closed form of at most RUN particles. */
static double sum_run(const fum_truth *truth, const segment *s, uint32_t begin, uint32_t count) {
  const fum_octree *octree = truth->octree;
  const double inverse_scale = 1.0 / truth->sigma_scale;
  double squared[RUN], first[RUN], last[RUN], depth = 0.0;
  for (uint32_t i = 0; i < count; i++) {
    const uint32_t p = begin + i;
    const double inverse = (double)octree->inverse_sigmas[p] * inverse_scale;
    const double x = (double)octree->x[p] - s->start[0], y = (double)octree->y[p] - s->start[1];
    const double z = (double)octree->z[p] - s->start[2];
    const double along = x * s->direction[0] + y * s->direction[1] + z * s->direction[2];
    const double dx = x - along * s->direction[0], dy = y - along * s->direction[1], dz = z - along * s->direction[2];
    squared[i] = 0.5 * (dx * dx + dy * dy + dz * dz) * inverse * inverse;
    first[i] = -along * inverse;
    last[i] = (s->length - along) * inverse;
  }
  const double reach = sqrt(2.0 * truth->cutoff);
  for (uint32_t i = 0; i < count; i++) {
    if (squared[i] > truth->cutoff || first[i] > reach || last[i] < -reach) continue;
    double share = 1.0;
    if (first[i] > -reach || last[i] < reach) share = 0.5 * (erfc(first[i] * sqrt(0.5)) - erfc(last[i] * sqrt(0.5)));
    depth += (double)octree->optical_depths[begin + i] * truth->depth_scale * exp(-squared[i]) * share;
  }
  return depth;
}

/* As many as a path from the root can leave waiting: 21 levels of codes, and the root. */
enum { STACK_SIZE = 8 * 22 };

double fum_truth_depth(const fum_truth *truth, const double from[3], const fum_emitter *emitter, double limit) {
  const fum_octree *octree = truth->octree;
  const segment s = segment_to(emitter, from);
  const double reach_sigmas = sqrt(2.0 * truth->cutoff) * truth->sigma_scale;
  uint32_t stack[STACK_SIZE];
  int waiting = 0;
  double depth = 0.0;
  if (!(s.length > 0.0) || octree->node_count == 0) return 0.0;
  stack[waiting++] = 0;
  while (waiting > 0 && depth <= limit) {
    const uint32_t index = stack[--waiting];
    const fum_octree_node *node = &octree->nodes[index];
    if (is_far(&s, node, reach_sigmas * truth->sigmas[index])) continue;
    if (node->children != 0) {
      const uint32_t children = (uint32_t)__builtin_popcount(node->octants);
      for (uint32_t c = 0; c < children; c++)
        stack[waiting++] = node->children + c;
      continue;
    }
    const uint32_t end = node->begin + node->count;
    for (uint32_t p = node->begin; p < end; p += RUN)
      depth += sum_run(truth, &s, p, end - p < RUN ? end - p : RUN);
  }
  return depth;
}
