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
static void find_gaps(const fum_splat *s, int axis, int32_t first, float *gaps) {
  static const float BEGINS[FUM_BLOCKS] = {0, 4, 8, 12, 16, 20, 24, 28};
  const float start = (float)first - s->middle_px[axis], per_half = 1.0F / s->half_px[axis];
  for (int32_t k = 0; k < FUM_BLOCKS; k++) {
    const float begin = start + BEGINS[k], end = begin + (float)(FUM_BLOCK - 1);
    const float gap = fum_max(fum_max(begin, -end), 0.0F) * per_half;
    gaps[k] = gap * gap;
  }
}

static void find_patch(const tile *t, const fum_splat *s, patch *out) {
  const uint32_t all = (1U << FUM_BLOCKS) - 1;
  float across[WIDEST_LANES] = {0.0F}, up[FUM_BLOCKS];
  find_gaps(s, 0, t->x0, across);
  find_gaps(s, 1, t->y0, up);
  out->count = 0;
  for (int32_t y = 0; y < FUM_BLOCKS; y++) {
    const float left = s->rim - up[y];
    if (!(left >= 0.0F)) continue;
    uint32_t touched = 0;
    for (int32_t x = 0; x < FUM_BLOCKS; x += FUM_LANES)
      touched |= fum_vi_bits(fum_vf_load(across + x) <= left) << x;
    for (touched &= all; touched != 0; touched &= touched - 1)
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

/* What a far splat leaves in each slab that it reaches into, and how that changes as the splat moves along the view by
 * one metre. */
typedef struct share {
  float of[FUM_MAX_SLABS + WIDEST_LANES], change[FUM_MAX_SLABS + WIDEST_LANES];
} share;

static void find_shares(const tile *t, const fum_splat *s, float range, bool moves, share *out) {
  const int32_t slabs = s->last_slab - s->first_slab + 1;
  const float *ends = t->ranges + s->first_slab - t->first_slab + 1, inverse_sigma = 1.0F / s->sigma;
  for (int32_t j = 0; j < slabs; j += FUM_LANES) {
    const fum_vf z = (fum_vf_load(ends + j) - range) * inverse_sigma, tail = fum_vf_normal_tail(fum_vf_abs(z));
    fum_vf_store(out->of + j, fum_vf_select(z > 0.0F, 1.0F - tail, tail));
    if (moves) fum_vf_store(out->change + j, -0.39894228F * inverse_sigma * fum_vf_exp2(z * z * -FUM_HALF_LOG2_E));
  }
  out->of[slabs - 1] = 1.0F;
  out->change[slabs - 1] = 0.0F;
  for (int32_t j = slabs - 1; j > 0; j--) {
    out->of[j] -= out->of[j - 1];
    if (moves) out->change[j] -= out->change[j - 1];
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
  bool is_perspective;
} footprint;

static footprint find_footprint(const tile *t, const fum_splat *s) {
  const bool is_perspective = t->job->view->type == FUM_CAMERA_PERSPECTIVE;
  const float depth = is_perspective ? -s->center[2] : 1.0F, per_depth = 1.0F / depth;
  return (footprint){.u = s->center[0] * per_depth,
                     .v = s->center[1] * per_depth,
                     .depth = depth,
                     .optical_depth = s->optical_depth,
                     .falloff = -FUM_HALF_LOG2_E / (s->width * s->width),
                     .least = least_exponent(s),
                     .is_perspective = is_perspective};
}

/* Optical depth at the pixels from `pixel` on, and in `out_squared` how far from the centre they pass. */
static fum_vf find_gauss(const tile *t, const footprint *f, int32_t pixel, fum_vf *out_squared) {
  const fum_vf e1 = (fum_vf_load(t->u + pixel) - f->u) * f->depth, e2 = (fum_vf_load(t->v + pixel) - f->v) * f->depth;
  fum_vf squared = e1 * e1 + e2 * e2;
  if (f->is_perspective) { /* |centre x ray| / |ray|, written without a difference of large numbers */
    const fum_vf e3 = e2 * f->u - e1 * f->v, inverse_length = fum_vf_load(t->inverse_length + pixel);
    squared = (squared + e3 * e3) * (inverse_length * inverse_length);
  }
  *out_squared = squared;
  return f->optical_depth * fum_vf_exp2_from(f->least, squared * f->falloff);
}

/* A splat far away against its size and clear of every cut. Rays that pass the centre at a distance d come nearest to
 * it d^2 / (2 range) before it, on average width^2 / range; to first order in what is left, all pixels have the same
 * shares. A widened splat stands for something small: it has its shares where it is. */
static inline __attribute__((always_inline)) void splat_far(const tile *t, const fum_splat *s, const patch *p,
                                                            const float *look, splat_map *map, float *slabs) {
  share shares;
  const footprint f = find_footprint(t, s);
  const float bend = f.is_perspective && !(s->width > s->sigma) ? 0.5F / s->range : 0.0F;
  const float mean_squared = 2.0F * s->width * s->width;
  const int32_t count = s->last_slab - s->first_slab + 1;
  const int64_t stride = slab_stride(t);
  float *first = slabs + (s->first_slab - t->first_slab) * stride;
  const bool moves = bend * mean_squared > t->job->straight * s->sigma, is_uniform = t->channels == 1;
  find_shares(t, s, s->range - bend * mean_squared, moves, &shares);
  for (int32_t n = 0; n < p->count; n++) {
    for (int32_t k = 0; k < FUM_BLOCK_PIXELS; k += FUM_LANES) {
      fum_vf squared;
      const fum_vf gauss = find_gauss(t, &f, p->blocks[n] + k, &squared);
      const fum_vf moved = gauss * (bend * (mean_squared - squared));
      float *at = first + p->blocks[n] + k;
      if (map != NULL) read_map(t, p->blocks[n] + k, map);
      if (map == NULL && is_uniform && !moves) {
        for (int32_t j = 0; j < count; j++, at += stride)
          fum_vf_store(at, fum_vf_load(at) + gauss * shares.of[j]);
        continue;
      }
      for (int32_t j = 0; j < count; j++, at += stride) {
        const fum_vf part =
            moves ? fum_vf_at_least(gauss * shares.of[j] + moved * shares.change[j], 0.0F) : gauss * shares.of[j];
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
      const fum_vf gauss = s->optical_depth * fum_vf_exp2_from(least, squared * falloff);
      const fum_vf near = fum_vf_load(t->near + pixel), far = vf_max(near, fum_vf_load(t->far + pixel));
      fum_vf begin = near;
      if (map != NULL) read_map(t, pixel, map);
      for (int32_t j = first; j <= last; j++) {
        const fum_vf end = j == last ? far : vf_max(begin, vf_min(fum_vf_set(t->ranges[j + 1]), far));
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

/* The same loops without maps and with them, each compiled for itself: maps cost nothing where there are none. */
static void splat_plain(const tile *t, const fum_splat *s, const patch *p, const float *look, bool is_far,
                        float *slabs) {
  if (is_far) {
    splat_far(t, s, p, look, NULL, slabs);
  } else {
    splat_near(t, s, p, look, NULL, slabs);
  }
}

static void splat_mapped(const tile *t, const fum_splat *s, const patch *p, const float *look, bool is_far,
                         splat_map *map, float *slabs) {
  if (is_far) {
    splat_far(t, s, p, look, map, slabs);
  } else {
    splat_near(t, s, p, look, map, slabs);
  }
}

/* Splats are fetched from memory so many before they are needed. */
enum { AHEAD = 8 };

/* `box`: the blocks that its box touches. In tile_smear_loop.h. */
static void add_smeared(const tile *t, uint32_t index, const patch *box, const float *look, float *slabs);

static void add_splats(const tile *t, const uint32_t *indices, int64_t count, float *slabs) {
  const float far_away =
      30.0F; /* widths: the range shifts by less than 0.2 of a sigma where the Gaussian still matters */
  const bool is_perspective = t->job->view->type == FUM_CAMERA_PERSPECTIVE;
  const fum_streak *streaks = t->job->splats->streaks;
  float look[MAX_LOOK];
  splat_map map;
  patch p;
  for (int64_t n = 0; n < count; n++) {
    const fum_splat *s = &t->job->splats->splats[indices[n]];
    if (n + AHEAD < count) __builtin_prefetch(&t->job->splats->splats[indices[n + AHEAD]]);
    find_look(t->job, indices[n], s->self_shade, look);
    find_patch(t, s, &p);
    if (streaks != NULL && streaks[indices[n]].kind != FUM_STREAK_NONE) {
      add_smeared(t, indices[n], &p, look, slabs);
      continue;
    }
    const float reach = 1.125F * s->reach;
    const bool is_clear = s->range - reach > t->farthest_near && s->range + reach < t->nearest_far;
    const bool is_far = !is_perspective || (-s->center[2] > far_away * s->width && s->range > far_away * s->sigma);
    if (find_map(t->job, indices[n], &map)) {
      splat_mapped(t, s, &p, look, is_clear && is_far, &map, slabs);
    } else {
      splat_plain(t, s, &p, look, is_clear && is_far, slabs);
    }
  }
}

#endif
