/* SPDX-License-Identifier: GPL-3.0-or-later */
/* Places of casters and receivers in a patch of the sweep; a part of sweep_loop.h. */

/* Where points are in the patch, as many as are worked on at once. */
typedef struct places {
  fum_vf u, v, depth, range; /* window; depth along the axis; range in slabs */
  fum_vf slabs_per_metre;
} places;

/* Entries of an array at FUM_LANES indices. */
static inline fum_vf gather(const float *values, const uint32_t *indices) {
  fum_vf v;
  for (int lane = 0; lane < FUM_LANES; lane++)
    v[lane] = values[indices[lane]];
  return v;
}

static inline fum_vf dot(fum_vf x, fum_vf y, fum_vf z, fum_vec3 axis) {
  return x * axis.x + y * axis.y + z * axis.z;
}

static inline places find_places(const patch *p, const fum_octree *points, const uint32_t *indices) {
  const fum_sweep_view *view = p->job->view;
  const fum_sweep_level *level = p->job->level;
  const fum_vf qx = gather(points->x, indices) - view->middle.x, qy = gather(points->y, indices) - view->middle.y;
  const fum_vf qz = gather(points->z, indices) - view->middle.z;
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

/* Grids are read with cubic B-splines, whose own variance is a third of a step: casters are put in narrower by as much,
 * and so are exact to fourth order, at a step as large as sigma. */
static const float SPLINE_VARIANCE = 0.33333333F, LEAST_VARIANCE = 0.2F;

static void find_footprints(const patch *p, const uint32_t *indices, int32_t count, footprint *out) {
  const fum_octree *casters = p->job->casters;
  const float cell = p->job->level->cell;
  const bool is_parallel = p->job->view->is_parallel;
  const places at = find_places(p, casters, indices);
  const fum_vf sigma = p->job->sigma_scale / gather(casters->inverse_sigmas, indices), variance = sigma * sigma;
  const fum_vf one = fum_vf_set(1.0F), nowhere = fum_vf_set(-8.0F);
  const fum_vf squared = is_parallel ? one : 1.0F / (1.0F + at.u * at.u + at.v * at.v);
  /* How far apart grid lines are there, in m, squared and averaged over directions. */
  const fum_vf step = cell * at.depth, spread = step * step * 0.5F * (1.0F + squared) * SPLINE_VARIANCE;
  const fum_vf left = variance - spread, least = LEAST_VARIANCE * step * step;
  const fum_vf narrow = fum_vf_select(left > least, left, least), per_narrow = 1.0F / narrow;
  const fum_vf along = sigma * at.slabs_per_metre;
  const fum_vf narrow_along = fum_vf_sqrt(fum_vf_at_least(along * along - SPLINE_VARIANCE, LEAST_VARIANCE));
  /* Rays that pass at a distance d come nearest to the centre d^2 / (2 distance) before it. */
  const fum_vf bend = variance * at.slabs_per_metre * fum_vf_sqrt(squared) / at.depth;
  const fum_vf optical_depth = gather(casters->optical_depths, indices) * p->job->depth_scale * variance * per_narrow;
  const fum_vf reach = FUM_SWEEP_SPREAD * narrow_along;
  /* A caster far beside the patch has no place on its plane, nor anything to give to it. */
  const fum_vi is_before = (at.depth > 0.0F) & (squared > 0.06F);
  const fum_vf range = is_parallel ? at.range : fum_vf_select(is_before, at.range - bend, at.range);
  const fum_vf values[] = {fum_vf_select(is_before, (at.u - p->lower[0]) / cell, nowhere),
                           fum_vf_select(is_before, (at.v - p->lower[1]) / cell, nowhere),
                           at.u,
                           at.v,
                           squared,
                           0.72134752F * at.depth * at.depth * per_narrow,
                           optical_depth,
                           fum_vf_select(is_before, p->job->view->reach * fum_vf_sqrt(narrow / squared) / step, one),
                           range,
                           1.0F / narrow_along,
                           fum_vf_at_least(range - reach, 0.0F),
                           range + reach};
  for (int32_t k = 0; k < count; k++) {
    footprint *f = &out[k];
    *f = (footprint){values[0][k], values[1][k], values[2][k],           values[3][k],
                     values[4][k], values[5][k], values[6][k],           values[7][k],
                     values[8][k], values[9][k], (int32_t)values[10][k], (int32_t)values[11][k]};
    f->last = f->last < f->first + MOST_SPAN ? f->last : f->first + MOST_SPAN - 1;
  }
}

/* A receiver in its patch: cells and slabs. */
typedef struct spot {
  float column, row, range;
} spot;

static void find_spots(const patch *p, const uint32_t *indices, int32_t count, spot *out) {
  const float per_cell = 1.0F / p->job->level->cell, last = (float)(p->job->level->slab_count - 2);
  const places at = find_places(p, p->job->points, indices);
  const fum_vf column = (at.u - p->lower[0]) * per_cell, row = (at.v - p->lower[1]) * per_cell;
  const fum_vf range = fum_vf_at_least(at.range, 1.0F);
  for (int32_t k = 0; k < count; k++)
    out[k] = (spot){column[k], row[k], range[k] < last ? range[k] : last};
}

/* FUM_LANES indices from place `k` on, the last of `count` again where there are fewer; returns how many there are. */
static int32_t take_indices(const uint32_t *list, int64_t k, int64_t count, uint32_t out[FUM_LANES]) {
  for (int64_t lane = 0; lane < FUM_LANES; lane++)
    out[lane] = list[k + lane < count ? k + lane : count - 1];
  return (int32_t)(count - k < FUM_LANES ? count - k : FUM_LANES);
}
