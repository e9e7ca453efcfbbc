/* SPDX-License-Identifier: GPL-3.0-or-later */
#include "octree/bunch.h"

#include "base/simd.h"
#include "octree/thin.h"

#include <math.h>
#include <string.h>

/* Cells along each axis of a node, at most. */
enum { MOST_CELLS = 8, ALL_CELLS = MOST_CELLS * MOST_CELLS * MOST_CELLS };

static const char WHAT[] = "bunches of particles";

/* How a leaf is cut. Lengths are in its sigmas, from its lower corner on. */
typedef struct cutting {
  float lower[3], per_metre, cells_per_metre[3], sigma_scale;
  int32_t cells[3], cell_count; /* along each axis, and in all */
  bool is_cut;                  /* false: its particles stay as they are */
} cutting;

/* Sigma that cells go by: of the mean curvature of what the particles are in sum, which the few narrowest among wide
 * ones hardly matter to; but these mustn't be lost either. */
static float inverse_sigma_of(const fum_node_sums *sums) {
  const float most_ratio = 1.5F;
  const float inverse = sums->mass > 0.0 ? (float)sqrt(sums->depth / sums->mass) : 0.0F;
  return fmaxf(inverse, sums->most_inverse / most_ratio);
}

/* Do all of a node's particles look as wide as the camera asks for? */
static bool is_sighted(const fum_octree_node *node, const fum_node_sums *sums, const fum_bunch_sight *sight) {
  float near, far;
  if (sight == NULL) return true;
  near = far = sight->depth[3];
  for (int axis = 0; axis < 3; axis++) {
    const float lower = sight->depth[axis] * node->lower[axis], upper = sight->depth[axis] * node->upper[axis];
    near += fminf(lower, upper);
    far += fmaxf(lower, upper);
  }
  return sight->least * far * sums->most_inverse <= 1.0F && sight->most * near * sums->least_inverse >= 1.0F;
}

static cutting cut(const fum_octree_node *node, const fum_node_sums *sums, const fum_bunch_options *options) {
  cutting c = {.is_cut = node->count > 1 && is_sighted(node, sums, options->sight),
               .per_metre = inverse_sigma_of(sums) / options->sigma_scale,
               .sigma_scale = options->sigma_scale};
  for (int axis = 0; axis < 3; axis++) {
    const float extent = node->upper[axis] - node->lower[axis];
    const float cells = fmaxf(ceilf(extent * c.per_metre / options->side), 1.0F);
    c.lower[axis] = node->lower[axis];
    c.is_cut = c.is_cut && cells <= (float)MOST_CELLS;
    c.cells[axis] = c.is_cut ? (int32_t)cells : 1;
    c.cells_per_metre[axis] = extent > 0.0F ? cells / extent : 0.0F;
  }
  c.cell_count = c.cells[0] * c.cells[1] * c.cells[2];
  return c;
}

/* The nodes down to those that can be cut: the more cells in one, the closer to `side` they come out. `places` are
 * those that they had. Returns how many they are. */
static int64_t prune(const fum_octree *octree, const fum_bunch_options *options, uint32_t *places,
                     fum_octree_node *out) {
  int64_t count = octree->node_count > 0 ? 1 : 0;
  places[0] = 0;
  for (int64_t next = 0; next < count; next++) {
    const uint32_t i = places[next];
    out[next] = octree->nodes[i];
    if (octree->nodes[i].children == 0) continue;
    if (cut(&out[next], &octree->sums[i], options).is_cut) {
      out[next].children = 0;
      out[next].octants = 0;
      continue;
    }
    const uint32_t first = octree->nodes[i].children;
    const int children = __builtin_popcount(octree->nodes[i].octants);
    out[next].children = (uint32_t)count;
    for (int c = 0; c < children; c++)
      places[count++] = first + (uint32_t)c;
  }
  return count;
}

/* Adds the cells along one axis to those of a leaf's particles. */
static void add_cells(const float *restrict places, uint32_t count, float lower, float per_metre, int32_t cell_count,
                      uint16_t *restrict cells) {
  const int32_t last = cell_count - 1;
  for (uint32_t i = 0; i < count; i++) {
    const int32_t cell = (int32_t)((places[i] - lower) * per_metre);
    cells[i] = (uint16_t)(cells[i] * cell_count + (cell < last ? cell : last));
  }
}

/* Finds the cells of a leaf's particles; returns how many particles are left: cells with any. */
static uint32_t find_cells(const fum_octree *octree, const fum_octree_node *leaf, const cutting *c, uint16_t *cells) {
  const float *places[3] = {octree->z, octree->y, octree->x};
  uint8_t taken[ALL_CELLS] = {0};
  uint32_t count = 0;
  if (!c->is_cut) return leaf->count;
  memset(cells, 0, leaf->count * sizeof *cells);
  for (int k = 0; k < 3; k++) {
    const int axis = 2 - k;
    add_cells(places[k] + leaf->begin, leaf->count, c->lower[axis], c->cells_per_metre[axis], c->cells[axis], cells);
  }
  for (uint32_t i = 0; i < leaf->count; i++)
    taken[cells[i]] = 1;
  for (int32_t k = 0; k < c->cell_count; k++)
    count += taken[k];
  return count;
}

/* Over the particles of a cell: sums of their masses, optical depth times sigma^2, times x, y and z times (x, y, z, 1),
 * a row each; and in the last row of mass times sigma^2 and of mass. */
enum { ROWS = 4 };

static void add_particle(const cutting *c, const fum_octree *octree, uint32_t p, fum_quad sums[ROWS]) {
  const float x = (octree->x[p] - c->lower[0]) * c->per_metre, y = (octree->y[p] - c->lower[1]) * c->per_metre,
              z = (octree->z[p] - c->lower[2]) * c->per_metre;
  const float sigma = c->sigma_scale * c->per_metre / octree->inverse_sigmas[p], variance = sigma * sigma;
  const float mass = octree->optical_depths[p] * variance;
  const fum_quad place = {x, y, z, 1.0F}, weight = {mass * variance, mass, 0.0F, 0.0F};
  sums[0] += place * (mass * x);
  sums[1] += place * (mass * y);
  sums[2] += place * (mass * z);
  sums[3] += weight;
}

/* The Gaussian with the mass, centroid and second moments of a cell. */
static void emit(const cutting *c, const fum_quad sums[ROWS], uint32_t at, fum_octree *out) {
  const float mass = sums[3][1], per_mass = mass > 0.0F ? 1.0F / mass : 0.0F, unit = 1.0F / c->per_metre;
  const float x = sums[0][3] * per_mass, y = sums[1][3] * per_mass, z = sums[2][3] * per_mass;
  const float xx = sums[0][0] * per_mass - x * x, yy = sums[1][1] * per_mass - y * y,
              zz = sums[2][2] * per_mass - z * z;
  const float least = 0.25F; /* the narrowest have more: for cells without any mass */
  const float spread = (xx + yy + zz) * 0.33333333F, variance = fmaxf(sums[3][0] * per_mass + spread, least);
  const float stretches[FUM_STRETCHES] = {xx - spread, yy - spread, sums[0][1] * per_mass - x * y,
                                          sums[0][2] * per_mass - x * z, sums[1][2] * per_mass - y * z};
  out->x[at] = c->lower[0] + x * unit;
  out->y[at] = c->lower[1] + y * unit;
  out->z[at] = c->lower[2] + z * unit;
  out->inverse_sigmas[at] = c->sigma_scale * c->per_metre / sqrtf(variance);
  out->optical_depths[at] = mass / variance;
  for (int k = 0; k < FUM_STRETCHES; k++)
    out->stretches[k * (out->count + FUM_OCTREE_PAD) + at] = stretches[k] * unit * unit;
}

static void fill_leaf(const fum_octree *octree, const fum_octree_node *leaf, const cutting *c, const uint16_t *of_cells,
                      uint32_t at, fum_octree *out) {
  fum_quad cells[ALL_CELLS][ROWS];
  uint32_t members[ALL_CELLS], firsts[ALL_CELLS];
  if (!c->is_cut) {
    fum_octree_copy(octree, leaf->begin, leaf->count, out, at);
    for (uint32_t i = 0; i < leaf->count; i++)
      out->members[at + i] = 1;
    return;
  }
  memset(cells, 0, (size_t)c->cell_count * sizeof *cells);
  memset(members, 0, (size_t)c->cell_count * sizeof *members);
  for (uint32_t i = leaf->count; i-- > 0;) { /* backwards: the first one is the last that is written down */
    members[of_cells[i]]++;
    firsts[of_cells[i]] = octree->indices[leaf->begin + i];
    add_particle(c, octree, leaf->begin + i, cells[of_cells[i]]);
  }
  for (int32_t k = 0; k < c->cell_count; k++) {
    if (members[k] == 0) continue;
    out->indices[at] = firsts[k];
    out->members[at] = members[k];
    emit(c, cells[k], at++, out);
  }
}

/* What is needed on the way. */
typedef struct bunching {
  fum_octree pruned; /* the octree's particles in fewer nodes, which are owned */
  uint32_t *places;  /* [node_count + 1] these nodes' in the octree */
  uint32_t *counts;  /* [node_count] */
  uint16_t *cells;   /* [particles] */
} bunching;

static int32_t begin_bunching(fum_context *context, const fum_octree *octree, bunching *out) {
  const int64_t nodes = octree->node_count;
  out->pruned = *octree;
  out->pruned.nodes = NULL;
  int32_t status = fum_alloc(context, nodes, sizeof *octree->nodes, WHAT, &out->pruned.nodes);
  if (status == FUM_OK) status = fum_alloc(context, nodes + 1, sizeof *out->places, WHAT, &out->places);
  if (status == FUM_OK) status = fum_alloc(context, nodes, sizeof *out->counts, WHAT, &out->counts);
  if (status == FUM_OK) status = fum_alloc(context, octree->count, sizeof *out->cells, WHAT, &out->cells);
  return status;
}

static void end_bunching(fum_context *context, bunching *b) {
  fum_free(context, &b->cells);
  fum_free(context, &b->counts);
  fum_free(context, &b->places);
  fum_free(context, &b->pruned.nodes);
}

static int64_t count_all(fum_context *context, const fum_bunch_options *options, const bunching *b) {
  int64_t count = 0;
#pragma omp parallel for num_threads(fum_thread_count(context)) schedule(dynamic, 64) reduction(+ : count)
  for (int64_t i = 0; i < b->pruned.node_count; i++) {
    const fum_octree_node *node = &b->pruned.nodes[i];
    if (fum_progress_in_loop(context, i, 1 << 10) || node->children != 0) continue;
    const cutting c = cut(node, &b->pruned.sums[b->places[i]], options);
    b->counts[i] = find_cells(&b->pruned, node, &c, b->cells + node->begin);
    count += b->counts[i];
  }
  return count;
}

static void fill_all(fum_context *context, const fum_bunch_options *options, const bunching *b, fum_octree *out) {
#pragma omp parallel for num_threads(fum_thread_count(context)) schedule(dynamic, 64)
  for (int64_t i = 0; i < b->pruned.node_count; i++) {
    const fum_octree_node *node = &b->pruned.nodes[i];
    if (fum_progress_in_loop(context, i, 1 << 10) || node->children != 0) continue;
    const cutting c = cut(node, &b->pruned.sums[b->places[i]], options);
    fill_leaf(&b->pruned, node, &c, b->cells + node->begin, out->nodes[i].begin, out);
  }
}

int32_t fum_octree_bunch(fum_context *context, const fum_octree *octree, const fum_bunch_options *options,
                         fum_octree **out_bunched) {
  bunching b = {0};
  fum_octree *bunched = NULL;
  int32_t status = begin_bunching(context, octree, &b);
  if (status != FUM_OK) goto done;
  b.pruned.node_count = prune(octree, options, b.places, b.pruned.nodes);
  const int64_t count = count_all(context, options, &b);
  if (fum_is_cancelled(context)) status = FUM_ERROR_CANCELLED;
  if (status != FUM_OK || (double)count > (double)options->most_left * (double)octree->count) goto done;
  status = fum_octree_thin(context, &b.pruned, b.counts, &bunched);
  if (status == FUM_OK) status = fum_alloc(context, count, sizeof *bunched->members, WHAT, &bunched->members);
  if (status == FUM_OK)
    status = fum_alloc(context, FUM_STRETCHES * (count + FUM_OCTREE_PAD), sizeof(float), WHAT, &bunched->stretches);
  if (status != FUM_OK) goto done;
  fill_all(context, options, &b, bunched);
  if (fum_is_cancelled(context)) status = FUM_ERROR_CANCELLED;
done:
  end_bunching(context, &b);
  if (status == FUM_OK) {
    *out_bunched = bunched;
  } else {
    fum_octree_destroy(context, bunched);
  }
  return status;
}
