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
  float across, up, both;     /* its Gaussian is 2^(across x^2 + up y^2 + both x y), in cells, on a flat plane */
  float optical_depth;        /* at its centre */
  float reach;                /* in cells */
  float range, inverse_sigma; /* in slabs */
  int32_t first, last;        /* slabs that it reaches into */
} footprint;

/* Cells of a patch: columns from `left` to before `right`, rows from `top` to before `bottom`. */
typedef struct area {
  int32_t left, top, right, bottom;
} area;

typedef struct patch {
  const fum_sweep_job *job;
  fum_vec3 right, up, axis;
  float offset[3];
  int32_t face, place[2]; /* of the view; column and row of the patch on it */
  float lower[2];         /* window of grid line 0 */
  int32_t columns, rows;
  float *lines; /* [rows][columns][FACES] optical depth in front of faces */
  float *faces; /* [BATCH][rows][columns][TAPS] of those that the receivers of each slab are read from */
  area shaded;  /* cells that anything was added to */
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

#include "lighting/sweep_queue.h"

#include "lighting/sweep_places.h"

static const float NUMBERS[MOST_COLUMNS] = {0,  1,  2,  3,  4,  5,  6,  7,  8,  9,  10, 11, 12, 13, 14, 15,
                                            16, 17, 18, 19, 20, 21, 22, 23, 24, 25, 26, 27, 28, 29, 30, 31};

static int32_t at_least(float value, int32_t least) {
  return value > (float)least ? (int32_t)ceilf(value) : least;
}

static int32_t at_most(float value, int32_t most) {
  return value < (float)most ? (int32_t)floorf(value) : most;
}

#include "lighting/sweep_deposit.h"
#include "lighting/sweep_read.h"

/* Counting sorts by slabs: turns the numbers of slab k, at k + 2, into where it begins, at k + 1. There its end is
 * after each was put down, which is where slab k + 1 begins. */
static void begin_slabs(int32_t slab_count, uint32_t *begins) {
  for (int32_t k = 2; k < slab_count + 2; k++)
    begins[k] += begins[k - 1];
}

/* The order of casters by the first slabs that they reach into. */
static void sort_casters(int64_t count, const footprint *footprints, int32_t slab_count, uint32_t *begins,
                         uint32_t *order) {
  memset(begins, 0, ((size_t)slab_count + 2) * sizeof *begins);
  for (int64_t i = 0; i < count; i++)
    begins[footprints[i].first + 2]++;
  begin_slabs(slab_count, begins);
  for (int64_t i = 0; i < count; i++)
    order[begins[footprints[i].first + 1]++] = (uint32_t)i;
  memset(order + count, 0, AHEAD * sizeof *order);
}

/* The node of an entry of a patch's list. */
static const fum_octree_node *node_of(const fum_octree *octree, uint32_t entry) {
  return &octree->nodes[entry & ~FUM_SWEEP_WHOLE];
}

/* The order of nodes by the turns of their first receivers. */
static void sort_nodes(const patch *p, int64_t count, const uint32_t *nodes, uint32_t *begins, uint32_t *order) {
  const int32_t slab_count = p->job->level->slab_count;
  memset(begins, 0, ((size_t)slab_count + 2) * sizeof *begins);
  for (int64_t i = 0; i < count; i++)
    begins[find_turn(p, node_of(p->job->points, nodes[i])) + 2]++;
  begin_slabs(slab_count, begins);
  for (int64_t i = 0; i < count; i++)
    order[begins[find_turn(p, node_of(p->job->points, nodes[i])) + 1]++] = nodes[i];
}

/* Opens BATCH faces more, behind all casters so far, in the place of the first ones. */
static void advance(patch *p) {
  const int32_t last = (p->open - 1) & (FACES - 1), first = p->open & (FACES - 1);
  const area a = p->shaded;
  for (int32_t y = a.top; y < a.bottom; y++) {
    float *row = p->lines + (int64_t)y * p->columns * FACES;
    for (int32_t x = a.left; x < a.right; x++) {
      for (int32_t k = 0; k < BATCH; k++)
        row[FACES * x + first + k] = row[FACES * x + last];
    }
  }
  p->open += BATCH;
}

/* Points of nodes that lie one after the other in memory. */
typedef struct stretch {
  int64_t begin, end;
  bool is_whole; /* all in the patch */
} stretch;

/* The stretch from entry `*next` of a list on; moves that behind it. */
static stretch take_stretch(const fum_octree *octree, const uint32_t *entries, int64_t count, int64_t *next) {
  const uint32_t whole = entries[*next] & FUM_SWEEP_WHOLE;
  const fum_octree_node *node = node_of(octree, entries[(*next)++]);
  stretch s = {node->begin, (int64_t)node->begin + node->count, whole != 0};
  while (*next < count && (entries[*next] & FUM_SWEEP_WHOLE) == whole &&
         node_of(octree, entries[*next])->begin == s.end)
    s.end += node_of(octree, entries[(*next)++])->count;
  return s;
}

static void queue_receivers(const patch *p, const uint32_t *nodes, int64_t count, queue *q) {
  for (int64_t next = 0; next < count;) {
    const stretch s = take_stretch(p->job->points, nodes, count, &next);
    for (int64_t i = s.begin; i < s.end; i += FUM_LANES)
      queue_points(p, i, s.end - i, s.is_whole, q);
  }
}

static void read_receivers(const patch *p, const queue *q, int32_t batch) {
  take_faces(p, batch, find_area(p, q->last[batch]));
  for (const chunk *c = q->last[batch]; c != NULL; c = c->before) {
    for (int32_t k = 0; k < c->count; k += FUM_LANES)
      read_depths(p, c, k);
  }
}

/* What is in a patch, in the order of slabs: slab k's from begins[k] to begins[k + 1]. */
typedef struct contents {
  const footprint *footprints;
  const uint32_t *casters, *caster_begins; /* their order */
  const uint32_t *nodes, *node_begins;     /* of receivers */
  uint32_t node_count;
} contents;

/* From the light outwards, as long as there are receivers: casters are added at the first slab that they reach into;
 * receivers are read while the face before the one before them is still open. */
static void sweep_patch(patch *p, const contents *c, queue *q) {
  const int32_t end = p->job->level->slab_count;
  uint32_t added = 0, queued = 0;
  for (int32_t slab = 0; slab < end && (queued < c->node_count || q->waiting > 0); slab += BATCH) {
    const uint32_t next_added = c->caster_begins[slab + BATCH], next_queued = c->node_begins[slab + BATCH];
    queue_receivers(p, c->nodes + queued, next_queued - queued, q);
    add_casters(p, c->footprints, c->casters, added, next_added);
    added = next_added;
    queued = next_queued;
    if (added > 0 && q->last[slab / BATCH] != NULL) read_receivers(p, q, slab / BATCH);
    drop_queue(q, slab / BATCH);
    if (added > 0) {
      advance(p);
    } else {
      p->open += BATCH;
    }
  }
}

/* Points of all nodes of a list. */
static int64_t count_points(const fum_octree *octree, const uint32_t *entries, int64_t count) {
  int64_t points = 0;
  for (int64_t k = 0; k < count; k++)
    points += node_of(octree, entries[k])->count;
  return points;
}

static int64_t take_casters(const patch *p, const uint32_t *leaves, int64_t leaf_count, footprint *out) {
  int64_t found = 0;
  for (int64_t next = 0; next < leaf_count;) {
    const stretch s = take_stretch(p->job->casters, leaves, leaf_count, &next);
    for (int64_t i = s.begin; i < s.end; i += FUM_LANES)
      found += find_footprints(p, i, s.end - i, out + found);
  }
  return found;
}

void FUM_SWEEP_NAME(const fum_sweep_job *job, int64_t index, fum_sweep_scratch *scratch) {
  const fum_sweep_patches *lists = job->patches;
  const uint32_t *caster_leaves = lists->casters + lists->caster_begins[index];
  const uint32_t *receiver_nodes = lists->receivers + lists->receiver_begins[index];
  const int64_t caster_leaf_count = lists->caster_begins[index + 1] - lists->caster_begins[index];
  const int64_t receiver_node_count = lists->receiver_begins[index + 1] - lists->receiver_begins[index];
  const int32_t slab_count = job->level->slab_count;
  const int64_t begins = (slab_count + 2) * (int64_t)sizeof(uint32_t);
  if (caster_leaf_count == 0 || receiver_node_count == 0) return;
  patch p = {.job = job};
  lay_patch(&p, index);
  const int64_t most_casters = count_points(job->casters, caster_leaves, caster_leaf_count);
  footprint *footprints = reserve(scratch, FUM_SWEEP_FOOTPRINTS, most_casters * (int64_t)sizeof *footprints);
  if (scratch->is_out_of_memory) return;
  const int64_t casters = take_casters(&p, caster_leaves, caster_leaf_count, footprints);
  if (casters == 0) return;
  /* Boxes may run over the ends of rows, where they are 0. */
  const int64_t cells = (int64_t)p.rows * p.columns;
  const int64_t bytes = (cells + MOST_COLUMNS) * FACES * (int64_t)sizeof(float);
  p.lines = reserve(scratch, FUM_SWEEP_LINES, bytes);
  p.faces = reserve(scratch, FUM_SWEEP_TAPS, BATCH * faces_size(&p) * (int64_t)sizeof(float));
  p.shaded = (area){p.columns, p.rows, 0, 0};
  p.open = -BATCH;
  uint32_t *caster_begins = reserve(scratch, FUM_SWEEP_CASTER_BEGINS, begins);
  uint32_t *order = reserve(scratch, FUM_SWEEP_CASTER_ORDER, (casters + AHEAD) * (int64_t)sizeof *order);
  uint32_t *node_begins = reserve(scratch, FUM_SWEEP_NODE_BEGINS, begins);
  uint32_t *nodes = reserve(scratch, FUM_SWEEP_NODE_ORDER, receiver_node_count * (int64_t)sizeof *nodes);
  queue q;
  open_queue(scratch, count_points(job->points, receiver_nodes, receiver_node_count), slab_count, &q);
  if (scratch->is_out_of_memory) return;
  sort_casters(casters, footprints, slab_count, caster_begins, order);
  sort_nodes(&p, receiver_node_count, receiver_nodes, node_begins, nodes);
  memset(p.lines, 0, (size_t)bytes);
  const contents c = {footprints, order, caster_begins, nodes, node_begins, (uint32_t)receiver_node_count};
  sweep_patch(&p, &c, &q);
}
