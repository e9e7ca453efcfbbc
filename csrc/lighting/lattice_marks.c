/* SPDX-License-Identifier: GPL-3.0-or-later */
#include "lighting/lattice_marks.h"

static int64_t blocks_across(const fum_lattice_face *grid) {
  return (grid->columns + 7) / 8;
}

int32_t fum_marks_begin(fum_context *context, const fum_lattice *lattice, fum_marks *m) {
  const char *what = "lattice of light";
  int32_t status = fum_alloc(context, lattice->face_count + 1, sizeof *m->firsts, what, &m->firsts);
  if (status != FUM_OK) return status;
  for (int32_t f = 0; f < lattice->face_count; f++) {
    const fum_lattice_face *grid = &lattice->faces[f];
    m->firsts[f + 1] = m->firsts[f] + blocks_across(grid) * ((grid->rows + 7) / 8);
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
  const int32_t c0 = clamp((lower[0] - grid->origin[0]) * per_column - 1.5F, grid->columns - 1);
  const int32_t c1 = clamp((upper[0] - grid->origin[0]) * per_column + 2.5F, grid->columns - 1);
  const int32_t r0 = clamp((lower[1] - grid->origin[1]) * per_row - 1.5F, grid->rows - 1);
  const int32_t r1 = clamp((upper[1] - grid->origin[1]) * per_row + 2.5F, grid->rows - 1);
  for (int32_t row = r0 & ~7; row <= r1; row += 8) {
    const uint64_t rows = spread_rows(bits_within(row, r0, r1));
    const int64_t word = first_word + row / 8 * blocks_across(grid);
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
  float lower[2], upper[2];
  for (int axis = 0; axis < 2; axis++) {
    const float first = (float)window[2 * axis], last = (float)window[2 * axis + 1], half = b->half[axis] * share;
    lower[axis] = b->is_close ? first : fum_max(first, b->lower[axis] - half);
    upper[axis] = b->is_close ? last : fum_min(last, b->upper[axis] + half);
  }
  if (lower[0] < upper[0] && lower[1] < upper[1])
    mark_face(&task->lattice->faces[face], m->firsts[face], lower, upper, m);
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
  double near, far, reach;   /* ranges of the centres; the largest reach */
} group;

static const group NOTHING = {
    {INFINITY, INFINITY, INFINITY}, {-INFINITY, -INFINITY, -INFINITY}, INFINITY, -INFINITY, 0.0};

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
    g.reach = fum_most(g.reach, fum_footprint((double)task->footprint_sigmas, (double)octree->optical_depths[i]) /
                                    (double)octree->inverse_sigmas[i]);
  }
  return g;
}

/* The group as a whole; false if that is much larger than one of it, or near the camera. */
static bool find_whole(const fum_mark_task *task, const group *g, bunch *out) {
  const double widest = 1.25;
  const bool is_perspective = task->view->type == FUM_CAMERA_PERSPECTIVE;
  const double near = -g->upper[2], far = -g->lower[2];
  if (near - g->reach < task->view->clip_start || near < 1.01 * g->reach) return false;
  const double per_near = is_perspective ? 1.0 / near : 1.0, per_far = is_perspective ? 1.0 / far : 1.0;
  const double per_front = is_perspective ? 1.0 / (near - g->reach) : 1.0;
  for (int axis = 0; axis < 2; axis++) {
    const double low = g->lower[axis], high = g->upper[axis], side = fum_most(-low, high);
    if (high - low > widest * g->reach) return false;
    out->lower[axis] = (float)(low * (low < 0.0 ? per_near : per_far));
    out->upper[axis] = (float)(high * (high > 0.0 ? per_near : per_far));
    out->half[axis] = (float)((side + g->reach) * per_front - side * per_near);
  }
  out->near = (float)g->near;
  out->far = (float)g->far;
  out->reach = (float)g->reach;
  out->is_close = false;
  return g->far - g->near <= widest * g->reach;
}

static void mark_neighbours(const fum_mark_task *task, int64_t begin, int64_t end, fum_marks *m) {
  bunch b;
  const group g = find_group(task, begin, end);
  if (holds_nothing(&g)) return;
  if (find_whole(task, &g, &b)) {
    mark_bunch(task, &b, m);
    return;
  }
  for (int64_t i = begin; i < end; i++) {
    if (find_bunch(task, i, &b)) mark_bunch(task, &b, m);
  }
}

/* A leaf's box of centres as a group, without a look at each of them; nothing where none of them absorbs. */
static group find_leaf_group(const fum_mark_task *task, const fum_octree_node *leaf) {
  const fum_octree *octree = task->octree;
  group g = NOTHING;
  float densest = 0.0F, least_inverse = INFINITY;
  for (uint32_t i = leaf->begin; i < leaf->begin + leaf->count; i++) {
    densest = fum_max(densest, octree->optical_depths[i]);
    least_inverse = fum_min(least_inverse, octree->inverse_sigmas[i]);
  }
  if (!(densest > 0.0F)) return g;
  g.reach = fum_footprint((double)task->footprint_sigmas, (double)densest) / (double)least_inverse;
  for (int corner = 0; corner < 8; corner++) {
    const double local[3] = {(double)(corner & 1 ? leaf->upper : leaf->lower)[0],
                             (double)(corner & 2 ? leaf->upper : leaf->lower)[1],
                             (double)(corner & 4 ? leaf->upper : leaf->lower)[2]};
    take_in(task->view, local, &g);
  }
  /* Between corners it may come nearer. */
  double squared = 0.0;
  for (int axis = 0; axis < 3; axis++)
    squared += 0.25 * pow((double)leaf->upper[axis] - (double)leaf->lower[axis], 2.0);
  if (task->view->type == FUM_CAMERA_PERSPECTIVE) g.near = sqrt(fum_most(g.near * g.near - squared, 0.0));
  return g;
}

static void mark_leaf(const fum_mark_task *task, const fum_octree_node *leaf, fum_marks *m) {
  const uint32_t end = leaf->begin + leaf->count;
  const group g = find_leaf_group(task, leaf);
  bunch b;
  if (holds_nothing(&g)) return;
  if (find_whole(task, &g, &b)) {
    mark_bunch(task, &b, m);
    return;
  }
  for (uint32_t begin = leaf->begin; begin < end; begin += BUNCH)
    mark_neighbours(task, begin, begin + BUNCH < end ? begin + BUNCH : end, m);
}

int32_t fum_marks_set(fum_context *context, const fum_mark_task *task, fum_marks *m) {
  const fum_octree *octree = task->octree;
#pragma omp parallel for num_threads(fum_thread_count(context)) schedule(dynamic, 256)
  for (int64_t i = 0; i < octree->node_count; i++) {
    if (fum_progress_in_loop(context, i, 1 << 9) || octree->nodes[i].children != 0) continue;
    mark_leaf(task, &octree->nodes[i], m);
  }
  return fum_progress_report(context, FUM_STAGE_LIGHTING, 0.0F, "Placing samples of light");
}

/* The sample of a bit; its column and row as well. */
static int64_t sample_of(const fum_lattice_face *grid, int64_t block, int bit, int64_t out_place[2]) {
  out_place[0] = block % blocks_across(grid) * 8 + bit % 8;
  out_place[1] = block / blocks_across(grid) * 8 + bit / 8;
  return grid->first + out_place[1] * grid->columns + out_place[0];
}

static int64_t count_marks(const fum_marks *m, int32_t face) {
  int64_t count = 0;
  for (int64_t w = m->firsts[face]; w < m->firsts[face + 1]; w++)
    count += __builtin_popcountll(m->words[w]);
  return count;
}

static void collect_face(const fum_marks *m, const fum_lattice *lattice, int32_t face, int64_t n) {
  int64_t place[2];
  for (int64_t w = m->firsts[face]; w < m->firsts[face + 1]; w++) {
    for (uint64_t word = m->words[w]; word != 0; word &= word - 1) {
      const int bit = __builtin_ctzll(word);
      lattice->samples[n++] = (uint32_t)sample_of(&lattice->faces[face], w - m->firsts[face], bit, place);
    }
  }
}

int32_t fum_marks_collect(fum_context *context, const fum_marks *m, fum_lattice *lattice) {
  const char *what = "lattice of light";
  const int32_t faces = lattice->face_count;
  int64_t *begins = NULL;
  int32_t status = fum_alloc(context, faces, sizeof *begins, what, &begins);
  for (int32_t f = 0; f < faces && status == FUM_OK; f++) {
    begins[f] = lattice->lit_count;
    lattice->lit_count += count_marks(m, f);
  }
  if (status == FUM_OK)
    status = fum_alloc(context, lattice->lit_count, sizeof *lattice->samples, what, &lattice->samples);
#pragma omp parallel for num_threads(fum_thread_count(context)) schedule(dynamic)
  for (int32_t f = 0; f < (status == FUM_OK ? faces : 0); f++)
    collect_face(m, lattice, f, begins[f]);
  fum_free(context, &begins);
  return status;
}

void fum_marks_unset_hidden(fum_context *context, const fum_lattice *lattice, fum_marks *m) {
  if (lattice->hidden.depths == NULL) return;
#pragma omp parallel for num_threads(fum_thread_count(context)) schedule(dynamic)
  for (int32_t f = 0; f < lattice->face_count; f++) {
    const fum_lattice_face *grid = &lattice->faces[f];
    for (int64_t w = m->firsts[f]; w < m->firsts[f + 1]; w++) {
      uint64_t kept = 0;
      for (uint64_t word = m->words[w]; word != 0; word &= word - 1) {
        int64_t place[2];
        (void)sample_of(grid, w - m->firsts[f], __builtin_ctzll(word), place);
        const float u = grid->origin[0] + grid->spacing[0] * (float)place[0];
        const float v = grid->origin[1] + grid->spacing[1] * (float)place[1];
        if (!fum_hidden_ask(&lattice->hidden, f, u, v)) kept |= word & (~word + 1);
      }
      m->words[w] = kept;
    }
  }
}
