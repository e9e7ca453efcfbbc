/* SPDX-License-Identifier: GPL-3.0-or-later */
/* The loops of tile.h, to be compiled once for each instruction set: tile_*.c define FUM_LANES and FUM_TILE_NAME. */
#include "base/simd.h"
#include "base/vector.h"
#include "billboard/tile.h"
#include "billboard/tile_light.h"

#include <stdlib.h>

static const float HALF_LOG2_E = 0.72134752F;

/* A tile on its way. */
typedef struct tile {
  const fum_tile_job *job;
  int32_t x0, y0;
  int32_t first_slab, slab_count, channels;
  float u[FUM_TILE], v[FUM_TILE];
  float inverse_length[FUM_TILE_PIXELS];             /* of the ray (u, v, -1); 1 in an orthographic view */
  float near[FUM_TILE_PIXELS], far[FUM_TILE_PIXELS]; /* ranges between which the ray sees smoke */
  float nearest_far, farthest_near;
} tile;

static void aim(tile *t) {
  const fum_view *view = t->job->view;
  const bool is_perspective = view->type == FUM_CAMERA_PERSPECTIVE;
  const double *w = view->window;
  for (int32_t i = 0; i < FUM_TILE; i++) {
    t->u[i] = (float)(w[0] + (w[1] - w[0]) * ((double)(t->x0 + i) + 0.5) / (double)view->width);
    t->v[i] = (float)(w[2] + (w[3] - w[2]) * ((double)(t->y0 + i) + 0.5) / (double)view->height);
  }
  t->nearest_far = INFINITY;
  t->farthest_near = 0.0F;
  for (int32_t i = 0; i < FUM_TILE_PIXELS; i++) {
    const int32_t x = t->x0 + i % FUM_TILE, y = t->y0 + i / FUM_TILE;
    const float u = t->u[i % FUM_TILE], v = t->v[i / FUM_TILE];
    const float length = is_perspective ? sqrtf(1.0F + u * u + v * v) : 1.0F;
    float depth = (float)view->clip_end;
    if (t->job->solid_depths != NULL && x < view->width && y < view->height) {
      depth = fum_min(depth, t->job->solid_depths[(int64_t)y * view->width + x]);
    }
    t->inverse_length[i] = 1.0F / length;
    t->near[i] = (float)view->clip_start * length;
    t->far[i] = depth * length;
    t->nearest_far = fum_min(t->nearest_far, t->far[i]);
    t->farthest_near = fum_max(t->farthest_near, t->near[i]);
  }
}

/* What a splat adds to each channel behind the first, as factors on its optical depth. `splat` is its place in the
 * octree's order. */
static void find_look(const fum_tile_job *job, uint32_t splat, float self_shade, float *out) {
  if (job->is_uniform) return;
  const uint32_t index = job->octree->indices[splat];
  const fum_particles *set = fum_scene_particles_of(job->scene, index);
  const int64_t i = index - set->offset;
  const float *albedo = set->albedos != NULL ? set->albedos + 3 * i : set->albedo;
  const float *emission = set->emissions != NULL ? set->emissions + 3 * i : set->emission;
  for (int32_t k = 0; k < job->class_count; k++) {
    for (int c = 0; c < 3; c++)
      out[3 * k + c] = job->anisotropies[k] == set->anisotropy ? albedo[c] * self_shade : 0.0F;
  }
  const float density = fum_max(set->densities[i], job->thinnest / (set->sigmas[i] * (float)FUM_SQRT_2PI));
  const float *light = job->centre_light != NULL ? job->centre_light + 3 * (int64_t)splat : NULL;
  for (int c = 0; job->glows && c < 3; c++)
    out[3 * job->class_count + c] =
        (density > 0.0F ? emission[c] / density : 0.0F) + (light != NULL ? albedo[c] * light[c] * self_shade : 0.0F);
}

enum { MAX_LOOK = 3 * 16 + 3 };

/* Rows and columns of the tile that a splat touches; columns widened to the widest vectors, whatever the instruction
 * set: every set must draw the same pixels. */
enum { WIDEST_LANES = 16 };

typedef struct patch {
  int32_t x0, x1, y0, y1;
} patch;

static patch find_patch(const tile *t, const fum_splat *s) {
  patch p = {s->lower[0] - t->x0, s->upper[0] - t->x0, s->lower[1] - t->y0, s->upper[1] - t->y0};
  p.x0 = (p.x0 < 0 ? 0 : p.x0) / WIDEST_LANES * WIDEST_LANES;
  p.x1 = p.x1 > FUM_TILE ? FUM_TILE : (p.x1 + WIDEST_LANES - 1) / WIDEST_LANES * WIDEST_LANES;
  p.y0 = p.y0 < 0 ? 0 : p.y0;
  p.y1 = p.y1 > FUM_TILE ? FUM_TILE : p.y1;
  return p;
}

static void deposit(const tile *t, float *at, fum_vf depth, const float *look) {
  fum_vf_store(at, fum_vf_load(at) + depth);
  for (int32_t c = 1; c < t->channels; c++) {
    float *channel = at + (int64_t)c * FUM_TILE_PIXELS;
    fum_vf_store(channel, fum_vf_load(channel) + depth * look[c - 1]);
  }
}

/* Floats from slab to slab. A splat writes one pixel of slab after slab: were they whole pages apart, all of these
 * would fall into the same few lines of the cache, and each load would wait for the store before it. */
static int64_t slab_stride(const tile *t) {
  return (int64_t)t->channels * FUM_TILE_PIXELS + WIDEST_LANES;
}

static float *slab_at(const tile *t, float *slabs, int32_t slab, int32_t pixel) {
  return slabs + (int64_t)(slab - t->first_slab) * slab_stride(t) + pixel;
}

static fum_vf vf_min(fum_vf a, fum_vf b) {
  return fum_vf_select(a < b, a, b);
}
static fum_vf vf_max(fum_vf a, fum_vf b) {
  return fum_vf_select(a > b, a, b);
}

/* What a far splat leaves in the slabs first to last: the share of each, and how it changes as the splat moves along
 * the view by one metre. */
static void find_shares(const tile *t, const fum_splat *s, float range, int32_t first, int32_t last, float *shares,
                        float *changes) {
  const fum_face *faces = t->job->slabs->faces;
  const float inverse_sigma = 1.0F / s->sigma;
  float before = 0.0F, density_before = 0.0F;
  for (int32_t j = first; j <= last; j++) {
    const float z = (faces[j + 1].range - range) * inverse_sigma;
    const float up_to = j == last ? 1.0F : 0.5F * erfcf(-0.70710678F * z);
    const float density = j == last ? 0.0F : 0.39894228F * inverse_sigma * expf(-0.5F * z * z);
    shares[j - first] = up_to - before;
    changes[j - first] = density_before - density;
    before = up_to;
    density_before = density;
  }
}

/* A splat far away against its size and clear of every cut. Rays that pass the centre at a distance d come nearest to
 * it d^2 / (2 range) before it, on average width^2 / range; to first order in what is left, all pixels have the same
 * shares. A widened splat stands for something small: it has its shares where it is. */
static void splat_far(const tile *t, const fum_splat *s, int32_t first, int32_t last, const float *look, float *slabs) {
  float shares[FUM_MAX_SLABS], changes[FUM_MAX_SLABS];
  const bool is_perspective = t->job->view->type == FUM_CAMERA_PERSPECTIVE;
  const float bend = is_perspective && !(s->width > s->sigma) ? 0.5F / s->range : 0.0F;
  const float mean_squared = 2.0F * s->width * s->width;
  find_shares(t, s, s->range - bend * mean_squared, first, last, shares, changes);
  const float depth = is_perspective ? -s->center[2] : 1.0F;
  const float uc = s->center[0] / depth, vc = s->center[1] / depth;
  const float falloff = -HALF_LOG2_E / (s->width * s->width);
  const patch p = find_patch(t, s);
  const int64_t stride = slab_stride(t);
  const bool is_uniform = t->channels == 1;
  for (int32_t y = p.y0; y < p.y1; y++) {
    const float e2 = (t->v[y] - vc) * depth;
    for (int32_t x = p.x0; x < p.x1; x += FUM_LANES) {
      const int32_t pixel = y * FUM_TILE + x;
      const fum_vf e1 = (fum_vf_load(t->u + x) - uc) * depth;
      fum_vf squared = e1 * e1 + e2 * e2;
      if (is_perspective) { /* |centre x ray| / |ray|, written without a difference of large numbers */
        const fum_vf e3 = e2 * uc - e1 * vc;
        const fum_vf inverse_length = fum_vf_load(t->inverse_length + pixel);
        squared = (squared + e3 * e3) * (inverse_length * inverse_length);
      }
      const fum_vf gauss = s->optical_depth * fum_vf_exp2(squared * falloff);
      const fum_vf moved = gauss * (bend * (mean_squared - squared));
      float *at = slab_at(t, slabs, first, pixel);
      for (int32_t j = 0; j <= last - first; j++, at += stride) {
        const fum_vf part = fum_vf_at_least(gauss * shares[j] + moved * changes[j], 0.0F);
        if (is_uniform) {
          fum_vf_store(at, fum_vf_load(at) + part);
        } else {
          deposit(t, at, part, look);
        }
      }
    }
  }
}

/* Any splat: every pixel's ray has its own nearest point and its own ends. */
static void splat_near(const tile *t, const fum_splat *s, int32_t first, int32_t last, const float *look,
                       float *slabs) {
  const fum_face *faces = t->job->slabs->faces;
  const bool is_perspective = t->job->view->type == FUM_CAMERA_PERSPECTIVE;
  const float *c = s->center, inverse_sigma = 1.0F / s->sigma;
  const float falloff = -HALF_LOG2_E / (s->width * s->width);
  const patch p = find_patch(t, s);
  for (int32_t y = p.y0; y < p.y1; y++) {
    for (int32_t x = p.x0; x < p.x1; x += FUM_LANES) {
      const int32_t pixel = y * FUM_TILE + x;
      const fum_vf u = fum_vf_load(t->u + x), inverse_length = fum_vf_load(t->inverse_length + pixel);
      const float v = t->v[y];
      fum_vf nearest = fum_vf_set(-c[2]), squared = (u - c[0]) * (u - c[0]) + (v - c[1]) * (v - c[1]);
      if (is_perspective) {
        const fum_vf a = fum_vf_set(-c[1] - c[2] * v), b = c[2] * u + c[0], d = c[0] * v - c[1] * u;
        squared = (a * a + b * b + d * d) * (inverse_length * inverse_length);
        nearest = (c[0] * u + c[1] * v - c[2]) * inverse_length;
      }
      const fum_vf gauss = s->optical_depth * fum_vf_exp2(vf_max(squared * falloff, fum_vf_set(-1000.0F)));
      const fum_vf near = fum_vf_load(t->near + pixel), far = vf_max(near, fum_vf_load(t->far + pixel));
      fum_vf begin = near;
      for (int32_t j = first; j <= last; j++) {
        const fum_vf end = j == last ? far : vf_max(begin, vf_min(fum_vf_set(faces[j + 1].range), far));
        const fum_vf share = fum_vf_normal_interval((begin - nearest) * inverse_sigma, (end - nearest) * inverse_sigma);
        deposit(t, slab_at(t, slabs, j, pixel), gauss * share, look);
        begin = end;
      }
    }
  }
}

/* Slabs that a splat reaches into. */
static void find_span(const tile *t, const fum_splat *s, int32_t *first, int32_t *last) {
  const fum_slabs *slabs = t->job->slabs;
  const float reach = s->reach + 0.5F * s->width * s->width * 16.0F / fum_max(s->range, s->width);
  *first = fum_slab_at(slabs, (double)(s->range - reach));
  *last = fum_slab_at(slabs, (double)(s->range + reach));
}

static void add_splats(const tile *t, const uint32_t *indices, int64_t count, float *slabs) {
  const float far_away =
      30.0F; /* widths: the range shifts by less than 0.2 of a sigma where the Gaussian still matters */
  const bool is_perspective = t->job->view->type == FUM_CAMERA_PERSPECTIVE;
  float look[MAX_LOOK];
  for (int64_t n = 0; n < count; n++) {
    const fum_splat *s = &t->job->splats->splats[indices[n]];
    int32_t first, last;
    find_span(t, s, &first, &last);
    find_look(t->job, indices[n], s->self_shade, look);
    const float reach = 1.125F * s->reach;
    const bool is_clear = s->range - reach > t->farthest_near && s->range + reach < t->nearest_far;
    const bool is_far = !is_perspective || (-s->center[2] > far_away * s->width && s->range > far_away * s->sigma);
    (is_clear && is_far ? splat_far : splat_near)(t, s, first, last, look, slabs);
  }
}

/* (1 - exp(-x)) / x */
static fum_vf mean_attenuation(fum_vf x) {
  const fum_vf clamped = vf_max(x, fum_vf_set(-60.0F)), magnitude = fum_vf_abs(clamped);
  const fum_vf series =
      1.0F - clamped * (0.5F - clamped * (0.16666667F - clamped * (0.041666668F - clamped * 0.008333334F)));
  /* exp of -|x| only; for x < 0, (exp(|x|) - 1) / |x| = exp(|x|) (1 - exp(-|x|)) / |x| */
  const fum_vf decay = fum_vf_exp2(magnitude * -1.44269504F);
  const fum_vf safe = vf_max(magnitude, fum_vf_set(1e-3F));
  const fum_vf plain = (1.0F - decay) / safe;
  const fum_vf value = fum_vf_select(clamped < 0.0F, plain / vf_max(decay, fum_vf_set(1e-30F)), plain);
  return fum_vf_select(magnitude < 0.1F, series, value);
}

/* Pixels' sums so far, front to back. */
typedef struct sums {
  float depth[FUM_TILE_PIXELS]; /* optical depth in front */
  float rgb[3][FUM_TILE_PIXELS];
} sums;

/* One light in one slab: its optical depth runs linearly from face to face, and so does the slab's own, hence
 * the integral of exp(-front - s D) exp(-t0 - s (t1 - t0)) over s is exp(-front - t0) (1 - exp(-D - t1 + t0)) / (D + t1
 * - t0). */
static void add_light(const tile *t, const float *slab, const fum_slab_light *light, sums *out) {
  const fum_tile_job *job = t->job;
  for (int32_t i = 0; i < FUM_TILE_PIXELS; i += FUM_LANES) {
    const fum_vf depth = fum_vf_load(slab + i), front = fum_vf_load(out->depth + i);
    const fum_vf begin = fum_vf_load(light->begin + i), end = fum_vf_load(light->end + i);
    const fum_vf attenuation = fum_vf_exp2(vf_min(front + begin, fum_vf_set(80.0F)) * -1.44269504F);
    const fum_vf mean = attenuation * mean_attenuation(depth + end - begin);
    for (int32_t k = 0; k < job->class_count; k++) {
      const fum_vf strength = mean * fum_vf_load(light->strengths[k] + i);
      for (int c = 0; c < 3; c++) {
        const fum_vf scattering = job->is_uniform ? depth * job->albedo[c]
                                                  : fum_vf_load(slab + (int64_t)(1 + 3 * k + c) * FUM_TILE_PIXELS + i);
        fum_vf_store(out->rgb[c] + i, fum_vf_load(out->rgb[c] + i) + strength * scattering * light->color[c]);
      }
    }
  }
}

static void add_glow(const tile *t, const float *slab, sums *out) {
  const float *glow = slab + (int64_t)(1 + 3 * t->job->class_count) * FUM_TILE_PIXELS;
  for (int32_t i = 0; i < FUM_TILE_PIXELS; i += FUM_LANES) {
    const fum_vf depth = fum_vf_load(slab + i), front = fum_vf_load(out->depth + i);
    const fum_vf mean = fum_vf_exp2(vf_min(front, fum_vf_set(80.0F)) * -1.44269504F) * mean_attenuation(depth);
    for (int c = 0; c < 3; c++) {
      const fum_vf emitted = fum_vf_load(glow + (int64_t)c * FUM_TILE_PIXELS + i);
      fum_vf_store(out->rgb[c] + i, fum_vf_load(out->rgb[c] + i) + mean * emitted);
    }
  }
}

/* Is any pixel's smoke in this slab still seen? */
static bool shows(const float *slab, const sums *s) {
  for (int32_t i = 0; i < FUM_TILE_PIXELS; i++) {
    if (slab[i] > FUM_TILE_THIN && s->depth[i] < FUM_TILE_DARK) return true;
  }
  return false;
}

static void resolve(const tile *t, const float *slabs, fum_tile_held *held, sums *s) {
  const fum_tile_job *job = t->job;
  const fum_light_grid grid = {job, t->u, t->v, t->inverse_length, t->near, t->far};
  const int64_t stride = slab_stride(t);
  fum_slab_light light;
  for (int32_t l = 0; l < job->lattice->light_count; l++) {
    for (int k = 0; k < 4; k++)
      held[l].faces[k] = FUM_NO_FACE;
  }
  for (int32_t k = 0; k < t->slab_count; k++) {
    const float *slab = slabs + k * stride;
    if (!shows(slab, s)) continue;
    const fum_slab_smoke smoke = {.index = t->first_slab + k,
                                  .depth = slab,
                                  .before = k > 0 ? slab - stride : NULL,
                                  .next = k + 1 < t->slab_count ? slab + stride : NULL,
                                  .front = s->depth};
    for (int32_t l = 0; l < job->lattice->light_count; l++) {
      fum_tile_light_slab(&grid, l, &smoke, &held[l], &light);
      add_light(t, slab, &light, s);
    }
    if (job->glows) add_glow(t, slab, s);
    for (int32_t i = 0; i < FUM_TILE_PIXELS; i++)
      s->depth[i] += slab[i];
  }
}

static void write_pixels(const tile *t, const sums *s) {
  const fum_view *view = t->job->view;
  for (int32_t y = 0; y < FUM_TILE && t->y0 + y < view->height; y++) {
    for (int32_t x = 0; x < FUM_TILE && t->x0 + x < view->width; x++) {
      float *rgba = t->job->rgba + 4 * ((int64_t)(t->y0 + y) * view->width + t->x0 + x);
      for (int c = 0; c < 3; c++)
        rgba[c] = s->rgb[c][y * FUM_TILE + x];
      rgba[3] = -expm1f(-s->depth[y * FUM_TILE + x]);
    }
  }
}

/* Finds the slabs that the tile's splats reach into and clears room for them. */
static bool make_room(tile *t, const uint32_t *indices, int64_t count, fum_tile_scratch *scratch) {
  int32_t low = INT32_MAX, high = -1;
  for (int64_t n = 0; n < count; n++) {
    int32_t first, last;
    find_span(t, &t->job->splats->splats[indices[n]], &first, &last);
    low = first < low ? first : low;
    high = last > high ? last : high;
  }
  t->first_slab = low;
  t->slab_count = high - low + 1;
  const int64_t size = t->slab_count * slab_stride(t);
  if (size > scratch->slabs_size) {
    free(scratch->slabs);
    scratch->slabs = aligned_alloc(64, (size_t)size * sizeof(float));
    scratch->slabs_size = scratch->slabs != NULL ? size : 0;
  }
  if (scratch->slabs == NULL) {
    scratch->is_out_of_memory = true;
    return false;
  }
  memset(scratch->slabs, 0, (size_t)size * sizeof(float));
  return true;
}

void FUM_TILE_NAME(const fum_tile_job *job, int64_t index, fum_tile_scratch *scratch) {
  const fum_splats *splats = job->splats;
  const uint32_t *indices = splats->tile_splats + splats->tile_begins[index];
  const int64_t count = splats->tile_begins[index + 1] - splats->tile_begins[index];
  if (count == 0) return;
  tile t = {.job = job,
            .x0 = (int32_t)(index % splats->columns) * FUM_TILE,
            .y0 = (int32_t)(index / splats->columns) * FUM_TILE,
            .channels = job->is_uniform ? 1 : 1 + 3 * job->class_count + (job->glows ? 3 : 0)};
  if (!make_room(&t, indices, count, scratch)) return;
  aim(&t);
  add_splats(&t, indices, count, scratch->slabs);
  sums s = {0};
  resolve(&t, scratch->slabs, scratch->held, &s);
  write_pixels(&t, &s);
}
