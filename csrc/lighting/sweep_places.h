/* SPDX-License-Identifier: GPL-3.0-or-later */
/* Places of casters and receivers in a patch of the sweep; a part of sweep_loop.h. */

/* Where points are in the patch, as many as are worked on at once. */
typedef struct places {
  fum_vf u, v, depth, range; /* window; depth along the axis; range in slabs */
  fum_vf slabs_per_metre;
} places;

static inline fum_vf dot(fum_vf x, fum_vf y, fum_vf z, fum_vec3 axis) {
  return x * axis.x + y * axis.y + z * axis.z;
}

/* FUM_LANES points of an octree from `first` on, relative to the middle of the view. */
typedef struct points {
  fum_vf x, y, z;
} points;

static inline points load_points(const fum_sweep_view *view, const fum_octree *octree, int64_t first) {
  return (points){fum_vf_load(octree->x + first) - view->middle.x, fum_vf_load(octree->y + first) - view->middle.y,
                  fum_vf_load(octree->z + first) - view->middle.z};
}

static inline places find_places(const patch *p, const points *q) {
  const fum_sweep_view *view = p->job->view;
  const fum_sweep_level *level = p->job->level;
  const fum_vf qx = q->x, qy = q->y, qz = q->z;
  const fum_vf x = dot(qx, qy, qz, p->right) + p->offset[0], y = dot(qx, qy, qz, p->up) + p->offset[1];
  const fum_vf along = dot(qx, qy, qz, p->axis), z = along + p->offset[2];
  const float per_slab = 1.0F / level->slab;
  if (view->is_parallel)
    return (places){x, y, fum_vf_set(1.0F), (along - level->first) * per_slab, fum_vf_set(per_slab)};
  const float reference = (float)view->reference;
  /* length^2 - reference^2 without a difference of large numbers */
  const fum_vf beyond = p->job->beyond + 2.0F * dot(qx, qy, qz, p->job->to_middle) + qx * qx + qy * qy + qz * qz;
  const fum_vf sum = fum_vf_sqrt(x * x + y * y + z * z) + reference, inverse = 1.0F / (sum * sum);
  const fum_vf share = beyond * inverse, squared = share * share;
  const fum_vf range = 2.0F * share * (1.0F + squared * (0.33333333F + squared * (0.2F + squared * 0.14285714F)));
  const fum_vf slope = 4.0F * reference * inverse * (1.0F + squared * (1.0F + squared * (1.0F + squared)));
  const fum_vf per_depth = 1.0F / z;
  return (places){x * per_depth, y * per_depth, z, (range - level->first) * per_slab, slope * per_slab};
}

/* Bits of the first `count` entries. */
static inline uint32_t bits_below(int64_t count) {
  return count < FUM_LANES ? (UINT32_C(1) << count) - 1 : UINT32_MAX >> (32 - FUM_LANES);
}

/* Grids are read with cubic B-splines, whose own variance is a third of a step: casters are put in narrower by as much,
 * and so are exact to fourth order, at a step as large as sigma. */
static const float SPLINE_VARIANCE = 0.33333333F, LEAST_VARIANCE = 0.2F;

/* Vectors, one for each caster. */
typedef struct ways {
  fum_vf x, y, z;
} ways;

static inline ways combine(fum_vec3 a, fum_vf times, fum_vec3 b) {
  return (ways){a.x + times * b.x, a.y + times * b.y, a.z + times * b.z};
}

/* What casters' stretches make of their covariance between two directions; 0 if they are round. */
static inline fum_vf stretch_between(const fum_octree *casters, int64_t first, const ways *a, const ways *b) {
  if (casters->stretches == NULL) return fum_vf_set(0.0F);
  fum_vf s[FUM_STRETCHES];
  for (int k = 0; k < FUM_STRETCHES; k++)
    s[k] = fum_vf_load(casters->stretches + k * (casters->count + FUM_OCTREE_PAD) + first);
  const fum_vf x = s[0] * a->x + s[2] * a->y + s[3] * a->z, y = s[2] * a->x + s[1] * a->y + s[4] * a->z;
  const fum_vf z = s[3] * a->x + s[4] * a->y - (s[0] + s[1]) * a->z;
  return x * b->x + y * b->y + z * b->z;
}

/* Covariance of casters: mean and half the difference of columns and rows, between them, in cells^2, and along the ray
 * in m^2. */
typedef struct seen {
  fum_vf mean, difference, between, along;
} seen;

/* A place moves in the window by what moves across the axis less what moves along it times the tangent. */
static seen find_seen(const patch *p, int64_t first, fum_vf variance, fum_vf u, fum_vf v, fum_vf per_cell) {
  const fum_octree *casters = p->job->casters;
  const ways across = combine(p->right, -u, p->axis), up = combine(p->up, -v, p->axis);
  const ways along = {u * p->right.x + v * p->up.x + p->axis.x, u * p->right.y + v * p->up.y + p->axis.y,
                      u * p->right.z + v * p->up.z + p->axis.z};
  const fum_vf columns = variance * (1.0F + u * u) + stretch_between(casters, first, &across, &across);
  const fum_vf rows = variance * (1.0F + v * v) + stretch_between(casters, first, &up, &up);
  const fum_vf between = variance * u * v + stretch_between(casters, first, &across, &up);
  const fum_vf scale = per_cell * per_cell;
  return (seen){.mean = 0.5F * (columns + rows) * scale,
                .difference = 0.5F * (columns - rows) * scale,
                .between = between * scale,
                .along = variance + stretch_between(casters, first, &along, &along) / (1.0F + u * u + v * v)};
}

/* Takes the spline's variance off, as long as enough is left in all directions. Returns half the difference between the
 * widest and the narrowest. */
static fum_vf narrow(seen *s) {
  const fum_vf half = fum_vf_sqrt(s->difference * s->difference + s->between * s->between);
  s->mean = fum_vf_at_least(s->mean - SPLINE_VARIANCE, LEAST_VARIANCE);
  const fum_vf most = s->mean - LEAST_VARIANCE;
  const fum_vf share = fum_vf_select(half > most, most / half, fum_vf_set(1.0F));
  s->difference *= share;
  s->between *= share;
  return half * share;
}

/* Casters of the level among `count` from `first` on that reach into the patch, FUM_LANES at most. Returns how many. */
static int32_t find_footprints(const patch *p, int64_t first, int64_t count, footprint *out) {
  const fum_octree *casters = p->job->casters;
  const fum_sweep_level *level = p->job->level;
  const fum_vf tangents = fum_vf_load(p->job->view->sigmas + first);
  const fum_vi is_of_level = (tangents > 0.0F) & (tangents >= level->smallest) & (tangents < level->largest);
  uint32_t taken = fum_vi_bits(is_of_level) & bits_below(count);
  if (taken == 0) return 0;
  const float cell = p->job->level->cell;
  const bool is_parallel = p->job->view->is_parallel;
  const points q = load_points(p->job->view, casters, first);
  const places at = find_places(p, &q);
  const fum_vf sigma = p->job->sigma_scale / fum_vf_load(casters->inverse_sigmas + first), variance = sigma * sigma;
  const fum_vf one = fum_vf_set(1.0F), zero = fum_vf_set(0.0F), nowhere = fum_vf_set(-8.0F);
  const fum_vf u = is_parallel ? zero : at.u, v = is_parallel ? zero : at.v;
  const fum_vf squared = 1.0F / (1.0F + u * u + v * v), cosine = fum_vf_sqrt(squared);
  const fum_vf per_cell = 1.0F / (cell * at.depth);
  seen s = find_seen(p, first, variance, u, v, per_cell);
  const fum_vf half = narrow(&s), area = s.mean * s.mean - half * half, per_area = 1.0F / area;
  const fum_vf along = s.along * at.slabs_per_metre * at.slabs_per_metre;
  const fum_vf narrow_along = fum_vf_sqrt(fum_vf_at_least(along - SPLINE_VARIANCE, LEAST_VARIANCE));
  /* Rays that pass at a distance d come nearest to the centre d^2 / (2 distance) before it. */
  const fum_vf bend = variance * at.slabs_per_metre * cosine / at.depth;
  /* In the window's areas: what is put in narrower is thicker. */
  const fum_vf per_narrow = per_cell * per_cell / (fum_vf_sqrt(area) * cosine);
  const fum_vf optical_depth =
      fum_vf_load(casters->optical_depths + first) * p->job->depth_scale * variance * per_narrow;
  const fum_vf reach = FUM_SWEEP_SPREAD * narrow_along;
  /* A caster far beside the patch has no place on its plane, nor anything to give to it. */
  const fum_vi is_before = (at.depth > 0.0F) & (squared > 0.06F);
  const fum_vf range = is_parallel ? at.range : fum_vf_select(is_before, at.range - bend, at.range);
  const fum_vf column = fum_vf_select(is_before, (at.u - p->lower[0]) / cell, nowhere);
  const fum_vf row = fum_vf_select(is_before, (at.v - p->lower[1]) / cell, nowhere);
  const fum_vf across = fum_vf_select(is_before, p->job->view->reach * fum_vf_sqrt(s.mean + half), one);
  const fum_vf values[] = {column,
                           row,
                           -FUM_HALF_LOG2_E * (s.mean - s.difference) * per_area,
                           -FUM_HALF_LOG2_E * (s.mean + s.difference) * per_area,
                           2.0F * FUM_HALF_LOG2_E * s.between * per_area,
                           optical_depth,
                           across,
                           range,
                           1.0F / narrow_along,
                           fum_vf_at_least(range - reach, 0.0F),
                           range + reach};
  taken &= fum_vi_bits((column + across >= 0.0F) & (column - across <= (float)(p->columns - 1)) &
                       (row + across >= 0.0F) & (row - across <= (float)(p->rows - 1)));
  int32_t found = 0;
  for (; taken != 0; taken &= taken - 1) {
    const int k = __builtin_ctz(taken);
    footprint *f = &out[found++];
    *f = (footprint){values[0][k], values[1][k],          values[2][k],          values[3][k],
                     values[4][k], values[5][k],          values[6][k],          values[7][k],
                     values[8][k], (int32_t)values[9][k], (int32_t)values[10][k]};
    f->last = f->last < f->first + MOST_SPAN ? f->last : f->first + MOST_SPAN - 1;
  }
  return found;
}

/* Entries whose face is the one whose axis is nearest to them. */
static inline fum_vi are_on_face(const patch *p, const points *q) {
  const fum_vec3 o = p->job->to_middle;
  const fum_vf x = q->x + o.x, y = q->y + o.y, z = q->z + o.z;
  const fum_vf ax = fum_vf_abs(x), ay = fum_vf_abs(y), az = fum_vf_abs(z);
  const fum_vi on_x = (ax >= ay) & (ax >= az), on_y = ~on_x & (ay >= az), on_z = ~(on_x | on_y);
  const fum_vi is_behind = p->face / 2 == 0 ? x < 0.0F : p->face / 2 == 1 ? y < 0.0F : z < 0.0F;
  return (p->face / 2 == 0 ? on_x : p->face / 2 == 1 ? on_y : on_z) & (p->face % 2 == 1 ? is_behind : ~is_behind);
}

/* Entries of which the patch is the one that they are in along one side of the face. */
static inline fum_vi are_in_patch(const patch *p, int axis, fum_vf at) {
  const fum_sweep_face *face = &p->job->view->faces[p->face];
  const int32_t count = axis == 0 ? face->columns : face->rows, place = p->place[axis];
  const fum_vf patches = (at - face->lower[axis]) * ((float)count / (face->upper[axis] - face->lower[axis]));
  const fum_vi is_behind = patches >= (float)place, is_before = patches < (float)(place + 1);
  return (at >= face->lower[axis]) & (at <= face->upper[axis]) & (place == 0 ? ~(fum_vi){0} : is_behind) &
         (place == count - 1 ? ~(fum_vi){0} : is_before);
}

/* Bits of those among `count` that are lit, FUM_LANES at most. */
static uint32_t find_lit(const uint8_t *is_lit, int64_t count) {
  static const uint8_t all[16] = {1, 1, 1, 1, 1, 1, 1, 1, 1, 1, 1, 1, 1, 1, 1, 1};
  if (count >= FUM_LANES && memcmp(is_lit, all, FUM_LANES) == 0) return bits_below(FUM_LANES);
  uint32_t bits = 0;
  for (int32_t k = 0; k < FUM_LANES && k < count; k++)
    bits |= (uint32_t)(is_lit[k] != 0) << k;
  return bits;
}

static const int32_t LANE_NUMBERS[16] = {0, 1, 2, 3, 4, 5, 6, 7, 8, 9, 10, 11, 12, 13, 14, 15};

/* Bits of those among points that are in the patch. Whatever patch asks, the same is found: each is in one. */
static uint32_t find_here(const patch *p, const points *at) {
  const fum_sweep_view *view = p->job->view;
  const fum_sweep_face *face = &view->faces[p->face];
  const fum_vf x = dot(at->x, at->y, at->z, face->right) + face->offset[0];
  const fum_vf y = dot(at->x, at->y, at->z, face->up) + face->offset[1];
  const fum_vf z = dot(at->x, at->y, at->z, face->axis) + face->offset[2];
  const fum_vf per_depth = view->is_parallel ? fum_vf_set(1.0F) : 1.0F / z;
  fum_vi is_here = are_in_patch(p, 0, x * per_depth) & are_in_patch(p, 1, y * per_depth) & (per_depth > 0.0F);
  if (view->face_count > 1) is_here &= are_on_face(p, at);
  if (!view->is_parallel) is_here &= x * x + y * y + z * z >= (float)(p->job->level->begin * p->job->level->begin);
  return fum_vi_bits(is_here);
}

/* Queues the lit receivers among `count` from `first` on that are in the patch (`is_whole`: all are), FUM_LANES at
 * most. */
static void queue_points(const patch *p, int64_t first, int64_t count, bool is_whole, queue *q) {
  const points at = load_points(p->job->view, p->job->points, first);
  const uint32_t taken = find_lit(p->job->is_lit + first, count) & (is_whole ? UINT32_MAX : find_here(p, &at));
  if (taken == 0) return;
  const float per_cell = 1.0F / p->job->level->cell, last = (float)(p->job->level->slab_count - 2);
  const places found = find_places(p, &at);
  const fum_vf column = (found.u - p->lower[0]) * per_cell, row = (found.v - p->lower[1]) * per_cell;
  const fum_vf range = fum_vf_min(fum_vf_at_least(found.range, 1.0F), fum_vf_set(last));
  const fum_vu index = (fum_vu)fum_vi_load(LANE_NUMBERS) + (uint32_t)first;
  /* A receiver is read at the turn of the slab behind its own: the two faces behind it are known then. */
  const fum_vi batch = (__builtin_convertvector(range, fum_vi) + 1) / BATCH;
  int32_t batches[FUM_LANES];
  memcpy(batches, &batch, sizeof batches);
  for (uint32_t left = taken; left != 0;) {
    const int32_t own = batches[__builtin_ctz(left)];
    const uint32_t alike = fum_vi_bits(batch == own) & left;
    join_queue(q, own, alike, column, row, range, index);
    left &= ~alike;
  }
}

/* Slabs for which receivers are queued at once: the more, the more neighbours in memory follow on each other. */
enum { QUEUED = 8 * BATCH };

/* The first of the slabs among which there is the one at whose turn receivers of a node may be read, or the one before,
 * as places are rounded. */
static int32_t find_turn(const patch *p, const fum_octree_node *node) {
  const fum_sweep_view *view = p->job->view;
  const fum_sweep_level *level = p->job->level;
  const fum_vec3 from = fum_sub(fum_sweep_middle(node), view->middle);
  const float radius = fum_sweep_radius(node), last = (float)(level->slab_count - 1);
  float range = fum_dot(from, p->axis) - radius;
  if (!view->is_parallel) {
    const float distance = fum_length(fum_mad(from, 1.0F, p->job->to_middle)) - radius;
    if (!(distance > 0.0F)) return 0;
    range = (float)fum_sweep_range(view, (double)distance);
  }
  const float turn = (range - level->first) / level->slab;
  return turn > 0.0F ? (int32_t)(turn < last ? turn : last) / QUEUED * QUEUED : 0;
}
