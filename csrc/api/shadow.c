/* SPDX-License-Identifier: GPL-3.0-or-later */
#include "api/shadow.h"

#include "api/surface_light.h"
#include "pass/places.h"

/* Light that reaches the solid in each pixel, through smoke and without. Sums over places in the pixel, so that places
 * count as much as they are lit. */
typedef struct sums {
  const fum_rendering *r;
  float *smoky, *clear; /* [pixels][channels]: red, green and blue of all lights, then those of each light asked for */
  int32_t channels;
} sums;

/* Channels of its own that a light asked for has: what an environment sends has many colours. */
static int32_t own_channels(const fum_rendering *r, int32_t light) {
  if (r->light_shadows[light] == NULL) return 0;
  return r->scene->lights[light].desc.type == FUM_LIGHT_ENVIRONMENT ? 3 : 1;
}

static int64_t pixel_count(const fum_rendering *r) {
  return (int64_t)r->view.width * r->view.height;
}

static float share_of(const sums *s, int64_t pixel, int32_t channel) {
  const float clear = s->clear[pixel * s->channels + channel];
  return clear > 0.0F ? s->smoky[pixel * s->channels + channel] / clear : 1.0F;
}

/* fum_surface_light_fn */
static void add_light(void *user, const fum_lamp *lamp, const fum_surfaces *surfaces, const uint32_t *points,
                      const float *smoky, const float *clear) {
  sums *s = user;
  const float *color = lamp->color;
  const int32_t own_count = own_channels(s->r, lamp->light);
  int32_t own = 3;
  for (int32_t l = 0; l < lamp->light; l++)
    own += own_channels(s->r, l);
  for (int64_t i = 0; i < surfaces->count; i++) {
    const int64_t at = (int64_t)surfaces->pixels[points[i]] * s->channels;
    for (int c = 0; c < 3; c++) {
      s->smoky[at + c] += color[c] * smoky[i];
      s->clear[at + c] += color[c] * clear[i];
    }
    for (int32_t c = 0; c < own_count; c++) {
      const float weight = own_count == 3 ? color[c] : 1.0F;
      s->smoky[at + own + c] += weight * smoky[i];
      s->clear[at + own + c] += weight * clear[i];
    }
  }
}

static int32_t add_places(const fum_rendering *r, int64_t count, const uint32_t *pixels, bool is_middle, sums *s) {
  fum_surfaces surfaces = {0};
  int32_t status =
      fum_surfaces_find(r->context, r->scene->caches->solids, &r->view, count, pixels, is_middle, &surfaces);
  if (status == FUM_OK && surfaces.count > 0) status = fum_surface_light_find(r, &surfaces, add_light, s);
  fum_surfaces_free(r->context, &surfaces);
  return status;
}

/* Does a channel bend so much across a pixel that its centre doesn't stand for it? Slopes even out. */
static bool is_rough(const fum_rendering *r, const sums *s, int32_t x, int32_t y) {
  const float smooth = 0.25F * r->settings.tolerance;
  const int64_t pixel = (int64_t)y * r->view.width + x;
  int64_t steps[FUM_STEPS];
  fum_steps_around(&r->view, x, y, steps);
  for (int32_t c = 0; c < s->channels; c++) {
    const float here = share_of(s, pixel, c);
    for (int k = 0; k < FUM_STEPS; k++) {
      const float before = share_of(s, pixel - steps[k], c), behind = share_of(s, pixel + steps[k], c);
      if (fabsf(before - 2.0F * here + behind) > smooth) return true;
    }
  }
  return false;
}

/* Edges of solids and of shadows are looked at anew, in several places a pixel. */
static int32_t refine(const fum_rendering *r, uint32_t *pixels, sums *s) {
  int64_t count = 0;
  for (int64_t i = 0; i < pixel_count(r); i++) {
    if (is_rough(r, s, (int32_t)(i % r->view.width), (int32_t)(i / r->view.width))) pixels[count++] = (uint32_t)i;
  }
  for (int64_t n = 0; n < count; n++) {
    for (int32_t c = 0; c < s->channels; c++)
      s->smoky[(int64_t)pixels[n] * s->channels + c] = s->clear[(int64_t)pixels[n] * s->channels + c] = 0.0F;
  }
  return count > 0 ? add_places(r, count, pixels, false, s) : FUM_OK;
}

static void write_shares(fum_rendering *r, const sums *s) {
  for (int64_t i = 0; i < pixel_count(r); i++) {
    int32_t channel = 3;
    for (int c = 0; c < 3 && r->shadow != NULL; c++)
      r->shadow[3 * i + c] = share_of(s, i, c);
    for (int32_t l = 0; l < r->scene->light_count; l++) {
      if (r->light_shadows[l] == NULL) continue;
      const int32_t own_count = own_channels(r, l);
      for (int c = 0; c < 3; c++)
        r->light_shadows[l][3 * i + c] = share_of(s, i, channel + (own_count == 3 ? c : 0));
      channel += own_count;
    }
  }
}

int32_t fum_shadow_find(fum_rendering *r) {
  fum_context *context = r->context;
  uint32_t *pixels = NULL;
  sums s = {.r = r, .channels = 3};
  for (int32_t l = 0; l < r->scene->light_count; l++)
    s.channels += own_channels(r, l);
  int32_t status = fum_alloc(context, pixel_count(r), sizeof *pixels, "shadows of smoke", &pixels);
  const size_t entry = (size_t)s.channels * sizeof(float);
  if (status == FUM_OK) status = fum_alloc(context, pixel_count(r), entry, "shadows of smoke", &s.smoky);
  if (status == FUM_OK) status = fum_alloc(context, pixel_count(r), entry, "shadows of smoke", &s.clear);
  if (status != FUM_OK) goto done;
  for (int64_t i = 0; i < pixel_count(r); i++)
    pixels[i] = (uint32_t)i;
  if (r->scene->caches->solids != NULL) status = add_places(r, pixel_count(r), pixels, true, &s);
  if (status == FUM_OK && r->scene->caches->solids != NULL) status = refine(r, pixels, &s);
  if (status == FUM_OK) write_shares(r, &s);
done:
  fum_free(context, &s.clear);
  fum_free(context, &s.smoky);
  fum_free(context, &pixels);
  return status;
}
