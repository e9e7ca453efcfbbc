/* SPDX-License-Identifier: GPL-3.0-or-later */
/* The loops of sweep.h for one patch, to be compiled once for each instruction set: sweep_*.c define FUM_LANES and
 * FUM_SWEEP_NAME. */
#include "base/simd.h"
#include "lighting/sweep.h"

#include <math.h>
#include <stdlib.h>

/* Columns are written sixteen at once, whatever the instruction set: every set must write the same cells. */
enum { BLOCK = 16, MOST_ROWS = 20, MOST_FACES = 32, KEPT = 4, FACE_BUFFERS = KEPT + 1 };

/* A caster in its patch. */
typedef struct footprint {
  float column, row;          /* of its centre, in cells */
  float u, v;                 /* the same in the patch's window */
  float falloff;              /* log2 of its Gaussian: -falloff d^2, d in tangents or m across the ray */
  float optical_depth;        /* at its centre, widened cells undone */
  float reach;                /* in cells */
  float range, inverse_sigma; /* in slabs; of what is left when cells are undone */
  int32_t first, last;        /* slabs that it reaches into */
} footprint;

typedef struct patch {
  const fum_sweep_job *job;
  fum_vec3 right, up, axis;
  float offset[3];
  float lower[2]; /* window of grid line 0 */
  int32_t columns, rows, stride;
  int64_t size;       /* floats of a grid */
  float *slabs;       /* [MOST_FACES][size] what casters add to slab s, at s % MOST_FACES; 0 where there is nothing */
  float *faces[KEPT]; /* optical depth in front of face f, at f % KEPT */
  float *buffers;     /* [FACE_BUFFERS][size] where those are */
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

/* Room for `bytes`, zeroed when it is new. */
static void *reserve(fum_sweep_scratch *s, fum_sweep_buffer which, int64_t bytes) {
  if (bytes > s->sizes[which]) {
    const size_t size = ((size_t)bytes + 63) / 64 * 64;
    free(s->buffers[which]);
    s->buffers[which] = aligned_alloc(64, size);
    s->sizes[which] = s->buffers[which] != NULL ? (int64_t)size : 0;
    if (s->buffers[which] != NULL) memset(s->buffers[which], 0, size);
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
  const float sides[2] = {(face->upper[0] - face->lower[0]) / (float)face->columns,
                          (face->upper[1] - face->lower[1]) / (float)face->rows};
  float ends[4], lower[2] = {INFINITY, INFINITY}, upper[2] = {-INFINITY, -INFINITY};
  for (int k = 0; k < 4; k++) {
    const int64_t n = k < 2 ? place % face->columns : place / face->columns;
    ends[k] = face->lower[k / 2] + sides[k / 2] * (float)(n + k % 2);
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
  p->stride = (p->columns + 2 * BLOCK - 1) / BLOCK * BLOCK;
  p->size = (int64_t)p->stride * p->rows;
}

/* Where a point is in the patch: window and range. */
typedef struct place {
  float u, v, depth, range; /* depth: along the axis; range in slabs */
  float slabs_per_metre;
} place;

static place find_place(const patch *p, const fum_octree *points, uint32_t i) {
  const fum_sweep_view *view = p->job->view;
  const fum_sweep_level *level = p->job->level;
  const fum_vec3 q = {points->x[i] - view->middle.x, points->y[i] - view->middle.y, points->z[i] - view->middle.z};
  const float x = fum_dot(q, p->right) + p->offset[0], y = fum_dot(q, p->up) + p->offset[1];
  const float along = fum_dot(q, p->axis), z = along + p->offset[2];
  if (view->is_parallel) return (place){x, y, 1.0F, (along - level->first) / level->slab, 1.0F / level->slab};
  const float reference = (float)view->reference, length = sqrtf(x * x + y * y + z * z);
  /* length^2 - reference^2 without a difference of large numbers */
  const float beyond = p->job->beyond +
                       2.0F * (q.x * p->job->to_middle.x + q.y * p->job->to_middle.y + q.z * p->job->to_middle.z) +
                       fum_dot(q, q);
  const float sum = length + reference, share = beyond / (sum * sum), squared = share * share;
  const float range = 2.0F * share * (1.0F + squared * (0.33333333F + squared * (0.2F + squared * 0.14285714F)));
  const float slope = 4.0F * reference / (sum * sum) * (1.0F + squared * (1.0F + squared * (1.0F + squared)));
  return (place){x / z, y / z, z, (range - level->first) / level->slab, slope / level->slab};
}

/* Grids are read with cubic B-splines, whose own variance is a third of a step: casters are put in narrower by as much,
 * and so are exact to fourth order, at a step as large as sigma. */
static const float SPLINE_VARIANCE = 0.33333333F, LEAST_VARIANCE = 0.2F;

static footprint find_footprint(const patch *p, uint32_t i) {
  const fum_octree *casters = p->job->casters;
  const fum_sweep_level *level = p->job->level;
  const bool is_parallel = p->job->view->is_parallel;
  const place at = find_place(p, casters, i);
  const float sigma = p->job->sigma_scale / casters->inverse_sigmas[i], variance = sigma * sigma;
  /* Squared cosine between the ray and the axis; how far apart grid lines are there, in m, averaged over directions. */
  const float squared = is_parallel ? 1.0F : 1.0F / (1.0F + at.u * at.u + at.v * at.v);
  const float step = level->cell * at.depth, spread = step * step * 0.5F * (1.0F + squared) * SPLINE_VARIANCE;
  const float left = variance - spread, least = LEAST_VARIANCE * step * step;
  const float narrow = left > least ? left : least;
  const float along = sigma * at.slabs_per_metre, along_left = along * along - SPLINE_VARIANCE;
  const float narrow_along = sqrtf(along_left > LEAST_VARIANCE ? along_left : LEAST_VARIANCE);
  /* Rays that pass at a distance d come nearest to the centre d^2 / (2 distance) before it. */
  const float bend = is_parallel ? 0.0F : variance * at.slabs_per_metre * sqrtf(squared) / at.depth;
  footprint f = {.column = (at.u - p->lower[0]) / level->cell,
                 .row = (at.v - p->lower[1]) / level->cell,
                 .u = at.u,
                 .v = at.v,
                 .falloff = 0.72134752F * at.depth * at.depth / narrow,
                 .optical_depth = casters->optical_depths[i] * p->job->depth_scale * (variance / narrow),
                 .reach = FUM_SWEEP_REACH * sqrtf(narrow / squared) / step,
                 .range = at.range - bend,
                 .inverse_sigma = 1.0F / narrow_along};
  f.optical_depth *= 1.00275F; /* for what lies beyond the reach, 1 / erf(3.2 / sqrt(2))^2 */
  const float reach = FUM_SWEEP_REACH * narrow_along;
  f.first = (int32_t)(f.range - reach);
  f.last = (int32_t)(f.range + reach);
  f.first = f.first < 0 ? 0 : f.first;
  f.last = f.last < f.first + MOST_FACES - 1 ? f.last : f.first + MOST_FACES - 1;
  return f;
}

/* Share of a caster in each of its slabs. */
static void find_shares(const footprint *f, float *shares) {
  static const float numbers[MOST_FACES] = {1,  2,  3,  4,  5,  6,  7,  8,  9,  10, 11, 12, 13, 14, 15, 16,
                                            17, 18, 19, 20, 21, 22, 23, 24, 25, 26, 27, 28, 29, 30, 31, 32};
  const int32_t count = f->last - f->first + 1;
  float up_to[MOST_FACES];
  for (int32_t k = 0; k < count; k += FUM_LANES) {
    const fum_vf z = (fum_vf_load(numbers + k) + ((float)f->first - f->range)) * f->inverse_sigma;
    const fum_vf tail = fum_vf_normal_tail(fum_vf_abs(z));
    fum_vf_store(up_to + k, fum_vf_select(z > 0.0F, 1.0F - tail, tail));
  }
  up_to[count - 1] = 1.0F;
  shares[0] = up_to[0];
  for (int32_t k = 1; k < count; k++)
    shares[k] = up_to[k] - up_to[k - 1];
}

static float *slab_grid(const patch *p, int32_t slab) {
  return p->slabs + slab % MOST_FACES * p->size;
}

/* Adds a caster to the slabs that it reaches into. */
static void deposit(const patch *p, const footprint *f) {
  static const float numbers[BLOCK] = {0, 1, 2, 3, 4, 5, 6, 7, 8, 9, 10, 11, 12, 13, 14, 15};
  const float cell = p->job->level->cell;
  const bool is_parallel = p->job->view->is_parallel;
  float gauss[MOST_ROWS * BLOCK], shares[MOST_FACES];
  int32_t y0 = (int32_t)ceilf(f->row - f->reach), y1 = (int32_t)floorf(f->row + f->reach);
  int32_t x0 = (int32_t)ceilf(f->column - f->reach), x1 = (int32_t)floorf(f->column + f->reach);
  y0 = y0 < 0 ? 0 : y0;
  y1 = y1 < p->rows ? y1 : p->rows - 1;
  y1 = y1 < y0 + MOST_ROWS ? y1 : y0 + MOST_ROWS - 1;
  x0 = x0 < 0 ? 0 : x0;
  if (y0 > y1 || x0 >= p->columns || x1 < 0) return;
  const float inverse = is_parallel ? 1.0F : 1.0F / (1.0F + f->u * f->u + f->v * f->v);
  for (int32_t y = y0; y <= y1; y++) {
    const float e2 = ((float)y - f->row) * cell;
    for (int32_t k = 0; k < BLOCK; k += FUM_LANES) {
      const fum_vf e1 = (fum_vf_load(numbers + k) + ((float)x0 - f->column)) * cell;
      fum_vf squared = e1 * e1 + e2 * e2;
      if (!is_parallel) { /* |centre x ray|^2 / |ray|^2 over depth^2; the quotient by its series around the centre */
        const fum_vf e3 = e2 * f->u - e1 * f->v;
        const fum_vf grown = (2.0F * (f->u * e1 + f->v * e2) + squared) * inverse;
        squared = (squared + e3 * e3) * (inverse * (1.0F - grown * (1.0F - grown * (1.0F - grown))));
      }
      fum_vf_store(gauss + (y - y0) * BLOCK + k, f->optical_depth * fum_vf_exp2(squared * -f->falloff));
    }
  }
  find_shares(f, shares);
  for (int32_t slab = f->first; slab <= f->last; slab++) {
    const float share = shares[slab - f->first];
    float *grid = slab_grid(p, slab) + (int64_t)y0 * p->stride + x0;
    for (int32_t y = 0; y <= y1 - y0; y++) {
      for (int32_t k = 0; k < BLOCK; k += FUM_LANES) {
        float *at = grid + (int64_t)y * p->stride + k;
        fum_vf_store(at, fum_vf_load(at) + share * fum_vf_load(gauss + y * BLOCK + k));
      }
    }
  }
}

static void spline(float t, float weights[4]) {
  const float s = 1.0F - t, sixth = 0.16666667F;
  weights[0] = s * s * s * sixth;
  weights[1] = (4.0F + t * t * (3.0F * t - 6.0F)) * sixth;
  weights[2] = (4.0F + s * s * (3.0F * s - 6.0F)) * sixth;
  weights[3] = t * t * t * sixth;
}

typedef float four __attribute__((vector_size(16)));

/* Optical depth in front of a receiver in slab `slab`: from the four faces around it, kept at face % KEPT. */
static float read_depth(const patch *p, const place *at, int32_t slab) {
  const float cell = p->job->level->cell, range = at->range - (float)slab;
  const float column = (at->u - p->lower[0]) / cell, row = (at->v - p->lower[1]) / cell;
  const int32_t x = (int32_t)column, y = (int32_t)row;
  float across[4], up[4], along[4];
  four sum = {0};
  if (x < 1 || y < 1 || x + 2 >= p->columns || y + 2 >= p->rows) return 0.0F;
  spline(column - (float)x, across);
  spline(row - (float)y, up);
  spline(range < 1.0F ? range : 1.0F, along);
  for (int32_t k = 0; k < 4; k++) {
    const float *grid = p->faces[(slab - 1 + k) % KEPT] + (int64_t)(y - 1) * p->stride + x - 1;
    for (int32_t r = 0; r < 4; r++) {
      four taps;
      memcpy(&taps, grid + (int64_t)r * p->stride, sizeof taps);
      sum += taps * (along[k] * up[r]);
    }
  }
  return sum[0] * across[0] + sum[1] * across[1] + sum[2] * across[2] + sum[3] * across[3];
}

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
}

static float *free_buffer(const patch *p) {
  for (int n = 0; n < FACE_BUFFERS; n++) {
    float *buffer = p->buffers + n * p->size;
    bool is_free = true;
    for (int k = 0; k < KEPT; k++)
      is_free = is_free && p->faces[k] != buffer;
    if (is_free) return buffer;
  }
  return p->buffers;
}

/* The face behind a slab: that before it and what the slab holds, which is cleared. */
static void advance(patch *p, int32_t slab, bool is_touched) {
  const float *before = p->faces[slab % KEPT];
  p->faces[(slab + 1) % KEPT] = p->faces[slab % KEPT];
  if (!is_touched) return;
  float *behind = free_buffer(p), *held = slab_grid(p, slab);
  for (int64_t i = 0; i < p->size; i += FUM_LANES)
    fum_vf_store(behind + i, fum_vf_load(before + i) + fum_vf_load(held + i));
  memset(held, 0, (size_t)p->size * sizeof *held);
  p->faces[(slab + 1) % KEPT] = behind;
}

/* From the light outwards: casters are added at the first slab that they reach into; receivers are read as soon as the
 * two faces behind them are known. */
static void sweep_patch(patch *p, const footprint *footprints, const agenda *casters, const place *places,
                        const agenda *receivers, const uint32_t *indices) {
  int32_t touched_end = 0;
  for (int32_t slab = 0; slab < p->job->level->slab_count; slab++) {
    for (uint32_t n = casters->begins[slab]; n < casters->begins[slab + 1]; n++) {
      const footprint *f = &footprints[casters->order[n]];
      deposit(p, f);
      touched_end = f->last + 1 > touched_end ? f->last + 1 : touched_end;
    }
    advance(p, slab, slab < touched_end);
    for (uint32_t n = receivers->begins[slab]; n < receivers->begins[slab + 1]; n++) {
      const uint32_t i = receivers->order[n];
      const float depth = read_depth(p, &places[i], slab - 1);
      p->job->depths[indices[i]] += depth > 0.0F ? depth : 0.0F;
    }
  }
}

void FUM_SWEEP_NAME(const fum_sweep_job *job, int64_t index, fum_sweep_scratch *scratch) {
  const fum_sweep_patches *lists = job->patches;
  const uint32_t *caster_list = lists->casters + lists->caster_begins[index];
  const uint32_t *receiver_list = lists->receivers + lists->receiver_begins[index];
  const int64_t casters = lists->caster_begins[index + 1] - lists->caster_begins[index];
  const int64_t receivers = lists->receiver_begins[index + 1] - lists->receiver_begins[index];
  const int32_t slab_count = job->level->slab_count;
  if (casters == 0 || receivers == 0) return;
  patch p = {.job = job};
  lay_patch(&p, index);
  const int64_t grid_bytes = p.size * (int64_t)sizeof(float),
                begins_bytes = (slab_count + 1) * (int64_t)sizeof(uint32_t);
  p.slabs = reserve(scratch, FUM_SWEEP_SLABS, MOST_FACES * grid_bytes);
  p.buffers = reserve(scratch, FUM_SWEEP_BUFFERS, FACE_BUFFERS * grid_bytes);
  footprint *footprints = reserve(scratch, FUM_SWEEP_FOOTPRINTS, casters * (int64_t)sizeof *footprints);
  place *places = reserve(scratch, FUM_SWEEP_PLACES, receivers * (int64_t)sizeof *places);
  agenda to_add = {reserve(scratch, FUM_SWEEP_CASTER_SLABS, casters * (int64_t)sizeof(int32_t)),
                   reserve(scratch, FUM_SWEEP_CASTER_BEGINS, begins_bytes),
                   reserve(scratch, FUM_SWEEP_CASTER_ORDER, casters * (int64_t)sizeof(uint32_t))};
  agenda to_read = {reserve(scratch, FUM_SWEEP_RECEIVER_SLABS, receivers * (int64_t)sizeof(int32_t)),
                    reserve(scratch, FUM_SWEEP_RECEIVER_BEGINS, begins_bytes),
                    reserve(scratch, FUM_SWEEP_RECEIVER_ORDER, receivers * (int64_t)sizeof(uint32_t))};
  if (scratch->is_out_of_memory) return;
  for (int64_t k = 0; k < casters; k++) {
    footprints[k] = find_footprint(&p, caster_list[k]);
    footprints[k].last = footprints[k].last < slab_count ? footprints[k].last : slab_count - 1;
    footprints[k].first = footprints[k].first < footprints[k].last ? footprints[k].first : footprints[k].last;
    to_add.slabs[k] = footprints[k].first;
  }
  for (int64_t k = 0; k < receivers; k++) {
    places[k] = find_place(&p, job->points, receiver_list[k]);
    const float range = places[k].range < 1.0F ? 1.0F : places[k].range;
    const float last = (float)(slab_count - 2);
    places[k].range = range < last ? range : last;
    to_read.slabs[k] = (int32_t)places[k].range + 1;
  }
  sort_agenda(casters, slab_count, &to_add);
  sort_agenda(receivers, slab_count, &to_read);
  memset(p.buffers, 0, (size_t)grid_bytes);
  for (int k = 0; k < KEPT; k++)
    p.faces[k] = p.buffers;
  sweep_patch(&p, footprints, &to_add, places, &to_read, receiver_list);
}
