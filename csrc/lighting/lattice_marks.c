/* SPDX-License-Identifier: GPL-3.0-or-later */
#include "lighting/lattice_marks.h"

int32_t fum_marks_begin(fum_context *context, const fum_lattice *lattice, fum_marks *m) {
  const char *what = "lattice of light";
  int32_t status = fum_alloc(context, lattice->face_count + 1, sizeof *m->firsts, what, &m->firsts);
  if (status != FUM_OK) return status;
  for (int32_t f = 0; f < lattice->face_count; f++) {
    const fum_lattice_face *grid = &lattice->faces[f];
    m->firsts[f + 1] = m->firsts[f] + fum_blocks_across(grid) * ((grid->rows + 7) / 8);
  }
  return fum_alloc(context, m->firsts[lattice->face_count], sizeof *m->words, what, &m->words);
}

void fum_marks_end(fum_context *context, fum_marks *m) {
  fum_free(context, &m->words);
  fum_free(context, &m->firsts);
}

static void mark_word(fum_marks *m, int64_t word, uint64_t bits) {
  if ((atomic_load_explicit(&m->words[word], memory_order_relaxed) & bits) != bits)
    atomic_fetch_or_explicit(&m->words[word], bits, memory_order_relaxed);
}

/* Those of 0..7 that are from `first` to `last` beyond `base`, as bits. */
static uint64_t bits_within(int32_t base, int32_t first, int32_t last) {
  const int32_t low = first > base ? first - base : 0, high = last < base + 7 ? last - base : 7;
  return (UINT64_C(2) << high) - (UINT64_C(1) << low);
}

/* Eight bits to the lowest ones of eight bytes. */
static uint64_t spread_rows(uint64_t bits) {
  const uint64_t nibbles = (bits | bits << 28) & UINT64_C(0x0000000f0000000f);
  const uint64_t pairs = (nibbles | nibbles << 14) & UINT64_C(0x0003000300030003);
  return (pairs | pairs << 7) & UINT64_C(0x0101010101010101);
}

static int32_t clamp(float value, int32_t high) {
  return value < 0.0F ? 0 : value > (float)high ? high : (int32_t)value;
}

/* Marks the samples of one face that interpolation needs in a rectangle of the window. */
static void mark_face(const fum_lattice_face *grid, int64_t first_word, const float lower[2], const float upper[2],
                      fum_marks *m) {
  if (grid->columns == 0) return;
  const float per_column = 1.0F / grid->spacing[0], per_row = 1.0F / grid->spacing[1];
  /* Around a place, a little more for rounding; on pixels for particles that are drawn wider than they are. */
  const float before = grid->is_on_pixels ? 1.5F : 1.05F, behind = 1.0F + before;
  const int32_t c0 = clamp((lower[0] - grid->origin[0]) * per_column - before, grid->columns - 1);
  const int32_t c1 = clamp((upper[0] - grid->origin[0]) * per_column + behind, grid->columns - 1);
  const int32_t r0 = clamp((lower[1] - grid->origin[1]) * per_row - before, grid->rows - 1);
  const int32_t r1 = clamp((upper[1] - grid->origin[1]) * per_row + behind, grid->rows - 1);
  for (int32_t row = r0 & ~7; row <= r1; row += 8) {
    const uint64_t rows = spread_rows(bits_within(row, r0, r1));
    const int64_t word = first_word + row / 8 * fum_blocks_across(grid);
    for (int32_t column = c0 & ~7; column <= c1; column += 8)
      mark_word(m, word + column / 8, rows * bits_within(column, c0, c1));
  }
}

/* Particles on their way into the marks: one, or a few close ones as a whole. */
typedef struct bunch {
  float lower[2], upper[2]; /* of the centres, in the window */
  float near, far;          /* ranges of the centres */
  float half[2];            /* of the largest outline around its centre */
  float reach;              /* m along the view, of the largest */
  bool is_close;            /* around the camera: no part of it is known to be smaller */
} bunch;

/* False if the particle isn't in the frame. */
static bool find_bunch(const fum_mark_task *task, int64_t i, bunch *out) {
  const fum_octree *octree = task->octree;
  const fum_view *view = task->view;
  const double local[3] = {(double)octree->x[i], (double)octree->y[i], (double)octree->z[i]};
  const double reach = fum_footprint((double)task->footprint_sigmas, (double)octree->optical_depths[i]) /
                       (double)octree->inverse_sigmas[i];
  double c[3];
  float lower[2], upper[2];
  fum_transform_point(view->camera_from_local, local, c);
  if (-c[2] + reach < view->clip_start || !(octree->optical_depths[i] > 0.0F)) return false;
  fum_view_cover(view, c, reach, lower, upper);
  if (!(lower[0] < upper[0] && lower[1] < upper[1])) return false;
  const bool is_perspective = view->type == FUM_CAMERA_PERSPECTIVE;
  const double depth = is_perspective ? -c[2] : 1.0, per_depth = 1.0 / depth;
  const double near = is_perspective ? 1.0 / (depth - reach) : 1.0;
  out->near = out->far = (float)(is_perspective ? sqrt(c[0] * c[0] + c[1] * c[1] + c[2] * c[2]) : -c[2]);
  out->reach = (float)reach;
  out->is_close = is_perspective && depth <= 1.01 * reach;
  for (int axis = 0; axis < 2; axis++) {
    out->lower[axis] = out->upper[axis] = (float)(c[axis] * per_depth);
    out->half[axis] = (float)((fabs(c[axis]) + reach) * near - fabs(c[axis]) * per_depth);
  }
  return true;
}

/* Marks what is needed on a face of spheres in the particles, `share` of their radii. The outline of a sphere grows at
 * least in proportion to its radius. */
static void mark_part(const fum_mark_task *task, const bunch *b, float share, int32_t face, fum_marks *m) {
  const double *window = task->view->window;
  const fum_lattice_face *grid = &task->lattice->faces[face];
  float lower[2], upper[2];
  for (int axis = 0; axis < 2; axis++) {
    /* One sample more at the frame's sides, where smoke goes on: splines know less at their ends. */
    const float more = grid->spacing[axis], half = b->half[axis] * share;
    const float first = (float)window[2 * axis] - more, last = (float)window[2 * axis + 1] + more;
    lower[axis] = b->is_close ? first : fum_max(first, b->lower[axis] - half);
    upper[axis] = b->is_close ? last : fum_min(last, b->upper[axis] + half);
  }
  if (lower[0] < upper[0] && lower[1] < upper[1]) mark_face(grid, m->firsts[face], lower, upper, m);
}

static void mark_bunch(const fum_mark_task *task, const bunch *b, fum_marks *m) {
  const fum_face *faces = task->slabs->faces;
  const int32_t last = task->slabs->count;
  const float per_reach = 1.0F / b->reach;
  for (int32_t f = fum_slab_at(task->slabs, (double)(b->near - b->reach)); f <= last; f++) {
    /* Light on a face serves the slabs on both of its sides. */
    const float before = faces[f > 0 ? f - 1 : f].range, next = faces[f < last ? f + 1 : f].range;
    const float gap = before > b->far ? before - b->far : next < b->near ? b->near - next : 0.0F;
    const float along = gap * per_reach;
    if (along <= 1.0F) mark_part(task, b, sqrtf(1.0F - along * along), f, m);
    if (faces[f].range > b->far + b->reach) break;
  }
}

/* Neighbours in the octree's order that are marked as one where they are close. */
enum { BUNCH = 8 };

/* What neighbours have in common, in camera space. */
typedef struct group {
  double lower[3], upper[3]; /* of their centres */
  double near, far;          /* ranges of the centres */
  double reach, least_reach; /* the largest and the smallest */
} group;

static const group NOTHING = {
    {INFINITY, INFINITY, INFINITY}, {-INFINITY, -INFINITY, -INFINITY}, INFINITY, -INFINITY, 0.0, INFINITY};

static bool holds_nothing(const group *g) {
  return g->near > g->far;
}

static void take_in(const fum_view *view, const double local[3], group *g) {
  const bool is_perspective = view->type == FUM_CAMERA_PERSPECTIVE;
  double c[3];
  fum_transform_point(view->camera_from_local, local, c);
  for (int axis = 0; axis < 3; axis++) {
    g->lower[axis] = fum_least(g->lower[axis], c[axis]);
    g->upper[axis] = fum_most(g->upper[axis], c[axis]);
  }
  const double range = is_perspective ? sqrt(c[0] * c[0] + c[1] * c[1] + c[2] * c[2]) : -c[2];
  g->near = fum_least(g->near, range);
  g->far = fum_most(g->far, range);
}

static group find_group(const fum_mark_task *task, int64_t begin, int64_t end) {
  const fum_octree *octree = task->octree;
  group g = NOTHING;
  for (int64_t i = begin; i < end; i++) {
    const double local[3] = {(double)octree->x[i], (double)octree->y[i], (double)octree->z[i]};
    if (!(octree->optical_depths[i] > 0.0F)) continue;
    take_in(task->view, local, &g);
    const double reach = fum_footprint((double)task->footprint_sigmas, (double)octree->optical_depths[i]) /
                         (double)octree->inverse_sigmas[i];
    g.reach = fum_most(g.reach, reach);
    g.least_reach = fum_least(g.least_reach, reach);
  }
  return g;
}

/* The group of `count` as a whole; false if there is room between them, or they are near the camera. Around wholes of
 * many 2 % more samples are marked than around each particle. */
static bool find_whole(const fum_mark_task *task, const group *g, int64_t count, bunch *out) {
  const double widest = (count <= BUNCH ? 1.25 : 0.45 * cbrt((double)count)) * g->least_reach;
  const bool is_perspective = task->view->type == FUM_CAMERA_PERSPECTIVE;
  const double near = -g->upper[2], far = -g->lower[2];
  if (near - g->reach < task->view->clip_start || near < 1.01 * g->reach) return false;
  const double per_near = is_perspective ? 1.0 / near : 1.0, per_far = is_perspective ? 1.0 / far : 1.0;
  const double per_front = is_perspective ? 1.0 / (near - g->reach) : 1.0;
  for (int axis = 0; axis < 2; axis++) {
    const double low = g->lower[axis], high = g->upper[axis], side = fum_most(-low, high);
    if (high - low > widest) return false;
    out->lower[axis] = (float)(low * (low < 0.0 ? per_near : per_far));
    out->upper[axis] = (float)(high * (high > 0.0 ? per_near : per_far));
    out->half[axis] = (float)((side + g->reach) * per_front - side * per_near);
  }
  out->near = (float)g->near;
  out->far = (float)g->far;
  out->reach = (float)g->reach;
  out->is_close = false;
  return g->far - g->near <= widest;
}

static void mark_neighbours(const fum_mark_task *task, int64_t begin, int64_t end, fum_marks *m) {
  bunch b;
  const group g = find_group(task, begin, end);
  if (holds_nothing(&g)) return;
  if (find_whole(task, &g, end - begin, &b)) {
    mark_bunch(task, &b, m);
    return;
  }
  for (int64_t i = begin; i < end; i++) {
    if (find_bunch(task, i, &b)) mark_bunch(task, &b, m);
  }
}

/* A node's box of centres as a group, without a look at each of them; nothing where none of them absorbs. */
static group find_node_group(const fum_mark_task *task, const fum_octree_node *node) {
  const fum_octree *octree = task->octree;
  group g = NOTHING;
  float densest = 0.0F, thinnest = INFINITY, least_inverse = INFINITY, most_inverse = 0.0F;
  for (uint32_t i = node->begin; i < node->begin + node->count; i++) {
    densest = fum_max(densest, octree->optical_depths[i]);
    thinnest = fum_min(thinnest, octree->optical_depths[i]);
    least_inverse = fum_min(least_inverse, octree->inverse_sigmas[i]);
    most_inverse = fum_max(most_inverse, octree->inverse_sigmas[i]);
  }
  if (!(densest > 0.0F)) return g;
  g.reach = fum_footprint((double)task->footprint_sigmas, (double)densest) / (double)least_inverse;
  g.least_reach = fum_footprint((double)task->footprint_sigmas, (double)thinnest) / (double)most_inverse;
  for (int corner = 0; corner < 8; corner++) {
    const double local[3] = {(double)(corner & 1 ? node->upper : node->lower)[0],
                             (double)(corner & 2 ? node->upper : node->lower)[1],
                             (double)(corner & 4 ? node->upper : node->lower)[2]};
    take_in(task->view, local, &g);
  }
  /* Between corners it may come nearer. */
  double squared = 0.0;
  for (int axis = 0; axis < 3; axis++)
    squared += 0.25 * pow((double)node->upper[axis] - (double)node->lower[axis], 2.0);
  if (task->view->type == FUM_CAMERA_PERSPECTIVE) g.near = sqrt(fum_most(g.near * g.near - squared, 0.0));
  return g;
}

static void mark_node(const fum_mark_task *task, const fum_octree_node *node, fum_marks *m) {
  const fum_octree *octree = task->octree;
  const uint32_t end = node->begin + node->count;
  const group g = find_node_group(task, node);
  bunch b;
  if (holds_nothing(&g)) return;
  if (find_whole(task, &g, node->count, &b)) {
    mark_bunch(task, &b, m);
  } else if (node->children != 0) {
    for (int c = 0; c < __builtin_popcount(node->octants); c++)
      mark_node(task, &octree->nodes[node->children + (uint32_t)c], m);
  } else {
    for (uint32_t begin = node->begin; begin < end; begin += BUNCH)
      mark_neighbours(task, begin, begin + BUNCH < end ? begin + BUNCH : end, m);
  }
}

/* Particles that are looked at together. */
enum { MOST_IN_NODE = 512 };

static bool is_small(const fum_octree_node *node) {
  return node->count <= MOST_IN_NODE || node->children == 0;
}

int32_t fum_marks_set(fum_context *context, const fum_mark_task *task, fum_marks *m) {
  const fum_octree *octree = task->octree;
  if (octree->node_count > 0 && is_small(&octree->nodes[0])) mark_node(task, &octree->nodes[0], m);
#pragma omp parallel for num_threads(fum_thread_count(context)) schedule(dynamic, 64)
  for (int64_t i = 0; i < octree->node_count; i++) {
    if (fum_progress_in_loop(context, i, 1 << 9) || is_small(&octree->nodes[i])) continue;
    for (int c = 0; c < __builtin_popcount(octree->nodes[i].octants); c++) {
      const fum_octree_node *child = &octree->nodes[octree->nodes[i].children + (uint32_t)c];
      if (is_small(child)) mark_node(task, child, m);
    }
  }
  return fum_progress_report(context, FUM_STAGE_LIGHTING, 0.0F, "Placing samples of light");
}

/* What is left of a face's block of marks. */
static uint64_t unset_hidden(const fum_hidden *hidden, int32_t face, int64_t block, uint64_t word) {
  const fum_lattice_face *grid = &hidden->faces[face];
  const int64_t place[2] = {block % fum_blocks_across(grid) * 8, block / fum_blocks_across(grid) * 8};
  uint64_t kept = 0;
  float lower[2], upper[2];
  for (int axis = 0; axis < 2; axis++) {
    lower[axis] = grid->origin[axis] + grid->spacing[axis] * (float)place[axis];
    upper[axis] = grid->origin[axis] + grid->spacing[axis] * (float)(place[axis] + 7);
  }
  if (!fum_hidden_touches(hidden, face, lower, upper)) return word;
  for (; word != 0; word &= word - 1) {
    const int bit = __builtin_ctzll(word);
    const float u = grid->origin[0] + grid->spacing[0] * (float)(place[0] + bit % 8);
    const float v = grid->origin[1] + grid->spacing[1] * (float)(place[1] + bit / 8);
    if (!fum_hidden_ask(hidden, face, u, v)) kept |= word & (~word + 1);
  }
  return kept;
}

void fum_marks_unset_hidden(fum_context *context, const fum_lattice *lattice, fum_marks *m) {
  if (lattice->hidden.depths == NULL) return;
#pragma omp parallel for num_threads(fum_thread_count(context)) schedule(dynamic)
  for (int32_t f = 0; f < lattice->face_count; f++) {
    for (int64_t w = m->firsts[f]; w < m->firsts[f + 1]; w++) {
      if (m->words[w] != 0) m->words[w] = unset_hidden(&lattice->hidden, f, w - m->firsts[f], m->words[w]);
    }
  }
}
