/* SPDX-License-Identifier: GPL-3.0-or-later */
/* Morton codes are sorted, then nodes are found as ranges that share a prefix of the code: Karras 2012, "Maximizing
 * parallelism in the construction of BVHs, octrees, and k-d trees", level by level with 8 children a node. */
#include "octree/octree.h"

#include "base/vector.h"
#include "octree/order.h"
#include "octree/sums.h"

#include <stdlib.h>
#include <string.h>

int32_t fum_octree_create(fum_context *context, const double origin[3], int64_t count, bool has_density,
                          fum_octree **out_octree) {
  const char *what = "density octree";
  const int64_t padded = count + FUM_OCTREE_PAD;
  fum_octree *octree = calloc(1, sizeof *octree);
  if (octree == NULL) return fum_fail(context, FUM_ERROR_MEMORY, "no memory for an octree");
  memcpy(octree->origin, origin, sizeof octree->origin);
  octree->count = count;
  int32_t status = fum_alloc(context, count, sizeof *octree->indices, what, &octree->indices);
  if (status == FUM_OK) status = fum_alloc(context, padded, sizeof *octree->x, what, &octree->x);
  if (status == FUM_OK) status = fum_alloc(context, padded, sizeof *octree->y, what, &octree->y);
  if (status == FUM_OK) status = fum_alloc(context, padded, sizeof *octree->z, what, &octree->z);
  if (status == FUM_OK && has_density)
    status = fum_alloc(context, padded, sizeof *octree->inverse_sigmas, what, &octree->inverse_sigmas);
  if (status == FUM_OK && has_density)
    status = fum_alloc(context, padded, sizeof *octree->optical_depths, what, &octree->optical_depths);
  if (status != FUM_OK) {
    fum_octree_destroy(context, octree);
    return status;
  }
  *out_octree = octree;
  return FUM_OK;
}

void fum_octree_destroy(fum_context *context, fum_octree *octree) {
  if (octree == NULL) return;
  fum_free(context, &octree->indices);
  fum_free(context, &octree->members);
  fum_free(context, &octree->x);
  fum_free(context, &octree->y);
  fum_free(context, &octree->z);
  fum_free(context, &octree->inverse_sigmas);
  fum_free(context, &octree->optical_depths);
  fum_free(context, &octree->stretches);
  fum_free(context, &octree->nodes);
  fum_free(context, &octree->sums);
  free(octree);
}

static int32_t grow_nodes(fum_context *context, fum_octree *octree, int64_t *capacity, int64_t needed) {
  if (needed <= *capacity) return FUM_OK;
  fum_octree_node *grown = NULL;
  const int64_t larger = needed + *capacity / 2;
  const int32_t status = fum_alloc(context, larger, sizeof *grown, "density octree's nodes", &grown);
  if (status != FUM_OK) return status;
  memcpy(grown, octree->nodes, (size_t)octree->node_count * sizeof *grown);
  fum_free(context, &octree->nodes);
  octree->nodes = grown;
  *capacity = larger;
  return FUM_OK;
}

/* Where the children of a node begin: one for each octant in use at the first level where its codes differ. */
typedef struct split {
  uint32_t begins[8];
} split;

/* What nodes are found from. */
typedef struct division {
  const fum_cube *cube;
  const uint8_t *levels;
  int32_t leaf_size;
} division;

static int octant_of(const fum_octree *octree, const fum_cube *cube, int64_t i, int level) {
  uint32_t cells[3];
  fum_cube_find_cells(cube, (float[3]){octree->x[i], octree->y[i], octree->z[i]}, cells);
  return (int)((cells[0] >> level & 1) | (cells[1] >> level & 1) << 1 | (cells[2] >> level & 1) << 2);
}

/* Particles that share the finest cell stay together however many they are. */
static void find_split(const fum_octree *octree, const division *d, fum_octree_node *node, split *out) {
  const uint8_t *levels = d->levels + node->begin, *end = levels + node->count;
  uint8_t highest = 0;
  if (node->count <= (uint32_t)d->leaf_size) return;
  for (uint32_t i = 1; i < node->count; i++)
    highest = levels[i] > highest ? levels[i] : highest;
  if (highest == 0) return;
  int children = 0;
  for (const uint8_t *at = levels; at != NULL; at = memchr(at + 1, highest, (size_t)(end - at - 1))) {
    const int64_t begin = at - d->levels;
    out->begins[children++] = (uint32_t)begin;
    node->octants |= (uint8_t)(1 << octant_of(octree, d->cube, begin, highest - 1));
  }
}

static void append_children(const split *from, fum_octree_node *node, fum_octree_node *nodes) {
  const int children = __builtin_popcount(node->octants);
  for (int c = 0; c < children; c++) {
    const uint32_t end = c + 1 < children ? from->begins[c + 1] : node->begin + node->count;
    nodes[node->children + (uint32_t)c] = (fum_octree_node){.begin = from->begins[c], .count = end - from->begins[c]};
  }
}

/* Appends the children of the nodes from `first` on. */
static int32_t build_level(fum_context *context, const division *d, int64_t first, int64_t *capacity,
                           fum_octree *octree) {
  const int64_t end = octree->node_count;
  split *splits = NULL;
  int64_t count = end;
  int32_t status = fum_alloc(context, end - first, sizeof *splits, "density octree's nodes", &splits);
  if (status != FUM_OK) return status;
#pragma omp parallel for num_threads(fum_thread_count(context)) schedule(dynamic, 256)
  for (int64_t i = first; i < end; i++)
    find_split(octree, d, &octree->nodes[i], &splits[i - first]);
  for (int64_t i = first; i < end; i++) {
    const int children = __builtin_popcount(octree->nodes[i].octants);
    octree->nodes[i].children = children > 0 ? (uint32_t)count : 0;
    count += children;
  }
  status = grow_nodes(context, octree, capacity, count);
  if (status == FUM_OK) {
#pragma omp parallel for num_threads(fum_thread_count(context)) schedule(static)
    for (int64_t i = first; i < end; i++)
      append_children(&splits[i - first], &octree->nodes[i], octree->nodes);
    octree->node_count = count;
  }
  fum_free(context, &splits);
  return status;
}

/* Level by level, so that a node's children come after it. */
static int32_t build_nodes(fum_context *context, const division *d, fum_octree *octree) {
  int64_t capacity = octree->count / d->leaf_size * 2 + 16;
  int32_t status = fum_alloc(context, capacity, sizeof *octree->nodes, "density octree's nodes", &octree->nodes);
  if (status != FUM_OK || octree->count == 0) return status;
  octree->nodes[0] = (fum_octree_node){.count = (uint32_t)octree->count};
  octree->node_count = 1;
  for (int64_t first = 0; first < octree->node_count && status == FUM_OK;) {
    const int64_t next = octree->node_count;
    status = build_level(context, d, first, &capacity, octree);
    first = next;
    fum_progress_pulse(context);
    if (status == FUM_OK && fum_is_cancelled(context)) status = FUM_ERROR_CANCELLED;
  }
  return status;
}

static void bound_leaf(const fum_octree *octree, fum_octree_node *node) {
  const float *const places[3] = {octree->x + node->begin, octree->y + node->begin, octree->z + node->begin};
  float lower[3], upper[3];
  for (int axis = 0; axis < 3; axis++)
    lower[axis] = upper[axis] = places[axis][0];
  for (uint32_t i = 1; i < node->count; i++) {
    for (int axis = 0; axis < 3; axis++) {
      lower[axis] = fum_min(places[axis][i], lower[axis]);
      upper[axis] = fum_max(places[axis][i], upper[axis]);
    }
  }
  memcpy(node->lower, lower, sizeof lower);
  memcpy(node->upper, upper, sizeof upper);
}

static void bound_inner(const fum_octree *octree, fum_octree_node *node) {
  const int child_count = __builtin_popcount(node->octants);
  *node = (fum_octree_node){.lower = {INFINITY, INFINITY, INFINITY},
                            .upper = {-INFINITY, -INFINITY, -INFINITY},
                            .begin = node->begin,
                            .count = node->count,
                            .children = node->children,
                            .octants = node->octants};
  for (int i = 0; i < child_count; i++) {
    const fum_octree_node *child = &octree->nodes[node->children + (uint32_t)i];
    for (int axis = 0; axis < 3; axis++) {
      node->lower[axis] = fminf(node->lower[axis], child->lower[axis]);
      node->upper[axis] = fmaxf(node->upper[axis], child->upper[axis]);
    }
  }
}

static void bound_nodes(fum_context *context, fum_octree *octree) {
#pragma omp parallel for num_threads(fum_thread_count(context)) schedule(static)
  for (int64_t i = 0; i < octree->node_count; i++) {
    if (octree->nodes[i].children == 0) bound_leaf(octree, &octree->nodes[i]);
  }
  for (int64_t i = octree->node_count - 1; i >= 0; i--) {
    if (octree->nodes[i].children != 0) bound_inner(octree, &octree->nodes[i]);
  }
}

void fum_octree_bound(fum_context *context, fum_octree *octree) {
  bound_nodes(context, octree);
}

/* Sorts what goes in and divides it. */
static int32_t build(fum_context *context, const double origin[3], const fum_source *source, int32_t leaf_size,
                     fum_octree **out_octree) {
  fum_octree *octree = NULL;
  uint8_t *levels = NULL;
  fum_cube cube;
  int64_t count;
  int32_t status = fum_progress_report(context, FUM_STAGE_OCTREE, 0.0F, "Collecting particles");
  if (status == FUM_OK) status = fum_order_measure(context, source, &count, &cube);
  if (status == FUM_OK) status = fum_octree_create(context, origin, count, source->scene != NULL, &octree);
  if (status == FUM_OK) status = fum_order_fill(context, source, &cube, octree, &levels);
  if (status == FUM_OK) status = fum_progress_report(context, FUM_STAGE_OCTREE, 0.7F, "Subdividing cells");
  const division d = {&cube, levels, leaf_size};
  if (status == FUM_OK) status = build_nodes(context, &d, octree);
  if (status != FUM_OK) goto done;
  bound_nodes(context, octree);
  if (source->scene != NULL) status = fum_octree_sum(context, octree);
  if (status != FUM_OK) goto done;
  *out_octree = octree;
  octree = NULL;
done:
  fum_free(context, &levels);
  fum_octree_destroy(context, octree);
  return status;
}

int32_t fum_octree_build(const fum_scene *scene, const fum_octree_options *options, fum_octree **out_octree) {
  const fum_source source = {.scene = scene, .options = options};
  fum_octree *octree = NULL;
  int32_t status = build(scene->context, scene->origin, &source, options->leaf_size, &octree);
  if (status == FUM_OK) status = fum_progress_report(scene->context, FUM_STAGE_OCTREE, 1.0F, "Octree is built");
  if (status == FUM_OK) {
    *out_octree = octree;
  } else {
    fum_octree_destroy(scene->context, octree);
  }
  return status;
}

int32_t fum_octree_build_points(fum_context *context, const double origin[3], int64_t count, const float *positions,
                                int32_t leaf_size, fum_octree **out_octree) {
  const fum_source source = {.point_count = count, .points = positions};
  return build(context, origin, &source, leaf_size, out_octree);
}
