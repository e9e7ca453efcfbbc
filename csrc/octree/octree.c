/* SPDX-License-Identifier: GPL-3.0-or-later */
/* Morton codes are sorted, then nodes are found as ranges that share a prefix of the code: Karras 2012, "Maximizing
 * parallelism in the construction of BVHs, octrees, and k-d trees", made serial per level with 8 children a node. */
#include "octree/octree.h"

#include "base/hash.h"
#include "base/radix.h"
#include "base/vector.h"

#include <stdlib.h>
#include <string.h>

enum { MORTON_BITS = 21, CHECK_STRIDE = 1 << 17 };

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
  fum_free(context, &octree->x);
  fum_free(context, &octree->y);
  fum_free(context, &octree->z);
  fum_free(context, &octree->inverse_sigmas);
  fum_free(context, &octree->optical_depths);
  fum_free(context, &octree->stretches);
  fum_free(context, &octree->nodes);
  free(octree);
}

/* The points to build over, before they are sorted. */
typedef struct unsorted {
  int64_t count;
  const float *positions; /* [3 count] local */
} unsorted;

static uint64_t spread_bits(uint64_t v) {
  v &= 0x1fffff;
  v = (v | v << 32) & 0x001f00000000ffff;
  v = (v | v << 16) & 0x001f0000ff0000ff;
  v = (v | v << 8) & 0x100f00f00f00f00f;
  v = (v | v << 4) & 0x10c30c30c30c30c3;
  return (v | v << 2) & 0x1249249249249249;
}

/* The cube that the codes divide: as large as the longest side of the points' box. */
typedef struct morton_cube {
  float lower[3];
  double cells_per_metre;
} morton_cube;

static morton_cube find_cube(fum_context *context, const unsorted *points) {
  float lx = INFINITY, ly = INFINITY, lz = INFINITY, ux = -INFINITY, uy = -INFINITY, uz = -INFINITY;
#pragma omp parallel for num_threads(fum_thread_count(context)) schedule(static) reduction(min                         \
                                                                                           : lx, ly, lz)               \
    reduction(max                                                                                                      \
              : ux, uy, uz)
  for (int64_t i = 0; i < points->count; i++) {
    const float *p = points->positions + 3 * i;
    lx = fum_min(lx, p[0]), ux = fum_max(ux, p[0]);
    ly = fum_min(ly, p[1]), uy = fum_max(uy, p[1]);
    lz = fum_min(lz, p[2]), uz = fum_max(uz, p[2]);
  }
  const double side = fmax((double)ux - (double)lx, fmax((double)uy - (double)ly, (double)uz - (double)lz));
  return (morton_cube){{lx, ly, lz}, side > 0.0 ? (double)(1 << MORTON_BITS) / side : 0.0};
}

static uint64_t morton_code(const morton_cube *cube, const float *p) {
  uint64_t code = 0;
  for (int axis = 0; axis < 3; axis++) {
    const double cell = ((double)p[axis] - (double)cube->lower[axis]) * cube->cells_per_metre;
    const uint64_t last = (1 << MORTON_BITS) - 1;
    const uint64_t whole = cell < (double)last ? (uint64_t)cell : last;
    code |= spread_bits(whole) << axis;
  }
  return code;
}

/* First index in [begin, end) whose code is at least `code`. */
static int64_t lower_bound(const uint64_t *codes, int64_t begin, int64_t end, uint64_t code) {
  while (begin < end) {
    const int64_t middle = begin + (end - begin) / 2;
    if (codes[middle] < code) {
      begin = middle + 1;
    } else {
      end = middle;
    }
  }
  return begin;
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

/* Appends the children of a node: one for each octant in use at the first level where its codes differ. */
static void subdivide(fum_octree *octree, const uint64_t *codes, int64_t node_index) {
  fum_octree_node *node = &octree->nodes[node_index];
  const int64_t begin = node->begin, end = begin + node->count;
  const uint64_t difference = codes[begin] ^ codes[end - 1];
  const int level = (63 - __builtin_clzll(difference)) / 3; /* of the highest three bits that differ */
  const uint64_t prefix = codes[begin] >> (3 * level + 3) << (3 * level + 3);
  node->children = (uint32_t)octree->node_count;
  int64_t first = begin;
  for (uint64_t octant = 0; octant < 8 && first < end; octant++) {
    const int64_t last = octant == 7 ? end : lower_bound(codes, first, end, prefix + ((octant + 1) << (3 * level)));
    if (last == first) continue;
    node->octants |= (uint8_t)(1 << octant);
    octree->nodes[octree->node_count++] =
        (fum_octree_node){.begin = (uint32_t)first, .count = (uint32_t)(last - first)};
    first = last;
  }
}

static int32_t build_nodes(fum_context *context, fum_octree *octree, const uint64_t *codes, int32_t leaf_size) {
  int64_t capacity = octree->count / leaf_size * 2 + 16;
  int32_t status = fum_alloc(context, capacity, sizeof *octree->nodes, "density octree's nodes", &octree->nodes);
  if (status != FUM_OK || octree->count == 0) return status;
  octree->nodes[0] = (fum_octree_node){.count = (uint32_t)octree->count};
  octree->node_count = 1;
  for (int64_t i = 0; i < octree->node_count; i++) {
    const fum_octree_node *node = &octree->nodes[i];
    const int64_t last = (int64_t)node->begin + node->count - 1;
    /* Equal codes share the finest cell: coincident particles stay together however many they are. */
    if (node->count <= (uint32_t)leaf_size || codes[node->begin] == codes[last]) continue;
    status = grow_nodes(context, octree, &capacity, octree->node_count + 8);
    if (status != FUM_OK) return status;
    subdivide(octree, codes, i);
    if (fum_progress_in_loop(context, i, 1 << 12)) return FUM_ERROR_CANCELLED;
  }
  return FUM_OK;
}

static void bound_leaf(const fum_octree *octree, fum_octree_node *node) {
  const float *coordinates[3] = {octree->x, octree->y, octree->z};
  for (int axis = 0; axis < 3; axis++) {
    const float *c = coordinates[axis] + node->begin;
    float lower = c[0], upper = c[0];
    for (uint32_t i = 1; i < node->count; i++) {
      lower = c[i] < lower ? c[i] : lower;
      upper = c[i] > upper ? c[i] : upper;
    }
    node->lower[axis] = lower;
    node->upper[axis] = upper;
  }
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

/* Sorts the points and builds the nodes; leaves the order in octree->indices as positions within `points`. */
static int32_t build(fum_context *context, const unsorted *points, int32_t leaf_size, fum_octree *octree) {
  uint64_t *codes = NULL;
  int32_t status = fum_alloc(context, points->count, sizeof *codes, "density octree's codes", &codes);
  if (status != FUM_OK) goto done;
  status = fum_progress_report(context, FUM_STAGE_OCTREE, 0.1F, "Sorting particles in space");
  if (status != FUM_OK) goto done;
  const morton_cube cube = find_cube(context, points);
#pragma omp parallel for num_threads(fum_thread_count(context)) schedule(static)
  for (int64_t i = 0; i < points->count; i++) {
    if (fum_progress_in_loop(context, i, CHECK_STRIDE)) continue;
    codes[i] = morton_code(&cube, points->positions + 3 * i);
    octree->indices[i] = (uint32_t)i;
  }
  status = fum_radix_sort(context, points->count, 0, codes, octree->indices);
  if (status != FUM_OK) goto done;
#pragma omp parallel for num_threads(fum_thread_count(context)) schedule(static)
  for (int64_t i = 0; i < points->count; i++) {
    if (fum_progress_in_loop(context, i, CHECK_STRIDE)) continue;
    const float *p = points->positions + 3 * (int64_t)octree->indices[i];
    octree->x[i] = p[0];
    octree->y[i] = p[1];
    octree->z[i] = p[2];
  }
  status = fum_progress_report(context, FUM_STAGE_OCTREE, 0.7F, "Subdividing cells");
  if (status != FUM_OK) goto done;
  status = build_nodes(context, octree, codes, leaf_size);
  if (status == FUM_OK) bound_nodes(context, octree);
done:
  fum_free(context, &codes);
  return status;
}

static void local_from_world(const double origin[3], const float *world, float *out_local) {
  for (int axis = 0; axis < 3; axis++)
    out_local[axis] = (float)((double)world[axis] - origin[axis]);
}

static bool is_chosen(const fum_particles *set, int64_t i, float share) {
  return share >= 1.0F || fum_hash_unit(fum_particle_identity(set, i)) < (double)share;
}

static bool takes(const fum_octree_options *options, int32_t set) {
  return options->takes == NULL || options->takes[set];
}

static int64_t count_chosen(const fum_scene *scene, const fum_octree_options *options) {
  const float share = options->subsampling;
  int64_t count = 0;
  for (int32_t s = 0; s < scene->particles_count; s++) {
    const fum_particles *set = &scene->particles[s];
    if (!takes(options, s)) continue;
    if (share >= 1.0F) count += set->count;
    for (int64_t i = 0; share < 1.0F && i < set->count; i++)
      count += is_chosen(set, i, share);
  }
  return count;
}

/* The particles that go in. */
typedef struct chosen {
  float *positions;  /* [3 count] local space */
  float *weights;    /* [2 count] 1 / sigma; optical depth through the centre */
  uint32_t *indices; /* [count] scene indices */
} chosen;

static void choose(const fum_scene *scene, const fum_particles *set, int64_t i, float share, const chosen *out,
                   int64_t at) {
  const double sigma = (double)set->sigmas[i], density = (double)set->densities[i] / (double)share;
  const double inverse = 1.0 / sigma, depth = density * sigma * FUM_SQRT_2PI;
  local_from_world(scene->origin, set->positions + 3 * i, out->positions + 3 * at);
  out->weights[2 * at] = (float)(inverse < 1e18 ? inverse : 1e18); /* its square stays finite */
  out->weights[2 * at + 1] = (float)(depth < 1e30 ? depth : 1e30);
  out->indices[at] = (uint32_t)(set->offset + i);
}

static void collect_all(const fum_scene *scene, const fum_octree_options *options, const chosen *out) {
  int64_t first = 0;
  for (int32_t s = 0; s < scene->particles_count; s++) {
    const fum_particles *set = &scene->particles[s];
    if (!takes(options, s)) continue;
#pragma omp parallel for num_threads(fum_thread_count(scene->context)) schedule(static)
    for (int64_t i = 0; i < set->count; i++) {
      if (fum_progress_in_loop(scene->context, i, CHECK_STRIDE)) continue;
      choose(scene, set, i, 1.0F, out, first + i);
    }
    first += set->count;
  }
}

static void collect_share(const fum_scene *scene, const fum_octree_options *options, const chosen *out) {
  const float share = options->subsampling;
  int64_t n = 0;
  for (int32_t s = 0; s < scene->particles_count; s++) {
    const fum_particles *set = &scene->particles[s];
    if (!takes(options, s)) continue;
    for (int64_t i = 0; i < set->count; i++) {
      if (fum_progress_in_loop(scene->context, i, CHECK_STRIDE)) return;
      if (is_chosen(set, i, share)) choose(scene, set, i, share, out, n++);
    }
  }
}

/* Turns the order of what was chosen into scene indices, and fills in what each particle weighs. */
static void fill_densities(fum_context *context, const chosen *from, fum_octree *octree) {
#pragma omp parallel for num_threads(fum_thread_count(context)) schedule(static)
  for (int64_t i = 0; i < octree->count; i++) {
    if (fum_progress_in_loop(context, i, CHECK_STRIDE)) continue;
    const int64_t at = octree->indices[i];
    octree->indices[i] = from->indices[at];
    octree->inverse_sigmas[i] = from->weights[2 * at];
    octree->optical_depths[i] = from->weights[2 * at + 1];
  }
}

int32_t fum_octree_build(const fum_scene *scene, const fum_octree_options *options, fum_octree **out_octree) {
  fum_context *context = scene->context;
  const int64_t count = count_chosen(scene, options);
  chosen all = {0};
  fum_octree *octree = NULL;
  int32_t status = fum_octree_create(context, scene->origin, count, true, &octree);
  if (status == FUM_OK) status = fum_alloc(context, count, 3 * sizeof *all.positions, "density octree", &all.positions);
  if (status == FUM_OK) status = fum_alloc(context, count, 2 * sizeof *all.weights, "density octree", &all.weights);
  if (status == FUM_OK) status = fum_alloc(context, count, sizeof *all.indices, "density octree", &all.indices);
  if (status != FUM_OK) goto done;
  status = fum_progress_report(context, FUM_STAGE_OCTREE, 0.0F, "Collecting particles");
  if (status != FUM_OK) goto done;
  if (options->subsampling >= 1.0F) {
    collect_all(scene, options, &all);
  } else {
    collect_share(scene, options, &all);
  }
  const unsorted points = {count, all.positions};
  status = build(context, &points, options->leaf_size, octree);
  if (status != FUM_OK) goto done;
  fill_densities(context, &all, octree);
  status = fum_progress_report(context, FUM_STAGE_OCTREE, 1.0F, "Octree is built");
  if (status != FUM_OK) goto done;
  *out_octree = octree;
  octree = NULL;
done:
  fum_free(context, &all.indices);
  fum_free(context, &all.weights);
  fum_free(context, &all.positions);
  fum_octree_destroy(context, octree);
  return status;
}

int32_t fum_octree_build_points(fum_context *context, const double origin[3], int64_t count, const float *positions,
                                int32_t leaf_size, fum_octree **out_octree) {
  const unsorted points = {.count = count, .positions = positions};
  fum_octree *octree = NULL;
  int32_t status = fum_octree_create(context, origin, count, false, &octree);
  if (status != FUM_OK) goto done;
  status = build(context, &points, leaf_size, octree);
  if (status != FUM_OK) goto done;
  *out_octree = octree;
  octree = NULL;
done:
  fum_octree_destroy(context, octree);
  return status;
}
