/* SPDX-License-Identifier: GPL-3.0-or-later */
/* The loops of tile.h, to be compiled once for each instruction set: tile_*.c define FUM_LANES and FUM_TILE_NAME. */
#include "billboard/deep.h"
#include "billboard/tile_light_loop.h"
#include "billboard/tile_smear_loop.h"
#include "billboard/tile_splats_loop.h"

#include <stdlib.h>

/* (1 - exp(-x)) / x */
static fum_vf mean_attenuation(fum_vf x) {
  const fum_vf clamped = fum_vf_max(x, fum_vf_set(-60.0F)), magnitude = fum_vf_abs(clamped);
  const fum_vf series =
      1.0F - clamped * (0.5F - clamped * (0.16666667F - clamped * (0.041666668F - clamped * 0.008333334F)));
  /* exp of -|x| only; for x < 0, (exp(|x|) - 1) / |x| = exp(|x|) (1 - exp(-|x|)) / |x| */
  const fum_vf decay = fum_vf_exp2(magnitude * -1.44269504F);
  const fum_vf safe = fum_vf_max(magnitude, fum_vf_set(1e-3F));
  const fum_vf plain = (1.0F - decay) / safe;
  const fum_vf value = fum_vf_select(clamped < 0.0F, plain / fum_vf_max(decay, fum_vf_set(1e-30F)), plain);
  return fum_vf_select(magnitude < 0.1F, series, value);
}

/* Pixels' sums so far, front to back. */
typedef struct sums {
  float depth[FUM_TILE_PIXELS]; /* optical depth in front */
  fum_tile_rgb rgb;             /* of what isn't asked for by itself */
} sums;

/* One light in one slab: its optical depth runs linearly from face to face, and so does the slab's own, hence
 * the integral of exp(-front - s D) exp(-t0 - s (t1 - t0)) over s is exp(-front - t0) (1 - exp(-D - t1 + t0)) / (D + t1
 * - t0). */
static void add_light(const tile *t, const float *slab, const fum_slab_light *light, const float *fronts,
                      fum_tile_rgb *out) {
  const fum_tile_job *job = t->job;
  for (int32_t i = 0; i < FUM_TILE_PIXELS; i += FUM_LANES) {
    const fum_vf depth = fum_vf_load(slab + i), front = fum_vf_load(fronts + i);
    const fum_vf begin = fum_vf_load(light->begin + i), end = fum_vf_load(light->end + i);
    const fum_vf attenuation = fum_vf_exp2(fum_vf_min(front + begin, fum_vf_set(80.0F)) * -1.44269504F);
    const fum_vf mean = attenuation * mean_attenuation(depth + end - begin);
    for (int32_t k = 0; k < job->class_count; k++) {
      const fum_vf strength = mean * fum_vf_load(light->strengths[k] + i);
      for (int c = 0; c < 3; c++) {
        const fum_vf scattering = job->is_uniform ? depth * job->albedo[c]
                                                  : fum_vf_load(slab + (int64_t)(1 + 3 * k + c) * FUM_TILE_PIXELS + i);
        fum_vf_store(out->of[c] + i, fum_vf_load(out->of[c] + i) + strength * scattering * light->color[c]);
      }
    }
  }
}

static void add_glow(const tile *t, const float *slab, const float *fronts, fum_tile_rgb *out) {
  const float *glow = slab + (int64_t)(1 + 3 * t->job->class_count) * FUM_TILE_PIXELS;
  for (int32_t i = 0; i < FUM_TILE_PIXELS; i += FUM_LANES) {
    const fum_vf depth = fum_vf_load(slab + i), front = fum_vf_load(fronts + i);
    const fum_vf mean = fum_vf_exp2(fum_vf_min(front, fum_vf_set(80.0F)) * -1.44269504F) * mean_attenuation(depth);
    for (int c = 0; c < 3; c++) {
      const fum_vf emitted = fum_vf_load(glow + (int64_t)c * FUM_TILE_PIXELS + i);
      fum_vf_store(out->of[c] + i, fum_vf_load(out->of[c] + i) + mean * emitted);
    }
  }
}

/* Is any pixel's smoke in this slab still seen? */
static bool shows(const float *slab, const sums *s) {
  for (int32_t i = 0; i < FUM_TILE_PIXELS; i += FUM_LANES) {
    const fum_vi seen = (fum_vf_load(slab + i) > FUM_TILE_THIN) & (fum_vf_load(s->depth + i) < FUM_TILE_DARK);
    if (fum_vi_bits(seen) != 0) return true;
  }
  return false;
}

/* Where a light's radiance is added up; that of emission where `light` is the number of lights. */
static fum_tile_rgb *part_of(const fum_tile_job *job, int32_t light, fum_tile_rgb *parts, sums *s) {
  const bool is_light = light < job->scene->light_count;
  const float *own = is_light ? (job->light_rgb != NULL ? job->light_rgb[light] : NULL) : job->emission;
  return own != NULL ? &parts[light] : &s->rgb;
}

/* Notes the sums behind a slab for deep pixels. */
static void note_depth(const tile *t, int32_t slab, const fum_tile_scratch *scratch, sums *s) {
  fum_tile_rgb *rgb = fum_deep_note(scratch->deep, slab, s->depth);
  *rgb = s->rgb;
  for (int32_t l = 0; l <= t->job->scene->light_count; l++) {
    const fum_tile_rgb *part = part_of(t->job, l, scratch->parts, s);
    for (int c = 0; c < 3 && part != &s->rgb; c++) {
      for (int32_t i = 0; i < FUM_TILE_PIXELS; i++)
        rgb->of[c][i] += part->of[c][i];
    }
  }
}

static void resolve(const tile *t, const float *slabs, const fum_tile_scratch *scratch, sums *s) {
  const fum_tile_job *job = t->job;
  const fum_light_grid grid = {job, t->columns, t->rows, t->u, t->v, t->inverse_length, t->near, t->far};
  const int64_t stride = slab_stride(t);
  fum_slab_light light;
  const int32_t lights = job->scene->light_count, lamps = job->lattice->lamp_count;
  fum_tile_held *held = scratch->held;
  for (int32_t l = 0; l <= lights; l++) {
    fum_tile_rgb *part = part_of(job, l, scratch->parts, s);
    if (part != &s->rgb) *part = (fum_tile_rgb){0};
  }
  for (int32_t l = 0; l < lamps; l++)
    begin_lamp(&grid, &job->lamps->items[l], &held[l]);
  for (int32_t k = 0; k < t->slab_count; k++) {
    const float *slab = slabs + k * stride;
    if (!shows(slab, s)) continue;
    const fum_slab_smoke smoke = {.index = t->first_slab + k,
                                  .depth = slab,
                                  .before = k > 0 ? slab - stride : NULL,
                                  .next = k + 1 < t->slab_count ? slab + stride : NULL,
                                  .front = s->depth};
    for (int32_t l = 0; l < lamps; l++) {
      if (!job->lamps->items[l].lights_smoke) continue;
      light_slab(&grid, l, &smoke, &held[l], &light);
      add_light(t, slab, &light, s->depth, part_of(job, job->lamps->items[l].light, scratch->parts, s));
    }
    if (job->glows) add_glow(t, slab, s->depth, part_of(job, lights, scratch->parts, s));
    for (int32_t i = 0; i < FUM_TILE_PIXELS; i++)
      s->depth[i] += slab[i];
    if (job->deep != NULL) note_depth(t, t->first_slab + k, scratch, s);
  }
}

static void write_part(const tile *t, const fum_tile_rgb *part, float *out, int32_t stride) {
  const fum_view *view = t->job->view;
  for (int32_t y = 0; y < FUM_TILE && t->y0 + y < view->height; y++) {
    for (int32_t x = 0; x < FUM_TILE && t->x0 + x < view->width; x++) {
      float *rgb = out + stride * ((int64_t)(t->y0 + y) * view->width + t->x0 + x);
      const int32_t i = fum_tile_pixel(x, y);
      for (int c = 0; c < 3; c++)
        rgb[c] += t->weights[i] * part->of[c][i];
    }
  }
}

/* Adds the tile to the picture. Combined is the sum of its parts. */
static void write_pixels(const tile *t, const fum_tile_scratch *scratch, sums *s) {
  const fum_tile_job *job = t->job;
  const int32_t lights = job->scene->light_count;
  for (int32_t l = 0; l <= lights; l++) {
    const fum_tile_rgb *part = part_of(job, l, scratch->parts, s);
    if (part == &s->rgb) continue;
    write_part(t, part, l < lights ? job->light_rgb[l] : job->emission, 3);
    for (int c = 0; c < 3; c++) {
      for (int32_t i = 0; i < FUM_TILE_PIXELS; i++)
        s->rgb.of[c][i] += part->of[c][i];
    }
  }
  write_part(t, &s->rgb, job->rgba, 4);
  for (int32_t y = 0; y < FUM_TILE && t->y0 + y < job->view->height; y++) {
    for (int32_t x = 0; x < FUM_TILE && t->x0 + x < job->view->width; x++) {
      const int64_t pixel = (int64_t)(t->y0 + y) * job->view->width + t->x0 + x;
      const int32_t i = fum_tile_pixel(x, y);
      job->rgba[4 * pixel + 3] += t->weights[i] * -expm1f(-s->depth[i]);
      if (t->through != NULL) t->through[pixel] = expf(-s->depth[i]);
    }
  }
}

/* Finds the slabs that the tile's splats reach into and clears room for them. */
static bool make_room(tile *t, const uint32_t *indices, int64_t count, fum_tile_scratch *scratch) {
  int32_t low = INT32_MAX, high = -1;
  for (int64_t n = 0; n < count; n++) {
    const fum_splat *s = &t->job->splats->splats[indices[n]];
    if (n + BATCH < count) __builtin_prefetch(&t->job->splats->splats[indices[n + BATCH]].first_slab);
    low = s->first_slab < low ? s->first_slab : low;
    high = s->last_slab > high ? s->last_slab : high;
  }
  t->first_slab = low;
  t->slab_count = high - low + 1;
  const int64_t cleared = t->slab_count * slab_stride(t), size = cleared + (int64_t)t->slab_count * SHARES;
  if (size > scratch->slabs_size) {
    free(scratch->slabs);
    scratch->slabs = aligned_alloc(64, (size_t)size * sizeof(float));
    scratch->slabs_size = scratch->slabs != NULL ? size : 0;
  }
  if (scratch->slabs == NULL) {
    scratch->is_out_of_memory = true;
    return false;
  }
  memset(scratch->slabs, 0, (size_t)cleared * sizeof(float));
  t->shares = scratch->slabs + cleared;
  return true;
}

/* Weights of the pixels as the camera sees them up to the nearest solid, or beside it. False if all are 0. */
static bool weigh(tile *t, bool is_beside) {
  const fum_view *view = t->job->view;
  const float *shares = t->job->solid_shares;
  bool shows = !is_beside;
  for (int32_t y = 0; y < FUM_TILE; y++) {
    for (int32_t x = 0; x < FUM_TILE; x++) {
      const bool is_inside = t->x0 + x < view->width && t->y0 + y < view->height;
      const int64_t pixel = (int64_t)(t->y0 + y) * view->width + t->x0 + x;
      const float share = shares != NULL && is_inside ? shares[pixel] : 1.0F;
      t->weights[fum_tile_pixel(x, y)] = is_beside ? 1.0F - share : share;
      shows = shows || share < 1.0F;
    }
  }
  return shows;
}

static bool begin_deep(const tile *t, fum_tile_scratch *scratch) {
  const fum_deep_rays rays = {t->near, t->far, t->inverse_length, t->weights};
  const bool has_room = fum_deep_begin(scratch->deep, &rays, t->slab_count);
  scratch->is_out_of_memory = scratch->is_out_of_memory || !has_room;
  return has_room;
}

static void draw(tile *t, const uint32_t *indices, int64_t count, fum_tile_scratch *scratch) {
  if (!make_room(t, indices, count, scratch)) return;
  aim(t);
  if (t->job->deep != NULL && !begin_deep(t, scratch)) return;
  add_splats(t, indices, count, scratch->slabs);
  sums s = {0};
  resolve(t, scratch->slabs, scratch, &s);
  write_pixels(t, scratch, &s);
}

void FUM_TILE_NAME(const fum_tile_job *job, int64_t index, fum_tile_scratch *scratch) {
  const fum_splats *splats = job->splats;
  const uint32_t *indices = splats->tile_splats + splats->tile_begins[index];
  const int64_t count = splats->tile_begins[index + 1] - splats->tile_begins[index];
  if (count == 0) return;
  tile t = {.job = job,
            .x0 = (int32_t)(index % splats->columns) * FUM_TILE,
            .y0 = (int32_t)(index / splats->columns) * FUM_TILE,
            .solid_depths = job->solid_depths,
            .through = job->through[0],
            .channels = job->is_uniform ? 1 : 1 + 3 * job->class_count + (job->glows ? 3 : 0)};
  (void)weigh(&t, false);
  draw(&t, indices, count, scratch);
  if (job->solid_shares == NULL || !weigh(&t, true)) return;
  t.solid_depths = job->solid_behind;
  t.through = job->through[1];
  draw(&t, indices, count, scratch);
}
