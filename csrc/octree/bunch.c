/* SPDX-License-Identifier: GPL-3.0-or-later */
#include "octree/bunch.h"

#include "octree/cells.h"
#include "octree/thin.h"

#include <math.h>

static const char WHAT[] = "bunches of particles";

/* A leaf and its cells. */
typedef struct cutting {
  fum_cells cells;
  bool is_cut; /* false: its particles stay as they are */
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
  cutting c = {.is_cut = node->count > 1 && is_sighted(node, sums, options->sight)};
  fum_cells *cells = &c.cells;
  cells->per_metre = inverse_sigma_of(sums) / options->sigma_scale;
  cells->sigma_scale = options->sigma_scale;
  for (int axis = 0; axis < 3; axis++) {
    const float extent = node->upper[axis] - node->lower[axis];
    const float count = fmaxf(ceilf(extent * cells->per_metre / options->side), 1.0F);
    c.is_cut = c.is_cut && count <= (float)FUM_MOST_CELLS;
    cells->lower[axis] = node->lower[axis];
    cells->cells[axis] = c.is_cut ? (int32_t)count : 1;
    cells->cells_per_metre[axis] = extent > 0.0F ? count / extent : 0.0F;
  }
  cells->cell_count = cells->cells[0] * cells->cells[1] * cells->cells[2];
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

static void copy_leaf(const fum_octree *octree, const fum_octree_node *leaf, uint32_t at, fum_octree *out) {
  fum_octree_copy(octree, leaf->begin, leaf->count, out, at);
  for (uint32_t i = 0; i < leaf->count && out->members != NULL; i++)
    out->members[at + i] = 1;
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
  const fum_cell_loops *loops = fum_cell_loops_get();
  int64_t count = 0;
#pragma omp parallel for num_threads(fum_thread_count(context)) schedule(dynamic, 64) reduction(+ : count)
  for (int64_t i = 0; i < b->pruned.node_count; i++) {
    const fum_octree_node *node = &b->pruned.nodes[i];
    if (fum_progress_in_loop(context, i, 1 << 10) || node->children != 0) continue;
    const cutting c = cut(node, &b->pruned.sums[b->places[i]], options);
    b->counts[i] = c.is_cut ? loops->find(&b->pruned, node, &c.cells, b->cells + node->begin) : node->count;
    count += b->counts[i];
  }
  return count;
}

static void fill_all(fum_context *context, const fum_bunch_options *options, const bunching *b, fum_octree *out) {
  const fum_cell_loops *loops = fum_cell_loops_get();
#pragma omp parallel for num_threads(fum_thread_count(context)) schedule(dynamic, 64)
  for (int64_t i = 0; i < b->pruned.node_count; i++) {
    const fum_octree_node *node = &b->pruned.nodes[i];
    if (fum_progress_in_loop(context, i, 1 << 10) || node->children != 0) continue;
    const cutting c = cut(node, &b->pruned.sums[b->places[i]], options);
    const uint32_t at = out->nodes[i].begin;
    if (c.is_cut) {
      loops->fill(&b->pruned, node, &c.cells, b->cells + node->begin, at, out);
    } else {
      copy_leaf(&b->pruned, node, at, out);
    }
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
  if (status == FUM_OK && options->keeps_members)
    status = fum_alloc(context, count, sizeof *bunched->members, WHAT, &bunched->members);
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
