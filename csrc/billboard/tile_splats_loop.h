/* SPDX-License-Identifier: GPL-3.0-or-later */
/* The part of tile_loop.h that adds up a tile's splats in its slabs. */
#ifndef FUM_BILLBOARD_TILE_SPLATS_LOOP_H
#define FUM_BILLBOARD_TILE_SPLATS_LOOP_H

#include "billboard/tile_map_loop.h"

#include <string.h>

/* What a splat adds to each channel behind the first, as factors on its optical depth. `splat` is its place in the
 * octree's order. */
static void find_look(const fum_tile_job *job, uint32_t splat, float self_shade, float *out) {
  if (job->is_uniform) return;
  if (job->values != NULL) {
    memcpy(out, job->values + 3 * (int64_t)splat, 3 * sizeof *out);
    return;
  }
  const uint32_t index = job->octree->indices[splat];
  const fum_particles *set = fum_scene_particles_of(job->scene, index);
  const int64_t i = index - set->offset;
  const float *albedo = set->albedos != NULL ? set->albedos + 3 * i : set->albedo;
  const float *emission = set->emissions != NULL ? set->emissions + 3 * i : set->emission;
  for (int32_t k = 0; k < job->class_count; k++) {
    for (int c = 0; c < 3; c++)
      out[3 * k + c] = job->class_of[set - job->scene->particles] == k ? albedo[c] * self_shade : 0.0F;
  }
  const float density = fum_max(set->densities[i], job->thinnest / (set->sigmas[i] * (float)FUM_SQRT_2PI));
  const float *light = job->centre_light != NULL ? job->centre_light + 3 * (int64_t)splat : NULL;
  for (int c = 0; job->glows && c < 3; c++)
    out[3 * job->class_count + c] =
        (density > 0.0F ? emission[c] / density : 0.0F) + (light != NULL ? albedo[c] * light[c] * self_shade : 0.0F);
}

enum { MAX_LOOK = 3 * 16 + 3 };

/* Blocks of the tile that a splat touches, by their first pixels. */
typedef struct patch {
  int32_t blocks[FUM_BLOCKS * FUM_BLOCKS];
  int32_t count;
} patch;

/* fum_splat_gap of rows or columns of blocks, from the one at `first` on. */
static void find_gaps(const fum_splat *s, int axis, int32_t first, float gaps[WIDEST_LANES]) {
  static const float BEGINS[WIDEST_LANES] = {0, 4, 8, 12, 16, 20, 24, 28};
  const float start = (float)first - s->middle_px[axis], per_half = 1.0F / s->half_px[axis];
  for (int32_t k = 0; k < FUM_BLOCKS; k += FUM_LANES) {
    const fum_vf begin = fum_vf_load(BEGINS + k) + start, end = begin + (float)(FUM_BLOCK - 1);
    const fum_vf gap = fum_vf_at_least(fum_vf_max(begin, -end), 0.0F) * per_half;
    fum_vf_store(gaps + k, gap * gap);
  }
}

/* Those of a row's or column's blocks whose gaps are at most `left`, as bits. */
static uint32_t find_touched(const float gaps[WIDEST_LANES], float left) {
  uint32_t touched = 0;
  for (int32_t k = 0; k < FUM_BLOCKS; k += FUM_LANES)
    touched |= fum_vi_bits(fum_vf_load(gaps + k) <= left) << k;
  return touched & ((1U << FUM_BLOCKS) - 1);
}

static void find_patch(const tile *t, const fum_splat *s, patch *out) {
  float across[WIDEST_LANES], up[WIDEST_LANES];
  find_gaps(s, 0, t->x0, across);
  find_gaps(s, 1, t->y0, up);
  out->count = 0;
  for (uint32_t rows = find_touched(up, s->rim); rows != 0; rows &= rows - 1) {
    const int32_t y = __builtin_ctz(rows);
    for (uint32_t touched = find_touched(across, s->rim - up[y]); touched != 0; touched &= touched - 1)
      out->blocks[out->count++] = (y * FUM_BLOCKS + __builtin_ctz(touched)) * FUM_BLOCK_PIXELS;
  }
}

static void deposit(const tile *t, float *at, fum_vf depth, const float *look) {
  fum_vf_store(at, fum_vf_load(at) + depth);
  for (int32_t c = 1; c < t->channels; c++) {
    float *channel = at + (int64_t)c * FUM_TILE_PIXELS;
    fum_vf_store(channel, fum_vf_load(channel) + depth * look[c - 1]);
  }
}

/* Rays that pass a splat's centre at a distance d come nearest to it this times d^2 before it. A widened splat stands
 * for something small: it has its shares where it is. */
static float bend_of(const tile *t, const fum_splat *s) {
  const bool is_bent = t->job->view->type == FUM_CAMERA_PERSPECTIVE && !(s->width > s->sigma);
  return is_bent ? 0.5F / s->range : 0.0F;
}

/* How far before the centre the splat's rays are nearest to it, on average; m. */
static float mean_bend(const fum_splat *s, float bend) {
  return bend * 2.0F * s->width * s->width;
}

static bool is_bent(const tile *t, const fum_splat *s, float bend) {
  return mean_bend(s, bend) > t->job->straight * s->sigma;
}

/* What decides the shares of a few splats. */
typedef struct batch {
  int32_t first[BATCH], last[BATCH]; /* slabs, from the tile's first on */
  float range[BATCH], inverse_sigma[BATCH];
  int32_t most; /* the most slabs of one */
  bool is_bent; /* one of them is */
} batch;

static batch find_batch(const tile *t, const uint32_t *indices, int32_t count) {
  batch b = {.most = 0};
  for (int32_t k = 0; k < BATCH; k++) {
    const fum_splat *s = &t->job->splats->splats[indices[k < count ? k : 0]];
    const float bend = bend_of(t, s);
    const int32_t slabs = s->last_slab - s->first_slab + 1;
    b.first[k] = s->first_slab - t->first_slab;
    b.last[k] = s->last_slab - t->first_slab;
    b.range[k] = s->range - mean_bend(s, bend);
    b.inverse_sigma[k] = 1.0F / s->sigma;
    b.most = slabs > b.most ? slabs : b.most;
    b.is_bent = b.is_bent || is_bent(t, s, bend);
  }
  return b;
}

/* Finds what splats leave in each slab that they reach into, if they are far, and how that changes as they move along
 * the view by one metre. */
static void find_shares(const tile *t, const batch *b) {
  for (int32_t k = 0; k < BATCH; k += FUM_LANES) {
    const fum_vf range = fum_vf_load(b->range + k), inverse_sigma = fum_vf_load(b->inverse_sigma + k);
    const fum_vi first = fum_vi_load(b->first + k), last = fum_vi_load(b->last + k);
    fum_vf before = ZERO, change_before = ZERO;
    for (int32_t j = 0; j < b->most; j++) {
      float *shares = t->shares + (int64_t)j * SHARES + k;
      const fum_vi is_last = first + j >= last, slab = (is_last & last) | (~is_last & (first + j));
      const fum_vf z = (fum_vf_gather(t->ranges, slab + 1) - range) * inverse_sigma;
      const fum_vf tail = fum_vf_select(is_last, ZERO, fum_vf_normal_tail(fum_vf_abs(z)));
      const fum_vf of = fum_vf_select(is_last | (z > 0.0F), 1.0F - tail, tail);
      fum_vf_store(shares, of - before);
      before = of;
      if (!b->is_bent) continue;
      const fum_vf bell = fum_vf_exp2(z * z * -FUM_HALF_LOG2_E) * (-0.39894228F * inverse_sigma);
      const fum_vf change = fum_vf_select(is_last, ZERO, bell);
      fum_vf_store(shares + BATCH, change - change_before);
      change_before = change;
    }
  }
}

/* Logarithm to the base 2 of a Gaussian where it ends: whole blocks are gone through, but what is drawn must not depend
 * on where their edges are. */
static float least_exponent(const fum_splat *s) {
  return fum_max(-FUM_HALF_LOG2_E * s->footprint * s->footprint, -126.0F);
}

/* What a far splat's footprint is made of. */
typedef struct footprint {
  float u, v, depth; /* of the centre: place in the window, distance along the axis */
  float optical_depth, falloff, least;
  const fum_stretch *stretch; /* NULL: it is round */
  bool is_perspective;
} footprint;

/* NULL: it is round. */
static const fum_stretch *stretch_of(const tile *t, const fum_splat *s) {
  const fum_splats *splats = t->job->splats;
  return splats->stretches != NULL ? &splats->stretches[s - splats->splats] : NULL;
}

static footprint find_footprint(const tile *t, const fum_splat *s) {
  const bool is_perspective = t->job->view->type == FUM_CAMERA_PERSPECTIVE;
  const float depth = is_perspective ? -s->center[2] : 1.0F, per_depth = 1.0F / depth;
  return (footprint){.u = s->center[0] * per_depth,
                     .v = s->center[1] * per_depth,
                     .depth = depth,
                     .optical_depth = s->optical_depth,
                     .falloff = -FUM_HALF_LOG2_E / (s->width * s->width),
                     .least = least_exponent(s),
                     .stretch = stretch_of(t, s),
                     .is_perspective = is_perspective};
}

static fum_vf stretch_by(const fum_stretch *s, fum_vf x, fum_vf y) {
  return x * (s->xx * x + s->xy * y) + s->yy * y * y;
}

/* Optical depth at the pixels from `pixel` on, and in `out_squared` how far from the centre they pass. */
static inline __attribute__((always_inline)) fum_vf find_gauss(const tile *t, const footprint *f, int32_t pixel,
                                                               fum_vf *out_squared) {
  const fum_vf e1 = (fum_vf_load(t->u + pixel) - f->u) * f->depth, e2 = (fum_vf_load(t->v + pixel) - f->v) * f->depth;
  fum_vf squared = e1 * e1 + e2 * e2;
  if (f->is_perspective) { /* |centre x ray| / |ray|, written without a difference of large numbers */
    const fum_vf e3 = e2 * f->u - e1 * f->v, inverse_length = fum_vf_load(t->inverse_length + pixel);
    squared = (squared + e3 * e3) * (inverse_length * inverse_length);
  }
  *out_squared = squared;
  fum_vf exponent = squared * f->falloff;
  if (f->stretch != NULL) exponent += stretch_by(f->stretch, e1, e2);
  return f->optical_depth * fum_vf_exp2_from(f->least, exponent);
}

/* A splat far away against its size and clear of every cut; to first order in what is left when all its pixels' rays
 * are bent alike, they have the same shares. `shares`: the first of its own. */
static inline __attribute__((always_inline)) void splat_far(const tile *t, const fum_splat *s, const float *shares,
                                                            const patch *p, const float *look, splat_map *map,
                                                            float *slabs) {
  const footprint f = find_footprint(t, s);
  const float bend = bend_of(t, s), mean = mean_bend(s, bend);
  const int32_t count = s->last_slab - s->first_slab + 1;
  const int64_t stride = slab_stride(t);
  float *first = slabs + (s->first_slab - t->first_slab) * stride;
  const bool moves = is_bent(t, s, bend), is_uniform = t->channels == 1;
  float gauss[FUM_TILE_PIXELS], moved[FUM_TILE_PIXELS];
  for (int32_t n = 0; n < p->count; n++) { /* by themselves: one needn't wait for the other's deposits */
    for (int32_t k = 0; k < FUM_BLOCK_PIXELS; k += FUM_LANES) {
      fum_vf squared;
      const fum_vf depth = find_gauss(t, &f, p->blocks[n] + k, &squared);
      fum_vf_store(gauss + n * FUM_BLOCK_PIXELS + k, depth);
      fum_vf_store(moved + n * FUM_BLOCK_PIXELS + k, depth * (mean - bend * squared));
    }
  }
  for (int32_t n = 0; n < p->count; n++) {
    for (int32_t k = 0; k < FUM_BLOCK_PIXELS; k += FUM_LANES) {
      const fum_vf depth = fum_vf_load(gauss + n * FUM_BLOCK_PIXELS + k);
      const fum_vf change = fum_vf_load(moved + n * FUM_BLOCK_PIXELS + k);
      const float *of = shares;
      float *at = first + p->blocks[n] + k;
      if (map != NULL) read_map(t, p->blocks[n] + k, map);
      if (map == NULL && is_uniform && !moves) {
        for (int32_t j = 0; j < count; j++, at += stride, of += SHARES)
          fum_vf_store(at, fum_vf_load(at) + depth * *of);
        continue;
      }
      for (int32_t j = 0; j < count; j++, at += stride, of += SHARES) {
        const fum_vf part = moves ? fum_vf_at_least(depth * of[0] + change * of[BATCH], 0.0F) : depth * of[0];
        if (map != NULL) {
          deposit_mapped(t, at, part, look, map);
        } else if (is_uniform) {
          fum_vf_store(at, fum_vf_load(at) + part);
        } else {
          deposit(t, at, part, look);
        }
      }
    }
  }
}

/* Any splat: every pixel's ray has its own nearest point and its own ends. */
static inline __attribute__((always_inline)) void splat_near(const tile *t, const fum_splat *s, const patch *p,
                                                             const float *look, splat_map *map, float *slabs) {
  const bool is_perspective = t->job->view->type == FUM_CAMERA_PERSPECTIVE;
  const float *c = s->center, inverse_sigma = 1.0F / s->sigma;
  const float falloff = -FUM_HALF_LOG2_E / (s->width * s->width);
  const float least = least_exponent(s);
  const float depth = is_perspective ? -c[2] : 1.0F;
  const fum_stretch *stretch = stretch_of(t, s);
  const int32_t first = s->first_slab - t->first_slab, last = s->last_slab - t->first_slab;
  for (int32_t n = 0; n < p->count; n++) {
    for (int32_t k = 0; k < FUM_BLOCK_PIXELS; k += FUM_LANES) {
      const int32_t pixel = p->blocks[n] + k;
      const fum_vf u = fum_vf_load(t->u + pixel), v = fum_vf_load(t->v + pixel);
      fum_vf nearest = fum_vf_set(-c[2]), squared = (u - c[0]) * (u - c[0]) + (v - c[1]) * (v - c[1]);
      if (is_perspective) {
        const fum_vf inverse_length = fum_vf_load(t->inverse_length + pixel);
        const fum_vf a = -c[1] - c[2] * v, b = c[2] * u + c[0], d = c[0] * v - c[1] * u;
        squared = (a * a + b * b + d * d) * (inverse_length * inverse_length);
        nearest = (c[0] * u + c[1] * v - c[2]) * inverse_length;
      }
      fum_vf exponent = squared * falloff;
      if (stretch != NULL) exponent += stretch_by(stretch, u * depth - c[0], v * depth - c[1]);
      const fum_vf gauss = s->optical_depth * fum_vf_exp2_from(least, exponent);
      const fum_vf near = fum_vf_load(t->near + pixel), far = fum_vf_max(near, fum_vf_load(t->far + pixel));
      fum_vf begin = near;
      if (map != NULL) read_map(t, pixel, map);
      for (int32_t j = first; j <= last; j++) {
        const fum_vf end = j == last ? far : fum_vf_max(begin, fum_vf_min(fum_vf_set(t->ranges[j + 1]), far));
        const fum_vf part = fum_vf_normal_interval((begin - nearest) * inverse_sigma, (end - nearest) * inverse_sigma);
        float *at = slabs + j * slab_stride(t) + pixel;
        if (map != NULL) {
          deposit_mapped(t, at, gauss * part, look, map);
        } else {
          deposit(t, at, gauss * part, look);
        }
        begin = end;
      }
    }
  }
}

/* The same loops without maps and with them, each compiled for itself: maps cost nothing where there are none.
 * `shares`: NULL if it isn't far. */
static void splat_plain(const tile *t, const fum_splat *s, const float *shares, const patch *p, const float *look,
                        float *slabs) {
  if (shares != NULL) {
    splat_far(t, s, shares, p, look, NULL, slabs);
  } else {
    splat_near(t, s, p, look, NULL, slabs);
  }
}

static void splat_mapped(const tile *t, const fum_splat *s, const float *shares, const patch *p, const float *look,
                         splat_map *map, float *slabs) {
  if (shares != NULL) {
    splat_far(t, s, shares, p, look, map, slabs);
  } else {
    splat_near(t, s, p, look, map, slabs);
  }
}

/* `box`: the blocks that its box touches. In tile_smear_loop.h. */
static void add_smeared(const tile *t, uint32_t index, const patch *box, const float *look, float *slabs);

/* Far away against its size and clear of every cut: the range shifts by less than 0.2 of a sigma where the Gaussian
 * still matters. */
static bool is_far(const tile *t, const fum_splat *s) {
  const float far_away = 30.0F, reach = 1.125F * s->reach; /* widths */
  if (!(s->range - reach > t->farthest_near && s->range + reach < t->nearest_far)) return false;
  return t->job->view->type != FUM_CAMERA_PERSPECTIVE ||
         (-s->center[2] > far_away * s->width && s->range > far_away * s->sigma);
}

static void add_splat(const tile *t, uint32_t index, const float *shares, float *slabs) {
  const fum_splat *s = &t->job->splats->splats[index];
  const fum_streak *streaks = t->job->splats->streaks;
  float look[MAX_LOOK];
  splat_map map;
  patch p;
  find_look(t->job, index, s->self_shade, look);
  find_patch(t, s, &p);
  if (streaks != NULL && streaks[index].kind != FUM_STREAK_NONE) {
    add_smeared(t, index, &p, look, slabs);
    return;
  }
  if (!is_far(t, s)) shares = NULL;
  if (find_map(t->job, index, &map)) {
    splat_mapped(t, s, shares, &p, look, &map, slabs);
  } else {
    splat_plain(t, s, shares, &p, look, slabs);
  }
}

static void add_splats(const tile *t, const uint32_t *indices, int64_t count, float *slabs) {
  for (int64_t begin = 0; begin < count; begin += BATCH) {
    const int32_t few = (int32_t)(count - begin < BATCH ? count - begin : BATCH);
    const batch b = find_batch(t, indices + begin, few);
    find_shares(t, &b);
    for (int32_t k = 0; k < few; k++) {
      const int64_t ahead = begin + k + BATCH;
      if (ahead < count) __builtin_prefetch(&t->job->splats->splats[indices[ahead]]);
      add_splat(t, indices[begin + k], t->shares + k, slabs);
    }
  }
}

#endif
