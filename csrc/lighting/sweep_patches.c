/* SPDX-License-Identifier: GPL-3.0-or-later */
#include "lighting/sweep_patches.h"

#include <stdlib.h>
#include <string.h>

/* Grid lines across a patch, and patches across a face. */
enum { PATCH_CELLS = 64, MOST_PATCHES = 255 };

bool fum_sweep_lay(const fum_sweep_level *level, fum_sweep_view *view, int64_t *out_count) {
  /* A patch is small against the sphere too, so that its cells are alike; and there are enough for many threads. But
   * casters reach into more of small ones. */
  const double widest = view->face_count > 1 ? 0.7 : fmin(0.5, fmax(0.25, 32.0 * (double)level->cell));
  int64_t count = 0;
  for (int f = 0; f < view->face_count; f++) {
    fum_sweep_face *face = &view->faces[f];
    const double side = (double)(face->upper[0] - face->lower[0]), cells = side / (double)level->cell;
    const double least = view->is_parallel ? 1.0 : ceil(side / widest);
    const double patches = fmax(least, ceil(cells / PATCH_CELLS));
    if (!(patches <= MOST_PATCHES)) return false;
    face->columns = face->rows = (int32_t)patches;
    face->first_patch = count;
    count += (int64_t)face->columns * face->rows;
  }
  *out_count = count;
  return true;
}

/* Patches of a face that a ball is seen in; none where an end is not behind its begin. */
typedef struct span {
  uint8_t begin[2], end[2];
} span;

/* A point as seen from the light, along a face's axes... */
static fum_vec3 see(const fum_sweep_view *view, const fum_sweep_face *face, fum_vec3 point) {
  const fum_vec3 q = fum_sub(point, view->middle);
  return (fum_vec3){fum_dot(q, face->right) + face->offset[0], fum_dot(q, face->up) + face->offset[1],
                    fum_dot(q, face->axis) + face->offset[2]};
}

/* ...and along those of the world. */
static fum_vec3 see_plainly(const fum_sweep_view *view, fum_vec3 point) {
  const double *o = view->to_middle;
  return (fum_vec3){point.x - view->middle.x + (float)o[0], point.y - view->middle.y + (float)o[1],
                    point.z - view->middle.z + (float)o[2]};
}

/* Window of a ball, in the plane of one of the face's sides and its axis: the tangents of its outlines, INFINITY where
 * it reaches past the light. False if it is behind the light. */
static bool find_window(float lateral, float axial, float radius, float *low, float *high) {
  const float squared = lateral * lateral + axial * axial - radius * radius;
  *low = -INFINITY;
  *high = INFINITY;
  if (!(squared > 0.0F)) return true;
  const float s = sqrtf(squared), before = axial * s + lateral * radius, behind = axial * s - lateral * radius;
  if (lateral > 0.0F ? before <= 0.0F : lateral < 0.0F && behind <= 0.0F) return false;
  if (before > 0.0F) *low = (lateral * s - axial * radius) / before;
  if (behind > 0.0F) *high = (lateral * s + axial * radius) / behind;
  return true;
}

static span find_span(bool is_parallel, const fum_sweep_face *face, fum_vec3 p, float radius) {
  const float lateral[2] = {p.x, p.y};
  const int32_t counts[2] = {face->columns, face->rows};
  const span none = {{0, 0}, {0, 0}};
  span s = none;
  if (!is_parallel && p.z + radius <= 0.0F) return none;
  for (int axis = 0; axis < 2; axis++) {
    float low = lateral[axis] - radius, high = lateral[axis] + radius;
    if (!is_parallel && !find_window(lateral[axis], p.z, radius, &low, &high)) return none;
    if (!(high >= face->lower[axis] && low <= face->upper[axis])) return none;
    const float per_unit = (float)counts[axis] / (face->upper[axis] - face->lower[axis]);
    const float first = (low - face->lower[axis]) * per_unit, last = (high - face->lower[axis]) * per_unit;
    const float most = (float)(counts[axis] - 1);
    s.begin[axis] = (uint8_t)(first > 0.0F ? first < most ? first : most : 0.0F);
    s.end[axis] = (uint8_t)((int32_t)(last < most ? last : most) + 1);
  }
  return s;
}

/* What is sorted: leaves, and how they are seen. */
typedef struct sorting {
  const fum_sweep_view *view;
  const fum_sweep_level *level;
  const fum_octree *casters, *points;
  const uint8_t *is_lit;
  float sigma_scale;
} sorting;

/* Is a ball clearly outside of the pyramid over a side of the cube? They look along x, against x, along y and so on. */
static bool is_outside(fum_vec3 p, int side, float radius) {
  const float at[3] = {p.x, p.y, p.z};
  const int axis = side / 2;
  const float lateral = fum_max(fabsf(at[(axis + 1) % 3]), fabsf(at[(axis + 2) % 3]));
  return lateral - 1.01F * (side % 2 == 0 ? at[axis] : -at[axis]) > 1.43F * radius;
}

/* How far casters of the level reach out of a leaf, cells of the grid included; 0: there are none of this level. */
static float reach_of(const sorting *s, const fum_octree_node *leaf) {
  const fum_sweep_level *level = s->level;
  float reach = 0.0F;
  for (uint32_t i = leaf->begin; i < leaf->begin + leaf->count; i++) {
    const float seen = s->view->sigmas[i];
    if (!(seen > 0.0F && seen >= level->smallest && seen < level->largest)) continue;
    const float sigma = s->sigma_scale / s->casters->inverse_sigmas[i];
    reach = fum_max(reach, s->view->widest[i] * s->view->reach + sigma * 2.1F * level->cell / seen);
  }
  return reach;
}

static bool has_lit(const sorting *s, const fum_octree_node *leaf) {
  for (uint32_t i = leaf->begin; i < leaf->begin + leaf->count; i++) {
    if (s->is_lit[i]) return true;
  }
  return false;
}

/* Receivers of so many go to patches together where they are in one. */
enum { MOST_TOGETHER = 256 };

static bool is_together(const fum_octree_node *node) {
  return node->children == 0 || node->count <= MOST_TOGETHER;
}

/* Distance of a ball around receivers from the light, and its radius with room for rounding. */
static float find_rounded(const sorting *s, const fum_octree_node *node, float *out_distance) {
  *out_distance = fum_length(see_plainly(s->view, fum_sweep_middle(node)));
  return 1.001F * fum_sweep_radius(node) + 1e-5F * *out_distance;
}

static bool is_behind_begin(const sorting *s, const fum_octree_node *node) {
  float distance;
  const float radius = find_rounded(s, node, &distance);
  return s->view->is_parallel || distance - radius >= (float)s->level->begin;
}

/* The ball of a node of casters or receivers that patches are told of; negative: of none. */
static float find_ball(const sorting *s, bool is_casters, const fum_octree_node *node) {
  const float nothing = -1.0F;
  float distance;
  if (is_casters) {
    const float reach = node->children == 0 ? reach_of(s, node) : 0.0F;
    return reach > 0.0F ? fum_sweep_radius(node) + reach : nothing;
  }
  if (!is_together(node)) return nothing;
  const float radius = find_rounded(s, node, &distance);
  if (!s->view->is_parallel && distance + radius < (float)s->level->begin) return nothing;
  return has_lit(s, node) ? radius : nothing;
}

/* Where a node is: on a face, or one of these; its children are to be asked instead of a divided one. */
enum { NOWHERE = -1, DIVIDED = -2, ON_SEVERAL_FACES = FUM_SWEEP_FACES };

typedef struct place {
  int8_t face;
  bool is_whole; /* receivers, all in one patch */
  span span;
} place;

/* Lists that are filled: first each patch's leaves are counted, then they are written down at the places counted. */
typedef struct filling {
  int64_t *cursors; /* [patch_count] */
  uint32_t *list;   /* NULL: only counted */
} filling;

static void put(const fum_sweep_face *face, span s, uint32_t entry, const filling *f) {
  for (int32_t row = s.begin[1]; row < s.end[1]; row++) {
    for (int32_t column = s.begin[0]; column < s.end[0]; column++) {
      const int64_t at = f->cursors[face->first_patch + (int64_t)row * face->columns + column]++;
      if (f->list != NULL) f->list[at] = entry;
    }
  }
}

/* Places of a ball on the faces, one after the other: sets `*n` to the next face from that on. False at the end. */
static bool find_on_faces(const sorting *s, fum_vec3 middle, float radius, int *n, span *out) {
  const fum_sweep_view *view = s->view;
  const fum_vec3 plain = see_plainly(view, middle);
  for (; *n < view->face_count; ++*n) {
    const fum_sweep_face *face = &view->faces[*n];
    if (view->face_count > 1 && is_outside(plain, *n, radius)) continue;
    *out = find_span(view->is_parallel, face, see(view, face, middle), radius);
    if (out->end[0] != 0) return true;
  }
  return false;
}

static place find_place(const sorting *s, bool is_casters, const fum_octree_node *node) {
  const float radius = find_ball(s, is_casters, node);
  place found = {.face = NOWHERE};
  span on_face;
  if (radius < 0.0F) return found;
  for (int n = 0; find_on_faces(s, fum_sweep_middle(node), radius, &n, &on_face); n++)
    found = (place){(int8_t)(found.face == NOWHERE ? n : ON_SEVERAL_FACES), false, on_face};
  const span *own = &found.span;
  if (is_casters || found.face == NOWHERE) return found;
  found.is_whole = found.face != ON_SEVERAL_FACES && own->end[0] - own->begin[0] == 1 &&
                   own->end[1] - own->begin[1] == 1 && is_behind_begin(s, node);
  if (node->children != 0 && !found.is_whole) found.face = DIVIDED;
  return found;
}

/* Counts a node, whose place is found for that, or writes it down. What is on several faces is looked for again,
 * instead of being remembered. */
static void put_node(const sorting *s, bool is_casters, int64_t i, place *places, const filling *f) {
  const fum_octree_node *node = &(is_casters ? s->casters : s->points)->nodes[i];
  if (f->list == NULL) places[i] = find_place(s, is_casters, node);
  const place at = places[i];
  if (at.face == DIVIDED) {
    for (int c = 0; c < __builtin_popcount(node->octants); c++)
      put_node(s, is_casters, (int64_t)node->children + c, places, f);
  } else if (at.face == ON_SEVERAL_FACES) {
    const float radius = find_ball(s, is_casters, node);
    span on_face;
    for (int n = 0; find_on_faces(s, fum_sweep_middle(node), radius, &n, &on_face); n++)
      put(&s->view->faces[n], on_face, (uint32_t)i, f);
  } else if (at.face != NOWHERE) {
    put(&s->view->faces[at.face], at.span, (uint32_t)i | (at.is_whole ? FUM_SWEEP_WHOLE : 0), f);
  }
}

/* Puts the nodes of a block, but those below others that are put together. */
static void put_block(const sorting *s, bool is_casters, const uint8_t *is_below, int block, int blocks, place *places,
                      const filling *f) {
  const int64_t count = (is_casters ? s->casters : s->points)->node_count, end = count * (block + 1) / blocks;
  for (int64_t i = count * block / blocks; i < end; i++) {
    if (!is_below[i]) put_node(s, is_casters, i, places, f);
  }
}

/* Children come after their parents. */
static void mark_below(const fum_octree *points, uint8_t *is_below) {
  for (int64_t i = 0; i < points->node_count; i++) {
    const fum_octree_node *node = &points->nodes[i];
    if (node->children != 0 && (is_below[i] || is_together(node)))
      memset(is_below + node->children, 1, (size_t)__builtin_popcount(node->octants));
  }
}

/* Counting sort: each block of leaves counts, then writes to places of its own, so that every list stays in order
 * whatever the number of threads. */
static int32_t fill(fum_context *context, const sorting *s, bool is_casters, int64_t patch_count, int64_t *begins,
                    uint32_t **out_list) {
  const char *what = "patches of a light";
  const int64_t count = (is_casters ? s->casters : s->points)->node_count;
  const int threads = fum_thread_count(context), blocks = threads > 1 ? 8 * threads : 1;
  int64_t *cursors = NULL, total = 0;
  place *places = NULL;
  uint8_t *is_below = NULL;
  int32_t status = fum_alloc(context, blocks * patch_count, sizeof *cursors, what, &cursors);
  if (status == FUM_OK) status = fum_alloc(context, count, sizeof *places, what, &places);
  if (status == FUM_OK) status = fum_alloc(context, count, sizeof *is_below, what, &is_below);
  if (status != FUM_OK) goto done;
  if (!is_casters) mark_below(s->points, is_below);
#pragma omp parallel for num_threads(threads) schedule(dynamic, 1)
  for (int block = 0; block < blocks; block++) {
    const filling f = {cursors + block * patch_count, NULL};
    put_block(s, is_casters, is_below, block, blocks, places, &f);
  }
  for (int64_t patch = 0; patch < patch_count; patch++) {
    begins[patch] = total;
    for (int block = 0; block < blocks; block++) {
      const int64_t n = cursors[block * patch_count + patch];
      cursors[block * patch_count + patch] = total;
      total += n;
    }
  }
  begins[patch_count] = total;
  status = fum_alloc(context, total, sizeof **out_list, what, out_list);
  if (status != FUM_OK) goto done;
#pragma omp parallel for num_threads(threads) schedule(dynamic, 1)
  for (int block = 0; block < blocks; block++) {
    const filling f = {cursors + block * patch_count, *out_list};
    put_block(s, is_casters, is_below, block, blocks, places, &f);
  }
done:
  fum_free(context, &is_below);
  fum_free(context, &places);
  fum_free(context, &cursors);
  return status;
}

static int compare_patches(const void *a, const void *b) {
  const fum_sweep_patch *x = a, *y = b;
  if (x->leaf_count != y->leaf_count) return x->leaf_count < y->leaf_count ? 1 : -1;
  return (x->index > y->index) - (x->index < y->index);
}

/* Those that take longest come first, so that no thread begins one of them when the others end. */
static void order_patches(fum_sweep_patches *patches) {
  for (int64_t i = 0; i < patches->count; i++) {
    const int64_t casters = patches->caster_begins[i + 1] - patches->caster_begins[i];
    const int64_t receivers = patches->receiver_begins[i + 1] - patches->receiver_begins[i];
    patches->order[i] = (fum_sweep_patch){i, casters > 0 && receivers > 0 ? casters + receivers : 0};
  }
  qsort(patches->order, (size_t)patches->count, sizeof *patches->order, compare_patches);
}

int32_t fum_sweep_sort(fum_context *context, const fum_medium *medium, const fum_receivers *receivers,
                       const uint8_t *is_lit, const fum_sweep_view *view, const fum_sweep_level *level,
                       fum_sweep_patches *patches) {
  const char *what = "patches of a light";
  const sorting s = {view, level, fum_medium_casters(medium), receivers->octree, is_lit, medium->sigma_scale};
  int32_t status = fum_alloc(context, patches->count + 1, sizeof(int64_t), what, &patches->caster_begins);
  if (status == FUM_OK)
    status = fum_alloc(context, patches->count + 1, sizeof(int64_t), what, &patches->receiver_begins);
  if (status == FUM_OK)
    status = fill(context, &s, false, patches->count, patches->receiver_begins, &patches->receivers);
  if (status == FUM_OK) status = fill(context, &s, true, patches->count, patches->caster_begins, &patches->casters);
  if (status == FUM_OK) status = fum_alloc(context, patches->count, sizeof *patches->order, what, &patches->order);
  if (status == FUM_OK) order_patches(patches);
  return status;
}

void fum_sweep_patches_free(fum_context *context, fum_sweep_patches *patches) {
  fum_free(context, &patches->order);
  fum_free(context, &patches->caster_begins);
  fum_free(context, &patches->receiver_begins);
  fum_free(context, &patches->casters);
  fum_free(context, &patches->receivers);
}
