/* SPDX-License-Identifier: GPL-3.0-or-later */
#include "octree/merge.h"

#include "base/vector.h"
#include "octree/neighbours.h"
#include "octree/sums.h"
#include "octree/thin.h"

#include <math.h>

/* What particles weigh together, seen from their centroid. */
typedef struct moments {
  double mass;        /* optical depth times sigma^2 */
  double centroid[3]; /* local space */
  double variance;    /* of the Gaussian that has their second moments, m^2 */
  double error;       /* largest error of its optical depth on any line */
} moments;

typedef struct merging {
  const fum_octree *octree;
  double sigma_scale, depth_scale;
  double allowed;    /* optical depth that a bunch may be wrong by on any segment,  */
  uint32_t *order;   /* [count] scratch */
  uint32_t *counts;  /* [node_count] particles left in each leaf */
  fum_octree *loose; /* those of a leaf from its begin on; no nodes */
} merging;

static double variance_of(const merging *m, uint32_t p) {
  const double sigma = m->sigma_scale / (double)m->octree->inverse_sigmas[p];
  return sigma * sigma;
}

static void offset_of(const merging *m, uint32_t p, const double origin[3], double out[3]) {
  out[0] = (double)m->octree->x[p] - origin[0];
  out[1] = (double)m->octree->y[p] - origin[1];
  out[2] = (double)m->octree->z[p] - origin[2];
}

static void find_centroid(const merging *m, const uint32_t *particles, uint32_t count, moments *out) {
  double start[3], sum[3] = {0.0};
  offset_of(m, particles[0], (double[3]){0.0}, start);
  *out = (moments){0};
  for (uint32_t i = 0; i < count; i++) {
    const double mass = (double)m->octree->optical_depths[particles[i]] * variance_of(m, particles[i]);
    double o[3];
    offset_of(m, particles[i], start, o);
    out->mass += mass;
    for (int axis = 0; axis < 3; axis++)
      sum[axis] += mass * o[axis];
  }
  for (int axis = 0; axis < 3; axis++)
    out->centroid[axis] = start[axis] + (out->mass > 0.0 ? sum[axis] / out->mass : 0.0);
}

/* The Gaussian that particles are taken for has their mass, centroid and mean variance. What is left of the Taylor
 * series of their projections around the narrowest of them: the second moments' direction, the third moments, and the
 * spread of sizes and distances. The derivatives of exp(-x^2 / 2) of order 2 and 3 are at most 1 and 1.38. */
static void find_moments(const merging *m, const uint32_t *particles, uint32_t count, moments *out) {
  double second[3][3] = {{0.0}}, third[3][3][3] = {{{0.0}}}, spread = 0.0, fourth = 0.0, mean = 0.0,
         narrowest = INFINITY;
  find_centroid(m, particles, count, out);
  for (uint32_t i = 0; i < count; i++) {
    const double variance = variance_of(m, particles[i]);
    const double share =
        out->mass > 0.0 ? (double)m->octree->optical_depths[particles[i]] * variance / out->mass : 1.0 / (double)count;
    double o[3], squared = 0.0;
    offset_of(m, particles[i], out->centroid, o);
    for (int a = 0; a < 3; a++) {
      squared += o[a] * o[a];
      for (int b = 0; b < 3; b++) {
        second[a][b] += share * o[a] * o[b];
        for (int c = 0; c < 3; c++)
          third[a][b][c] += share * o[a] * o[b] * o[c];
      }
    }
    const double size = variance + squared / 3.0;
    narrowest = fmin(narrowest, variance);
    mean += share * size;
    spread += share * size * size;
    fourth += share * squared * squared;
  }
  const double trace = second[0][0] + second[1][1] + second[2][2];
  double direction = 0.0, lopsided = 0.0;
  for (int a = 0; a < 3; a++) {
    for (int b = 0; b < 3; b++) {
      const double rest = second[a][b] - (a == b ? trace / 3.0 : 0.0);
      direction += rest * rest;
      for (int c = 0; c < 3; c++)
        lopsided += third[a][b][c] * third[a][b][c];
    }
  }
  out->variance = mean;
  const double uneven = fmax(0.0, spread - mean * mean) + 0.125 * fourth;
  const double share = 0.5 * sqrt(direction) + 0.23 * sqrt(lopsided / narrowest) + uneven / narrowest;
  out->error = out->mass / (narrowest * narrowest) * share;
}

static void emit(const merging *m, uint32_t at, const double position[3], double variance, double optical_depth) {
  m->loose->x[at] = (float)position[0];
  m->loose->y[at] = (float)position[1];
  m->loose->z[at] = (float)position[2];
  m->loose->inverse_sigmas[at] = (float)(m->sigma_scale / sqrt(variance));
  m->loose->optical_depths[at] = (float)optical_depth;
}

/* Particles in the order of fum_neighbours_sort, as one if that is good enough, else by halves. Returns the place
 * behind the last that was written. */
static uint32_t merge_range(const merging *m, const uint32_t *particles, uint32_t count, uint32_t at) {
  if (count == 1) {
    fum_octree_copy(m->octree, particles[0], 1, m->loose, at);
    return at + 1;
  }
  moments all;
  find_moments(m, particles, count, &all);
  if (all.error * m->depth_scale <= m->allowed) {
    emit(m, at, all.centroid, all.variance, all.mass / all.variance);
    return at + 1;
  }
  const uint32_t half = (count + 1) / 2;
  return merge_range(m, particles + half, count - half, merge_range(m, particles, half, at));
}

/* Could two neighbours of the leaf be as close as this many sigmas? If not, nothing there is merged. They are about
 * cbrt(2 / count) of its length apart. */
static bool is_close(const merging *m, int64_t node) {
  const double sigmas = 0.7;
  const fum_octree_node *leaf = &m->octree->nodes[node];
  double longest = 0.0;
  for (int axis = 0; axis < 3; axis++)
    longest = fmax(longest, (double)leaf->upper[axis] - (double)leaf->lower[axis]);
  const double length = longest * (double)m->octree->sums[node].least_inverse / (sigmas * m->sigma_scale);
  return leaf->count > 1 && 2.0 * length * length * length < (double)leaf->count;
}

static void merge_leaf(const merging *m, int64_t node, uint32_t *out_count) {
  const fum_octree_node *leaf = &m->octree->nodes[node];
  uint32_t *particles = m->order + leaf->begin;
  if (!is_close(m, node)) {
    fum_octree_copy(m->octree, leaf->begin, leaf->count, m->loose, leaf->begin);
    *out_count = leaf->count;
    return;
  }
  for (uint32_t i = 0; i < leaf->count; i++)
    particles[i] = leaf->begin + i;
  fum_neighbours_sort(m->octree, 1, leaf->count, particles);
  *out_count = merge_range(m, particles, leaf->count, leaf->begin) - leaf->begin;
}

/* Are there enough particles close together to look at them? */
static bool is_worthwhile(fum_context *context, const merging *m) {
  const fum_octree *octree = m->octree;
  int64_t close = 0;
#pragma omp parallel for num_threads(fum_thread_count(context)) schedule(static) reduction(+ : close)
  for (int64_t i = 0; i < octree->node_count; i++) {
    const fum_octree_node *node = &octree->nodes[i];
    if (node->children == 0 && is_close(m, i)) close += node->count;
  }
  return close > octree->count / 10;
}

static int32_t merge_leaves(fum_context *context, const merging *m, int64_t *out_count) {
  const fum_octree *octree = m->octree;
  int64_t count = 0;
#pragma omp parallel for num_threads(fum_thread_count(context)) schedule(dynamic, 256) reduction(+ : count)
  for (int64_t i = 0; i < octree->node_count; i++) {
    if (fum_progress_in_loop(context, i, 1 << 10) || octree->nodes[i].children != 0) continue;
    merge_leaf(m, i, &m->counts[i]);
    count += m->counts[i];
  }
  *out_count = count;
  return fum_is_cancelled(context) ? FUM_ERROR_CANCELLED : FUM_OK;
}

static int32_t close_gaps(fum_context *context, const merging *m, fum_octree **out_merged) {
  const int32_t status = fum_octree_thin(context, m->octree, m->counts, out_merged);
  if (status != FUM_OK) return status;
  for (int64_t i = 0; i < m->octree->node_count; i++) {
    const fum_octree_node *node = &(*out_merged)->nodes[i];
    if (node->children == 0)
      fum_octree_copy(m->loose, m->octree->nodes[i].begin, node->count, *out_merged, node->begin);
  }
  return fum_octree_sum(context, *out_merged);
}

int32_t fum_octree_merge(fum_context *context, const fum_octree *octree, const fum_merge_options *options,
                         fum_octree **out_merged) {
  merging m = {.octree = octree,
               .sigma_scale = (double)options->sigma_scale,
               .depth_scale = (double)options->depth_scale,
               .allowed = (double)options->transmittance_error};
  int64_t count = 0;
  *out_merged = NULL;
  if (!is_worthwhile(context, &m)) return FUM_OK;
  int32_t status = fum_octree_create(context, octree->origin, octree->count, true, &m.loose);
  if (status == FUM_OK) status = fum_alloc(context, octree->count, sizeof *m.order, "merged particles", &m.order);
  if (status == FUM_OK)
    status = fum_alloc(context, octree->node_count, sizeof *m.counts, "merged particles", &m.counts);
  if (status == FUM_OK) status = merge_leaves(context, &m, &count);
  if (status == FUM_OK && count < octree->count / 10 * 9) status = close_gaps(context, &m, out_merged);
  fum_free(context, &m.counts);
  fum_free(context, &m.order);
  fum_octree_destroy(context, m.loose);
  return status;
}
