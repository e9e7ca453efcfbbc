/* SPDX-License-Identifier: GPL-3.0-or-later */
/* The loops of sweep.h for one patch, to be compiled once for each instruction set: sweep_*.c define FUM_LANES and
 * FUM_SWEEP_NAME. */
#include "base/simd.h"
#include "lighting/sweep.h"

#include <math.h>
#include <stdlib.h>
#include <string.h>

/* Casters and receivers are fetched from memory so many before they are needed: their order is not that of memory. */
enum { AHEAD = 8 };

/* A cell is a line of sixteen faces, face f at f % 16, whatever the instruction set: one cache line. As many casters'
 * faces are open at once; two slabs are worked on at a time. */
enum { FACES = 16, BATCH = 2, MOST_COLUMNS = 32, MOST_SPAN = FACES - 2 * BATCH };

/* A caster in its patch. */
typedef struct footprint {
  float column, row;          /* of its centre, in cells */
  float u, v;                 /* the same in the patch's window; 0 of a parallel light */
  float squared_cosine;       /* between its ray and the axis */
  float across, up, both;     /* its Gaussian is 2^(across x^2 + up y^2 + both x y), in cells, on a flat plane */
  float optical_depth;        /* at its centre */
  float reach;                /* in cells */
  float range, inverse_sigma; /* in slabs */
  int32_t first, last;        /* slabs that it reaches into */
} footprint;

typedef struct patch {
  const fum_sweep_job *job;
  fum_vec3 right, up, axis;
  float offset[3];
  int32_t face, place[2]; /* of the view; column and row of the patch on it */
  float lower[2];         /* window of grid line 0 */
  int32_t columns, rows;
  float *lines; /* [rows][columns][FACES] optical depth in front of faces */
  int32_t open; /* the first face that is open; FACES are */
} patch;

/* Corner of the patch on its face, as a direction from the light or a place across a parallel one. */
static fum_vec3 corner_of(const fum_sweep_face *face, float u, float v, bool is_parallel) {
  fum_vec3 p = fum_mad(face->right, u, fum_scaled(face->up, v));
  return is_parallel ? p : fum_mad(face->axis, 1.0F, p);
}

/* The patch's own plane touches the sphere around the light in the middle of the patch. */
static void turn(patch *p, const fum_sweep_face *face, const float ends[4]) {
  p->right = face->right;
  p->up = face->up;
  p->axis = face->axis;
  if (!p->job->view->is_parallel) {
    const fum_vec3 middle = corner_of(face, 0.5F * (ends[0] + ends[1]), 0.5F * (ends[2] + ends[3]), false);
    p->axis = fum_scaled(middle, 1.0F / fum_length(middle));
    const fum_vec3 right = fum_mad(p->axis, -fum_dot(face->right, p->axis), face->right);
    p->right = fum_scaled(right, 1.0F / fum_length(right));
    p->up = (fum_vec3){p->right.y * p->axis.z - p->right.z * p->axis.y, p->right.z * p->axis.x - p->right.x * p->axis.z,
                       p->right.x * p->axis.y - p->right.y * p->axis.x};
  }
  const double *o = p->job->view->to_middle;
  const fum_vec3 axes[3] = {p->right, p->up, p->axis};
  for (int k = 0; k < 3; k++)
    p->offset[k] = (float)(o[0] * (double)axes[k].x + o[1] * (double)axes[k].y + o[2] * (double)axes[k].z);
}

/* Room for `bytes`. */
static void *reserve(fum_sweep_scratch *s, fum_sweep_buffer which, int64_t bytes) {
  if (bytes > s->sizes[which]) {
    const size_t size = ((size_t)bytes + 63) / 64 * 64;
    free(s->buffers[which]);
    s->buffers[which] = aligned_alloc(64, size);
    s->sizes[which] = s->buffers[which] != NULL ? (int64_t)size : 0;
  }
  s->is_out_of_memory = s->is_out_of_memory || s->buffers[which] == NULL;
  return s->buffers[which];
}

static void lay_patch(patch *p, int64_t index) {
  const fum_sweep_view *view = p->job->view;
  const float cell = p->job->level->cell;
  int f = 0;
  while (f + 1 < view->face_count && index >= view->faces[f + 1].first_patch)
    f++;
  const fum_sweep_face *face = &view->faces[f];
  const int64_t place = index - face->first_patch;
  p->face = f;
  p->place[0] = (int32_t)(place % face->columns);
  p->place[1] = (int32_t)(place / face->columns);
  const float sides[2] = {(face->upper[0] - face->lower[0]) / (float)face->columns,
                          (face->upper[1] - face->lower[1]) / (float)face->rows};
  float ends[4], lower[2] = {INFINITY, INFINITY}, upper[2] = {-INFINITY, -INFINITY};
  for (int k = 0; k < 4; k++) {
    ends[k] = face->lower[k / 2] + sides[k / 2] * (float)(p->place[k / 2] + k % 2);
  }
  turn(p, face, ends);
  for (int k = 0; k < 4; k++) {
    const fum_vec3 corner = corner_of(face, ends[k % 2], ends[2 + k / 2], view->is_parallel);
    const float depth = view->is_parallel ? 1.0F : fum_dot(corner, p->axis);
    const float at[2] = {fum_dot(corner, p->right) / depth, fum_dot(corner, p->up) / depth};
    for (int axis = 0; axis < 2; axis++) {
      lower[axis] = at[axis] < lower[axis] ? at[axis] : lower[axis];
      upper[axis] = at[axis] > upper[axis] ? at[axis] : upper[axis];
    }
  }
  for (int axis = 0; axis < 2; axis++)
    p->lower[axis] = lower[axis] - FUM_SWEEP_MARGIN * cell;
  p->columns = (int32_t)((upper[0] - p->lower[0]) / cell + FUM_SWEEP_MARGIN) + 1;
  p->rows = (int32_t)((upper[1] - p->lower[1]) / cell + FUM_SWEEP_MARGIN) + 1;
}

#include "lighting/sweep_places.h"

static const float NUMBERS[MOST_COLUMNS] = {0,  1,  2,  3,  4,  5,  6,  7,  8,  9,  10, 11, 12, 13, 14, 15,
                                            16, 17, 18, 19, 20, 21, 22, 23, 24, 25, 26, 27, 28, 29, 30, 31};

/* The normal distribution function within 3e-5 up to 3.4, beyond FUM_SWEEP_SPREAD (least squares, made even). */
static fum_vf normal_share(fum_vf z) {
  const fum_vf squared = z * z;
  fum_vf p = 6.1057255e-8F * squared - 3.2006239e-6F;
  p = p * squared + 7.4185834e-5F;
  p = p * squared - 1.0250507e-3F;
  p = p * squared + 9.6278776e-3F;
  p = p * squared - 6.6156754e-2F;
  p = p * squared + 0.39884803F;
  return 0.5F + z * p;
}

/* Share of a caster in front of each open face, as a line. */
static void find_line(const patch *p, const footprint *f, float line[FACES]) {
  for (int32_t k = 0; k < FACES; k += FUM_LANES) {
    const fum_vf lane = fum_vf_load(NUMBERS + k), turned = lane - (float)(p->open & (FACES - 1));
    const fum_vf face =
        (float)p->open + turned + fum_vf_select(turned < 0.0F, fum_vf_set((float)FACES), fum_vf_set(0.0F));
    const fum_vf z = (face - f->range) * f->inverse_sigma;
    const fum_vf begun = fum_vf_select(face > (float)f->first, normal_share(z), fum_vf_set(0.0F));
    fum_vf_store(line + k, fum_vf_select(face > (float)f->last, fum_vf_set(1.0F), begun));
  }
}

static int32_t at_least(float value, int32_t least) {
  return value > (float)least ? (int32_t)ceilf(value) : least;
}

static int32_t at_most(float value, int32_t most) {
  return value < (float)most ? (int32_t)floorf(value) : most;
}

/* Cells around a caster: a box. */
typedef struct box {
  int32_t x, y, columns, rows; /* from the first cell on */
  int32_t width;               /* 8, 16 or 32, so that rows fill vectors */
} box;

/* False where nothing of the caster is in the patch. */
static bool find_box(const patch *p, const footprint *f, box *out) {
  const int32_t x1 = at_most(f->column + f->reach, p->columns - 1), y1 = at_most(f->row + f->reach, p->rows - 1);
  out->x = at_least(f->column - f->reach, 0);
  out->y = at_least(f->row - f->reach, 0);
  const int32_t columns = x1 - out->x + 1, rows = y1 - out->y + 1;
  if (columns <= 0 || rows <= 0) return false;
  out->columns = columns;
  out->width = columns <= 8 ? 8 : columns <= 16 ? 16 : MOST_COLUMNS;
  out->rows = rows < MOST_COLUMNS ? rows : MOST_COLUMNS;
  return true;
}

/* What a caster adds to cells and faces. */
typedef struct deposit {
  box box;
  float cells[MOST_COLUMNS * MOST_COLUMNS + FUM_LANES]; /* rows one after the other; 0 beyond its reach */
  float line[FACES];
  bool is_empty;
} deposit;

/* Columns and rows of a vector's entries in a box 8 wide, whose rows fill it. */
static const float PAIR_COLUMNS[16] = {0, 1, 2, 3, 4, 5, 6, 7, 0, 1, 2, 3, 4, 5, 6, 7},
                   PAIR_ROWS[16] = {0, 0, 0, 0, 0, 0, 0, 0, 1, 1, 1, 1, 1, 1, 1, 1};

/* What a Gaussian falls to where it ends; behind the box none is as large as that. */
static fum_vf find_edge(const patch *p, const footprint *f, const box *b, fum_vf columns) {
  return fum_vf_select(columns < (float)b->columns, fum_vf_set(f->optical_depth * p->job->edge), fum_vf_set(NAN));
}

/* The plane is flat: that a caster's ray leans on it bends its outline by so little (in tangents) that it doesn't show.
 */
static const float FLAT = 0.01F;

/* Optical depths of a caster at the cells of a box, rows one after the other, where its exponent is of second degree:
 * from one row to the next the Gaussian grows by a factor, which falls off by one that is the same everywhere. */
static void find_flat_cells(const patch *p, const footprint *f, const box *b, float *cells) {
  const int32_t width = b->width, at_once = FUM_LANES > width ? FUM_LANES / width : 1;
  const float across = f->across, up = f->up, both = f->both, step = (float)at_once;
  const fum_vf fall = fum_vf_exp2(fum_vf_set(2.0F * step * step * up));
  const fum_vf y = (at_once > 1 ? fum_vf_load(PAIR_ROWS) : fum_vf_set(0.0F)) + ((float)b->y - f->row);
  for (int32_t column = 0; column < width; column += FUM_LANES) {
    const fum_vf columns = fum_vf_load((at_once > 1 ? PAIR_COLUMNS : NUMBERS) + column);
    const fum_vf x = columns + ((float)b->x - f->column), edge = find_edge(p, f, b, columns);
    fum_vf gauss = f->optical_depth * fum_vf_exp2(across * x * x + both * x * y + up * y * y);
    fum_vf growth = fum_vf_exp2(step * (both * x + up * (2.0F * y + step)));
    for (int32_t row = 0; row < b->rows; row += at_once) {
      fum_vf_store(cells + row * width + column, fum_vf_select(gauss >= edge, gauss, fum_vf_set(0.0F)));
      gauss *= growth;
      growth *= fall;
    }
  }
}

/* The same, whatever the exponent: |centre x ray|^2 over |ray|^2, the quotient by its series. */
static void find_cells(const patch *p, const footprint *f, const box *b, float *cells) {
  const float cell = p->job->level->cell, *columns = b->width == 8 ? PAIR_COLUMNS : NUMBERS;
  const fum_vf rows = b->width == 8 ? fum_vf_load(PAIR_ROWS) : fum_vf_set(0.0F);
  for (int32_t k = 0; k < b->rows * b->width; k += FUM_LANES) {
    const fum_vf x = fum_vf_load(columns + k % b->width) + ((float)b->x - f->column);
    const fum_vf y = rows + ((float)(b->y + k / b->width) - f->row);
    const fum_vf grown = (2.0F * (f->u * x + f->v * y) + cell * (x * x + y * y)) * (cell * f->squared_cosine);
    const fum_vf flat = f->across * x * x + f->both * x * y + f->up * y * y;
    const fum_vf gauss = f->optical_depth * fum_vf_exp2(flat * (1.0F - grown * (1.0F - grown * (1.0F - grown))));
    const fum_vf edge = find_edge(p, f, b, fum_vf_load(columns + k % b->width));
    fum_vf_store(cells + k, fum_vf_select(gauss >= edge, gauss, fum_vf_set(0.0F)));
  }
}

static void find_deposit(const patch *p, const footprint *f, deposit *d) {
  const float reach = f->reach * p->job->level->cell, lean = fabsf(f->u) + fabsf(f->v) + reach;
  d->is_empty = !find_box(p, f, &d->box);
  if (d->is_empty) return;
  find_line(p, f, d->line);
  (p->job->view->is_parallel || lean * reach < FLAT ? find_flat_cells : find_cells)(p, f, &d->box, d->cells);
}

/* Cells in a row that are added to together: which of them are within reach isn't asked, as that can't be foretold. */
enum { AT_ONCE = 4 };

static bool is_touched(const float *cells) {
  uint64_t pairs[2];
  memcpy(pairs, cells, sizeof pairs);
  return (pairs[0] | pairs[1]) != 0;
}

static void add_deposit(const patch *p, const deposit *d) {
  const box *b = &d->box;
  fum_vf shares[FACES / FUM_LANES];
  if (d->is_empty) return;
  for (int32_t k = 0; k < FACES / FUM_LANES; k++)
    shares[k] = fum_vf_load(d->line + k * FUM_LANES);
  for (int32_t y = 0; y < b->rows; y++) {
    float *at = p->lines + ((int64_t)(b->y + y) * p->columns + b->x) * FACES;
    const float *row = d->cells + y * b->width;
    for (int32_t x = 0; x < b->width; x += AT_ONCE) {
      if (!is_touched(row + x)) continue;
      for (int32_t i = x; i < x + AT_ONCE; i++) {
        for (int32_t k = 0; k < FACES / FUM_LANES; k++)
          fum_vf_store(at + i * FACES + k * FUM_LANES,
                       fum_vf_load(at + i * FACES + k * FUM_LANES) + row[i] * shares[k]);
      }
    }
  }
}

/* Adds casters `from` to `to` of the order. While one is added the next is found: neither waits for the other. */
static void add_casters(const patch *p, const footprint *footprints, const uint32_t *order, uint32_t from,
                        uint32_t to) {
  deposit deposits[2];
  for (uint32_t k = from; k < to; k++) {
    __builtin_prefetch(&footprints[order[k + AHEAD]]);
    find_deposit(p, &footprints[order[k]], &deposits[k % 2]);
    if (k > from) add_deposit(p, &deposits[(k - 1) % 2]);
  }
  if (to > from) add_deposit(p, &deposits[(to - 1) % 2]);
}

#include "lighting/sweep_read.h"

/* Things to be done at slabs, in the order of these. */
typedef struct agenda {
  int32_t *slabs;   /* [count] */
  uint32_t *begins; /* [slab_count + 1] */
  uint32_t *order;  /* [count] */
} agenda;

/* Counting sort. */
static void sort_agenda(int64_t count, int32_t slab_count, agenda *a) {
  memset(a->begins, 0, ((size_t)slab_count + 1) * sizeof *a->begins);
  for (int64_t i = 0; i < count; i++)
    a->begins[a->slabs[i] + 1]++;
  for (int32_t k = 0; k < slab_count; k++)
    a->begins[k + 1] += a->begins[k];
  for (int64_t i = 0; i < count; i++)
    a->order[a->begins[a->slabs[i]]++] = (uint32_t)i;
  for (int32_t k = slab_count; k > 0; k--)
    a->begins[k] = a->begins[k - 1];
  a->begins[0] = 0;
  memset(a->order + count, 0, AHEAD * sizeof *a->order);
}

/* Opens BATCH faces more, behind all casters so far, in the place of the first ones. */
static void advance(patch *p) {
  const int32_t last = (p->open - 1) & (FACES - 1), first = p->open & (FACES - 1);
  const int64_t size = (int64_t)p->rows * p->columns * FACES;
  for (int64_t i = 0; i < size; i += FACES) {
    for (int32_t k = 0; k < BATCH; k++)
      p->lines[i + first + k] = p->lines[i + last];
  }
  p->open += BATCH;
}

/* From the light outwards: casters are added at the first slab that they reach into; receivers are read as soon as the
 * two faces behind them are known, while the one before is still open. */
static void sweep_patch(patch *p, const footprint *footprints, const agenda *casters, const spot *spots,
                        const agenda *receivers, const uint32_t *indices) {
  const int32_t end = p->job->level->slab_count;
  uint32_t added = 0, read = 0;
  for (int32_t slab = 0; slab < end; slab += BATCH) {
    add_casters(p, footprints, casters->order, added, casters->begins[slab + BATCH]);
    added = casters->begins[slab + BATCH];
    for (; read < receivers->begins[slab + BATCH]; read++) {
      __builtin_prefetch(&spots[receivers->order[read + AHEAD]]);
      const uint32_t i = receivers->order[read];
      const float depth = read_depth(p, &spots[i]);
      p->job->depths[indices[i]] += depth > 0.0F ? depth : 0.0F;
    }
    if (added > 0) {
      advance(p);
    } else {
      p->open += BATCH;
    }
  }
}

/* Points of all leaves of a list. */
static int64_t count_points(const fum_octree *octree, const uint32_t *leaves, int64_t leaf_count) {
  int64_t count = 0;
  for (int64_t k = 0; k < leaf_count; k++)
    count += octree->nodes[leaves[k]].count;
  return count;
}

static int64_t take_casters(const patch *p, const uint32_t *leaves, int64_t leaf_count, footprint *out) {
  int64_t found = 0;
  for (int64_t k = 0; k < leaf_count; k++) {
    const fum_octree_node *leaf = &p->job->casters->nodes[leaves[k]];
    for (int64_t i = 0; i < leaf->count; i += FUM_LANES)
      found += find_footprints(p, leaf->begin + i, leaf->count - i, out + found);
  }
  return found;
}

static int64_t take_receivers(const patch *p, const uint32_t *leaves, int64_t leaf_count, spot *out,
                              uint32_t *out_indices) {
  int64_t found = 0;
  for (int64_t k = 0; k < leaf_count; k++) {
    const fum_octree_node *leaf = &p->job->points->nodes[leaves[k]];
    for (int64_t i = 0; i < leaf->count; i += FUM_LANES)
      found += find_spots(p, leaf->begin + i, leaf->count - i, out + found, out_indices + found);
  }
  return found;
}

/* Room for as many; what isn't given yet is given by the first who asks. */
static agenda reserve_agenda(fum_sweep_scratch *s, fum_sweep_buffer first, int64_t count, int32_t slab_count) {
  return (agenda){reserve(s, first, count * (int64_t)sizeof(int32_t)),
                  reserve(s, first + 1, (slab_count + 1) * (int64_t)sizeof(uint32_t)),
                  reserve(s, first + 2, (count + AHEAD) * (int64_t)sizeof(uint32_t))};
}

void FUM_SWEEP_NAME(const fum_sweep_job *job, int64_t index, fum_sweep_scratch *scratch) {
  const fum_sweep_patches *lists = job->patches;
  const uint32_t *caster_leaves = lists->casters + lists->caster_begins[index];
  const uint32_t *receiver_leaves = lists->receivers + lists->receiver_begins[index];
  const int64_t caster_leaf_count = lists->caster_begins[index + 1] - lists->caster_begins[index];
  const int64_t receiver_leaf_count = lists->receiver_begins[index + 1] - lists->receiver_begins[index];
  const int32_t slab_count = job->level->slab_count;
  if (caster_leaf_count == 0 || receiver_leaf_count == 0) return;
  patch p = {.job = job};
  lay_patch(&p, index);
  const int64_t most_receivers = count_points(job->points, receiver_leaves, receiver_leaf_count);
  spot *spots = reserve(scratch, FUM_SWEEP_SPOTS, most_receivers * (int64_t)sizeof *spots);
  uint32_t *indices = reserve(scratch, FUM_SWEEP_RECEIVERS, most_receivers * (int64_t)sizeof *indices);
  if (scratch->is_out_of_memory) return;
  const int64_t receivers = take_receivers(&p, receiver_leaves, receiver_leaf_count, spots, indices);
  if (receivers == 0) return;
  const int64_t most_casters = count_points(job->casters, caster_leaves, caster_leaf_count);
  footprint *footprints = reserve(scratch, FUM_SWEEP_FOOTPRINTS, most_casters * (int64_t)sizeof *footprints);
  if (scratch->is_out_of_memory) return;
  const int64_t casters = take_casters(&p, caster_leaves, caster_leaf_count, footprints);
  if (casters == 0) return;
  /* Boxes may run over the ends of rows, where they are 0. */
  const int64_t bytes = ((int64_t)p.rows * p.columns + MOST_COLUMNS) * FACES * (int64_t)sizeof(float);
  p.lines = reserve(scratch, FUM_SWEEP_LINES, bytes);
  p.open = -BATCH;
  agenda to_add = reserve_agenda(scratch, FUM_SWEEP_CASTER_SLABS, casters, slab_count);
  agenda to_read = reserve_agenda(scratch, FUM_SWEEP_RECEIVER_SLABS, receivers, slab_count);
  if (scratch->is_out_of_memory) return;
  for (int64_t k = 0; k < casters; k++)
    to_add.slabs[k] = footprints[k].first;
  for (int64_t k = 0; k < receivers; k++)
    to_read.slabs[k] = (int32_t)spots[k].range + 1;
  sort_agenda(casters, slab_count, &to_add);
  sort_agenda(receivers, slab_count, &to_read);
  memset(p.lines, 0, (size_t)bytes);
  sweep_patch(&p, footprints, &to_add, spots, &to_read, indices);
}
