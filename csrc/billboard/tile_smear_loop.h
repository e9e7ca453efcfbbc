/* SPDX-License-Identifier: GPL-3.0-or-later */
/* The part of tile_loop.h that adds up smeared splats: of a particle's optical depth each pixel sees the mean over the
 * time that the shutter is open, or over the lens. */
#include "billboard/tile_splats_loop.h"

static void find_streak_patch(const tile *t, const fum_streak *s, const patch *box, patch *out) {
  const float half = 0.5F * (float)(FUM_BLOCK - 1), diagonal = 1.4143F * half;
  out->count = 0;
  for (int32_t n = 0; n < box->count; n++) {
    const int32_t block = box->blocks[n] / FUM_BLOCK_PIXELS;
    const float x = (float)(t->x0 + block % FUM_BLOCKS * FUM_BLOCK) + half;
    const float y = (float)(t->y0 + block / FUM_BLOCKS * FUM_BLOCK) + half;
    if (fum_streak_touches(s, x, y, diagonal)) out->blocks[out->count++] = box->blocks[n];
  }
}

static fum_vf vf_clamp(fum_vf v, float low, float high) {
  return fum_vf_min(fum_vf_max(v, fum_vf_set(low)), fum_vf_set(high));
}

/* Where along the rays a smeared splat lies: a normal distribution. */
typedef struct whereabouts {
  fum_vf range, inverse_deviation;
} whereabouts;

/* Cuts the optical depth that pixels see of a splat into slabs. What lies before the first of its slabs and behind the
 * last is put there. */
static void cut_into_slabs(const tile *t, const fum_splat *s, int32_t pixel, fum_vf depth, const whereabouts *at,
                           const float *look, float *slabs) {
  const int32_t first = s->first_slab - t->first_slab, last = s->last_slab - t->first_slab;
  const fum_vf near = fum_vf_load(t->near + pixel), far = fum_vf_max(near, fum_vf_load(t->far + pixel));
  fum_vf before = ZERO;
  for (int32_t j = first - 1; j <= last; j++) {
    const fum_vf end = j < first   ? near
                       : j == last ? far
                                   : fum_vf_max(near, fum_vf_min(fum_vf_set(t->ranges[j + 1]), far));
    const fum_vf z = (end - at->range) * at->inverse_deviation, tail = fum_vf_normal_tail(fum_vf_abs(z));
    const fum_vf until = fum_vf_select(z > 0.0F, 1.0F - tail, tail);
    if (j >= first) deposit(t, slabs + j * slab_stride(t) + pixel, depth * fum_vf_max(until - before, ZERO), look);
    before = until;
  }
}

enum { BLOCK_VECTORS = FUM_BLOCK_PIXELS / FUM_LANES };

/* What the pixels of a block see of a splat. */
typedef struct block_sight {
  fum_vf depths[BLOCK_VECTORS];
  whereabouts at[BLOCK_VECTORS];
} block_sight;

/* Means over a block, weighted with optical depth: range and inverse deviation. False if nothing is seen. */
static bool find_means(const block_sight *b, float *out_range, float *out_inverse) {
  float sum = 0.0F, range = 0.0F, inverse = 0.0F;
  for (int32_t k = 0; k < BLOCK_VECTORS; k++) {
    sum += fum_vf_sum(b->depths[k]);
    range += fum_vf_sum(b->depths[k] * b->at[k].range);
    inverse += fum_vf_sum(b->depths[k] * b->at[k].inverse_deviation);
  }
  if (!(sum > 0.0F)) return false;
  *out_range = range / sum;
  *out_inverse = inverse / sum;
  return true;
}

/* Are the block's ranges so close together, against how far each is spread, that a line through their mean is enough?
 */
static bool are_close(const block_sight *b, float range, float inverse) {
  const float most = 0.25F;
  uint32_t beyond = 0;
  for (int32_t k = 0; k < BLOCK_VECTORS; k++) {
    const fum_vf away = fum_vf_abs((b->at[k].range - range) * inverse);
    const fum_vf changed = fum_vf_abs(b->at[k].inverse_deviation - inverse);
    beyond |= fum_vi_bits((b->depths[k] > 0.0F) & ((away > most) | (changed > 0.1F * inverse)));
  }
  return beyond == 0;
}

typedef struct cut_shares {
  float of[FUM_MAX_SLABS + WIDEST_LANES], change[FUM_MAX_SLABS + WIDEST_LANES];
} cut_shares;

/* The same for a block of pixels that is clear of every cut: shares of its mean, and how they change with the range
 * from pixel to pixel. */
static void cut_block(const tile *t, const fum_splat *s, int32_t first_pixel, const block_sight *b, float range,
                      float inverse, const float *look, float *slabs, cut_shares *shares) {
  const float unseen = 1e-6F;
  const int32_t first = s->first_slab - t->first_slab, count = s->last_slab - s->first_slab + 1;
  const float *ends = t->ranges + first + 1;
  for (int32_t j = 0; j < count; j += FUM_LANES) {
    const fum_vf z = (fum_vf_load(ends + j) - range) * inverse, tail = fum_vf_normal_tail(fum_vf_abs(z));
    fum_vf_store(shares->of + j, fum_vf_select(z > 0.0F, 1.0F - tail, tail));
    fum_vf_store(shares->change + j,
                 -0.39894228F * inverse * fum_vf_exp2(fum_vf_max(z * z * -FUM_HALF_LOG2_E, fum_vf_set(-200.0F))));
  }
  shares->of[count - 1] = 1.0F;
  shares->change[count - 1] = 0.0F;
  float of = 0.0F, change = 0.0F;
  for (int32_t j = 0; j < count; j++) {
    const float part = shares->of[j] - of, bend = shares->change[j] - change;
    of = shares->of[j];
    change = shares->change[j];
    if (part < unseen) continue;
    float *at = slabs + (first + j) * slab_stride(t) + first_pixel;
    for (int32_t k = 0; k < BLOCK_VECTORS; k++) {
      const fum_vf here = part + (b->at[k].range - range) * bend;
      deposit(t, at + k * FUM_LANES, b->depths[k] * fum_vf_max(here, ZERO), look);
    }
  }
}

/* Whether a splat's slabs are all between the near plane and what hides it, for all of the tile's pixels. */
static bool is_clear_of_cuts(const tile *t, uint32_t index) {
  const float *ranges = t->job->splats->streaks[index].ranges;
  return ranges[0] > t->farthest_near && ranges[1] < t->nearest_far;
}

static void add_block(const tile *t, uint32_t index, int32_t first_pixel, const block_sight *b, const float *look,
                      float *slabs, cut_shares *shares) {
  const fum_splat *s = &t->job->splats->splats[index];
  float range, inverse;
  if (!find_means(b, &range, &inverse)) return;
  if (is_clear_of_cuts(t, index) && are_close(b, range, inverse)) {
    cut_block(t, s, first_pixel, b, range, inverse, look, slabs, shares);
    return;
  }
  for (int32_t k = 0; k < BLOCK_VECTORS; k++) {
    if (fum_vi_bits(b->depths[k] > 0.0F) == 0) continue;
    cut_into_slabs(t, s, first_pixel + k * FUM_LANES, b->depths[k], &b->at[k], look, slabs);
  }
}

/* ---- Motion ------------------------------------------------------------------------------------------------------ */

/* A Gaussian on its way from -path/2 to path/2 around its centre, lengths in its widths. */
typedef struct sweep {
  float center[3], path[3];
  float optical_depth, width, variance; /* variance: along the view, m^2 */
  float footprint;
  bool is_perspective;
} sweep;

static sweep find_sweep(const tile *t, const fum_splat *s, const fum_smear *smear) {
  const float defocus = t->job->bokeh->variance * smear->confusion * smear->confusion;
  const float squared = s->width * s->width, width = sqrtf(squared + defocus);
  sweep w = {.optical_depth = s->optical_depth * squared / (squared + defocus),
             .width = width,
             .variance = s->sigma * s->sigma,
             .footprint = s->footprint,
             .is_perspective = t->job->view->type == FUM_CAMERA_PERSPECTIVE};
  for (int axis = 0; axis < 3; axis++) {
    w.center[axis] = smear->center[axis] / width;
    w.path[axis] = smear->path[axis] / width;
  }
  return w;
}

/* How pixels' rays pass the path: across them the centre is at `offset` in the middle of the path and moves by `motion`
 * on all of it; along them it is at `range` and moves by `pace`. Widths. */
typedef struct passing {
  fum_vf offset_squared, motion_squared, product; /* offset^2, motion^2, offset motion */
  fum_vf area;                                    /* that they span */
  fum_vf range, pace;
} passing;

static passing find_passing(const tile *t, const sweep *w, int32_t pixel) {
  const float *c = w->center, *m = w->path, per_width = 1.0F / w->width;
  const fum_vf u = fum_vf_load(t->u + pixel), v = fum_vf_load(t->v + pixel);
  if (!w->is_perspective) {
    const fum_vf x = c[0] - u * per_width, y = c[1] - v * per_width;
    return (passing){x * x + y * y,       fum_vf_set(m[0] * m[0] + m[1] * m[1]),
                     x * m[0] + y * m[1], x * m[1] - y * m[0],
                     fum_vf_set(-c[2]),   fum_vf_set(-m[2])};
  }
  const fum_vf scale = fum_vf_load(t->inverse_length + pixel);
  const fum_vf cx = -c[1] - c[2] * v, cy = c[2] * u + c[0], cz = c[0] * v - c[1] * u;
  const fum_vf mx = -m[1] - m[2] * v, my = m[2] * u + m[0], mz = m[0] * v - m[1] * u;
  const fum_vf squared = scale * scale;
  return (passing){(cx * cx + cy * cy + cz * cz) * squared, (mx * mx + my * my + mz * mz) * squared,
                   (cx * mx + cy * my + cz * mz) * squared, (cx * my - cy * mx) * scale,
                   (c[0] * u + c[1] * v - c[2]) * scale,    (m[0] * u + m[1] * v - m[2]) * scale};
}

/* The mean of exp(-|offset + s motion|^2 / 2) over s from -1/2 to 1/2, and where along the rays it is that they see.
 * Across the path it is a Gaussian, along it a difference of normal distribution functions; what the rays see of the
 * path is a normal distribution cut off at both ends, whose mean and variance are known. Of motion across the view that
 * is short against the width a series is enough. */
static fum_vf find_mean(const sweep *w, const passing *p, whereabouts *out) {
  const fum_vi is_long = p->motion_squared > 0.01F;
  const fum_vf squared = fum_vf_select(is_long, p->motion_squared, fum_vf_set(1.0F)), length = fum_vf_sqrt(squared);
  const fum_vf nearest = fum_vf_select(is_long, -p->product / squared, ZERO);
  const fum_vf aside = fum_vf_select(is_long, p->area * p->area / squared, p->offset_squared);
  const fum_vf low = (-0.5F - nearest) * length, high = (0.5F - nearest) * length;
  const fum_vf share = fum_vf_max(fum_vf_normal_interval(low, high), fum_vf_set(1e-30F));
  const fum_vf begin = 0.39894228F * fum_vf_exp2(low * low * -FUM_HALF_LOG2_E),
               end = 0.39894228F * fum_vf_exp2(high * high * -FUM_HALF_LOG2_E);
  const fum_vf stretched = share * 2.50662827F / length;
  const fum_vf bent = 1.0F + (p->product * p->product - p->motion_squared) * 0.041666668F;
  const fum_vf lean = (begin - end) / share;
  const fum_vf place =
      vf_clamp(fum_vf_select(is_long, nearest + lean / length, p->product * -0.083333336F), -0.5F, 0.5F);
  const fum_vf spread = (1.0F + (low * begin - high * end) / share - lean * lean) / squared;
  const fum_vf variance =
      fum_vf_select(squared > 0.04F, vf_clamp(spread, 0.0F, 0.083333336F), fum_vf_set(0.083333336F));
  const fum_vf pace = p->pace * w->width;
  out->range = p->range * w->width + pace * place;
  out->inverse_deviation = 1.0F / fum_vf_sqrt(w->variance + pace * pace * variance);
  const fum_vf ended = vf_clamp(nearest, -0.5F, 0.5F);
  const fum_vf distance = p->offset_squared + ended * (2.0F * p->product + ended * p->motion_squared);
  const fum_vf gauss = fum_vf_exp2(fum_vf_max(aside * -FUM_HALF_LOG2_E, fum_vf_set(-200.0F)));
  const fum_vf mean = gauss * fum_vf_select(is_long, stretched, bent);
  return fum_vf_select(distance > w->footprint * w->footprint, ZERO, mean);
}

static void add_sweep(const tile *t, uint32_t index, const patch *p, const float *look, float *slabs) {
  const sweep w = find_sweep(t, &t->job->splats->splats[index], &t->job->smears->items[index]);
  block_sight b;
  cut_shares shares;
  for (int32_t n = 0; n < p->count; n++) {
    uint32_t seen = 0;
    for (int32_t k = 0; k < BLOCK_VECTORS; k++) {
      const passing passes = find_passing(t, &w, p->blocks[n] + k * FUM_LANES);
      b.depths[k] = w.optical_depth * find_mean(&w, &passes, &b.at[k]);
      seen |= fum_vi_bits(b.depths[k] > 0.0F);
    }
    if (seen != 0) add_block(t, index, p->blocks[n], &b, look, slabs, &shares);
  }
}

/* ---- Depth of field ---------------------------------------------------------------------------------------------- */

/* An image of the aperture, somewhere on the path. */
typedef struct image {
  float u, v, depth; /* of the centre: place in the window, distance along the axis; in an orthographic view 1 */
  float range;       /* along the axis */
  float optical_depth, inverse_deviation;
  fum_bokeh_place place;
} image;

static image find_image(const tile *t, const fum_splat *s, const fum_smear *smear, int32_t part, int32_t parts) {
  const bool is_perspective = t->job->view->type == FUM_CAMERA_PERSPECTIVE;
  const float share = ((float)part + 0.5F) / (float)parts - 0.5F;
  float c[3], slopes[2], across[2];
  for (int axis = 0; axis < 3; axis++)
    c[axis] = smear->center[axis] + share * smear->path[axis];
  image i = {.depth = is_perspective ? -c[2] : 1.0F, .range = -c[2]};
  i.u = c[0] / i.depth;
  i.v = c[1] / i.depth;
  slopes[0] = is_perspective ? i.u : 0.0F;
  slopes[1] = is_perspective ? i.v : 0.0F;
  for (int axis = 0; axis < 2; axis++)
    across[axis] = (smear->path[axis] + slopes[axis] * smear->path[2]) / (float)parts;
  /* In the plane of its depth a Gaussian seen at an angle is longer towards the middle of the picture; rays come from a
   * point: the nearer it is, the larger. What is left of the motion makes it longer, too. */
  const float distance = c[0] * c[0] + c[1] * c[1] + c[2] * c[2], squared = s->width * s->width;
  const float near = is_perspective ? 1.0F + fum_min(4.0F * squared / distance, 1.0F) : 1.0F;
  const float width = squared * near, length = 1.0F + slopes[0] * slopes[0] + slopes[1] * slopes[1];
  const double variances[3] = {(double)(width * (1.0F + slopes[0] * slopes[0]) + across[0] * across[0] / 12.0F),
                               (double)(width * slopes[0] * slopes[1] + across[0] * across[1] / 12.0F),
                               (double)(width * (1.0F + slopes[1] * slopes[1]) + across[1] * across[1] / 12.0F)};
  const double confusion = fum_smear_confusion(t->job->smears, smear, (double)(-share * smear->path[2]));
  const float along = smear->path[2] / (float)parts;
  i.place = fum_bokeh_at(t->job->bokeh, confusion, variances);
  i.optical_depth = s->optical_depth * i.place.density * width * sqrtf(length) / (float)parts;
  i.inverse_deviation = 1.0F / sqrtf(s->sigma * s->sigma + along * along * (length / 12.0F));
  return i;
}

/* A level's values, linear between them; 0 outside. */
static fum_vf look_up(const fum_bokeh *bokeh, int32_t level, fum_vf x, fum_vf y) {
  const fum_bokeh_level *l = &bokeh->levels[level];
  const float middle = (float)(l->side / 2), last = (float)(l->side - 1) - 0.001F;
  const fum_vf column = x * l->per_unit + middle, row = y * l->per_unit + middle;
  const fum_vi is_within = (column >= 0.0F) & (column <= last) & (row >= 0.0F) & (row <= last);
  if (fum_vi_bits(is_within) == 0) return ZERO;
  const fum_vi i = __builtin_convertvector(vf_clamp(column, 0.0F, last), fum_vi);
  const fum_vi j = __builtin_convertvector(vf_clamp(row, 0.0F, last), fum_vi);
  const fum_vf across = column - __builtin_convertvector(i, fum_vf), up = row - __builtin_convertvector(j, fum_vf);
  const float *values = bokeh->values + (int64_t)l->first * bokeh->width;
  const fum_vi at = j * bokeh->width + i;
  const fum_vf a = fum_vf_gather(values, at), b = fum_vf_gather(values + 1, at);
  const fum_vf c = fum_vf_gather(values + bokeh->width, at), d = fum_vf_gather(values + bokeh->width + 1, at);
  const fum_vf below = a + (b - a) * across, above = c + (d - c) * across;
  return fum_vf_select(is_within, below + (above - below) * up, ZERO);
}

static void add_image(const tile *t, uint32_t index, const image *i, const patch *p, const float *look, float *slabs) {
  const fum_bokeh *bokeh = t->job->bokeh;
  const float *m = i->place.units;
  block_sight b;
  cut_shares shares;
  for (int32_t n = 0; n < p->count; n++) {
    uint32_t seen = 0;
    for (int32_t k = 0; k < BLOCK_VECTORS; k++) {
      const int32_t pixel = p->blocks[n] + k * FUM_LANES;
      const fum_vf e = (fum_vf_load(t->u + pixel) - i->u) * i->depth, f = (fum_vf_load(t->v + pixel) - i->v) * i->depth;
      const fum_vf x = e * m[0] + f * m[1], y = e * m[1] + f * m[2];
      const fum_vf first = look_up(bokeh, i->place.level, x, y), next = look_up(bokeh, i->place.level + 1, x, y);
      b.depths[k] = i->optical_depth * (first + (next - first) * i->place.blend);
      b.at[k] = (whereabouts){i->range / fum_vf_load(t->inverse_length + pixel), fum_vf_set(i->inverse_deviation)};
      seen |= fum_vi_bits(b.depths[k] > 0.0F);
    }
    if (seen != 0) add_block(t, index, p->blocks[n], &b, look, slabs, &shares);
  }
}

/* Along its path an image is drawn as many times as it is longer than the Gaussian is wide. */
static void add_images(const tile *t, uint32_t index, const patch *p, const float *look, float *slabs) {
  const fum_splat *s = &t->job->splats->splats[index];
  const fum_smear *smear = &t->job->smears->items[index];
  const float most = 32.0F, *path = smear->path;
  const float length = sqrtf(path[0] * path[0] + path[1] * path[1] + path[2] * path[2]);
  const int32_t parts = (int32_t)fum_max(1.0F, fum_min(most, ceilf(length / s->width)));
  for (int32_t part = 0; part < parts; part++) {
    const image i = find_image(t, s, smear, part, parts);
    if (i.depth > 0.0F) add_image(t, index, &i, p, look, slabs);
  }
}

static void add_smeared(const tile *t, uint32_t index, const patch *box, const float *look, float *slabs) {
  const fum_streak *streak = &t->job->splats->streaks[index];
  patch p;
  find_streak_patch(t, streak, box, &p);
  (streak->kind == FUM_STREAK_SWEPT ? add_sweep : add_images)(t, index, &p, look, slabs);
}
