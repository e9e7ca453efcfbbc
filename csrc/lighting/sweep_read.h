/* SPDX-License-Identifier: GPL-3.0-or-later */
/* Optical depth read from the grid of a patch of the sweep; a part of sweep_loop.h. */

/* Faces, rows and columns that a receiver is read from along each axis. */
enum { TAPS = 4 };

static float least_of(fum_vf v) {
  float least = INFINITY;
  for (int32_t k = 0; k < FUM_LANES; k++)
    least = v[k] < least ? v[k] : least;
  return least;
}

static int64_t faces_size(const patch *p) {
  return (int64_t)p->rows * p->columns * TAPS;
}

/* Cells from which the receivers of a batch are read. */
static area find_area(const patch *p, const chunk *last) {
  const fum_vf far = fum_vf_set(INFINITY);
  fum_vf left = far, top = far, right = far, bottom = far; /* the latter two negative */
  for (const chunk *c = last; c != NULL; c = c->before) {
    for (int32_t k = 0; k < c->count; k += FUM_LANES) {
      const fum_vi is_there = fum_vi_load(LANE_NUMBERS) < c->count - k;
      const fum_vf column = fum_vf_load(c->columns + k), row = fum_vf_load(c->rows + k);
      left = fum_vf_min(fum_vf_select(is_there, column, far), left);
      top = fum_vf_min(fum_vf_select(is_there, row, far), top);
      right = fum_vf_min(fum_vf_select(is_there, -column, far), right);
      bottom = fum_vf_min(fum_vf_select(is_there, -row, far), bottom);
    }
  }
  return (area){at_least(floorf(least_of(left)) - 1.0F, 0), at_least(floorf(least_of(top)) - 1.0F, 0),
                at_most(3.0F - least_of(right), p->columns), at_most(3.0F - least_of(bottom), p->rows)};
}

/* Copies the faces that receivers of a batch are read from, for each of its slabs the two around it and one more on
 * both sides, side by side for each cell: these have a fourth of the memory to look at. */
static void take_faces(const patch *p, int32_t batch, area of) {
  int32_t at[BATCH + TAPS - 1];
  for (int32_t k = 0; k < BATCH + TAPS - 1; k++)
    at[k] = (BATCH * batch - 2 + k) & (FACES - 1);
  const bool is_whole = at[0] < at[BATCH + TAPS - 2];
  const int64_t step = faces_size(p);
  for (int32_t y = of.top; y < of.bottom; y++) {
    for (int64_t i = (int64_t)y * p->columns + of.left; i < (int64_t)y * p->columns + of.right; i++) {
      const float *line = p->lines + FACES * i;
      for (int32_t k = 0; k < BATCH; k++) {
        float *out = p->faces + step * k + TAPS * i;
        if (is_whole) {
          memcpy(out, line + at[k], TAPS * sizeof *out);
          continue;
        }
        for (int32_t tap = 0; tap < TAPS; tap++)
          out[tap] = line[at[k + tap]];
      }
    }
  }
}

/* Weights of the cubic B-spline along an axis, for places between the second and the third tap. */
static inline void weigh_taps(fum_vf t, fum_vf weights[TAPS]) {
  const fum_vf s = 1.0F - t;
  const float sixth = 0.16666667F;
  weights[0] = s * s * s * sixth;
  weights[1] = (4.0F + t * t * (3.0F * t - 6.0F)) * sixth;
  weights[2] = (4.0F + s * s * (3.0F * s - 6.0F)) * sixth;
  weights[3] = t * t * t * sixth;
}

/* Optical depths in front of receivers from `first` on, FUM_LANES at most, from the faces taken. */
static void read_depths(const patch *p, const chunk *c, int32_t first) {
  const fum_vf column = fum_vf_load(c->columns + first), row = fum_vf_load(c->rows + first);
  const fum_vf range = fum_vf_load(c->ranges + first);
  const fum_vi right = __builtin_convertvector(column, fum_vi), down = __builtin_convertvector(row, fum_vi);
  const fum_vi is_here = (right >= 1) & (down >= 1) & (right < p->columns - 2) & (down < p->rows - 2);
  /* Behind the last receiver there may be anything. */
  const fum_vi x = right & is_here, y = down & is_here, slab = __builtin_convertvector(range, fum_vi) & is_here;
  const fum_vi corner = (((((slab + 1) % BATCH) * p->rows + y - 1) * p->columns + x - 1) * TAPS) & is_here;
  const int64_t step = (int64_t)TAPS * p->columns;
  const int32_t left = c->count - first, count = left < FUM_LANES ? left : FUM_LANES;
  int32_t corners[FUM_LANES];
  float found[FUM_LANES];
  fum_vf weights[TAPS];
  float of_rows[TAPS][FUM_LANES];
  fum_quad of_columns[FUM_LANES], of_faces[FUM_LANES], sums[FUM_LANES] = {{0.0F}};
  memcpy(corners, &corner, sizeof corners);
  weigh_taps(column - __builtin_convertvector(x, fum_vf), weights);
  fum_quads_from(weights, of_columns);
  weigh_taps(range - __builtin_convertvector(slab, fum_vf), weights);
  fum_quads_from(weights, of_faces);
  weigh_taps(row - __builtin_convertvector(y, fum_vf), weights);
  memcpy(of_rows, weights, sizeof of_rows);
  for (int32_t k = 0; k < count; k++) {
    const float *taps = p->faces + corners[k];
    const float *const rows[TAPS] = {taps, taps + step, taps + 2 * step, taps + 3 * step};
    __builtin_prefetch(&p->job->depths[c->indices[first + k + AHEAD]]);
    sums[k] = fum_quad_contract(of_columns[k], &of_rows[0][k], of_faces[k], rows);
  }
  const fum_vf depth = fum_vf_at_least(fum_quads_sum(sums), 0.0F);
  fum_vf_store(found, fum_vf_select(is_here, depth, fum_vf_set(0.0F)));
  for (int32_t k = 0; k < count; k++)
    p->job->depths[c->indices[first + k]] += found[k];
}
