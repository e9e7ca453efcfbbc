/* SPDX-License-Identifier: GPL-3.0-or-later */
#include "api/solids.h"

#include "api/surface_light.h"
#include "pass/places.h"

#include <string.h>

/* Channels of what is seen: radiance, share of the pixel that shaded solids take, share that holdouts take; then the
 * parts of the radiance that are asked for by themselves. */
enum { RADIANCE = 0, COVER = 3, HELD = 4, PARTS = 5 };

/* Solids as they are seen without the smoke in front: sums over places in the pixel, each counted with its share. */
typedef struct picture {
  const fum_rendering *r;
  float *layers[2]; /* [pixels][channels] of the nearer solid, and of what is beside it; NULL: no edges */
  int32_t channels;
  float share; /* of the pixel that a place stands for, of those being added */
} picture;

static int64_t pixel_count(const fum_rendering *r) {
  return (int64_t)r->view.width * r->view.height;
}

/* First channel of a light's part, or of emission's where `light` is the number of lights. */
static int32_t part_of(const fum_rendering *r, int32_t light) {
  int32_t channel = PARTS;
  for (int32_t l = 0; l < light; l++)
    channel += r->lights[l] != NULL ? 3 : 0;
  return channel;
}

static bool is_edge(const fum_rendering *r, int64_t pixel) {
  return r->solid.shares != NULL && r->solid.shares[pixel] < 1.0F;
}

/* What is kept of the part of the pixel in which the surface is seen. */
static float *layer_at(const picture *p, const fum_surfaces *surfaces, int64_t surface) {
  const int64_t pixel = surfaces->pixels[surface];
  const bool is_beside = is_edge(p->r, pixel) && surfaces->depths[surface] > p->r->solid.between[pixel];
  return p->layers[is_beside] + pixel * p->channels;
}

/* fum_surface_light_fn */
static void add_light(void *user, const fum_lamp *lamp, const fum_surfaces *surfaces, const uint32_t *points,
                      const float *smoky, const float *clear) {
  (void)clear;
  const picture *p = user;
  const fum_scene *scene = p->r->scene;
  const float *color = lamp->color;
  const bool is_asked = p->r->lights[lamp->light] != NULL;
  const int32_t part = part_of(p->r, lamp->light);
  for (int64_t i = 0; i < surfaces->count; i++) {
    const float *albedo = scene->meshes[surfaces->meshes[points[i]]].albedo;
    float *seen = layer_at(p, surfaces, points[i]);
    for (int c = 0; c < 3; c++) {
      const float radiance = p->share * smoky[i] * color[c] * albedo[c] / (float)FUM_PI;
      seen[RADIANCE + c] += radiance;
      if (is_asked) seen[part + c] += radiance;
    }
  }
}

/* Notes who is there and what shines by itself. */
static void add_presence(const picture *p, const fum_surfaces *surfaces) {
  const fum_rendering *r = p->r;
  const int32_t part = part_of(r, r->scene->light_count);
  for (int64_t i = 0; i < surfaces->count; i++) {
    const fum_mesh *mesh = &r->scene->meshes[surfaces->meshes[i]];
    const bool is_shaded = r->settings.solids == FUM_SOLIDS_SHADED && !mesh->is_holdout;
    float *seen = layer_at(p, surfaces, i);
    seen[is_shaded ? COVER : HELD] += p->share;
    for (int c = 0; c < 3 && is_shaded; c++) {
      seen[RADIANCE + c] += p->share * mesh->emission[c];
      if (r->emission != NULL) seen[part + c] += p->share * mesh->emission[c];
    }
  }
}

/* Leaves out the surfaces that reflect nothing. */
static void keep_lit(const fum_rendering *r, fum_surfaces *s) {
  int64_t n = 0;
  for (int64_t i = 0; i < s->count; i++) {
    const fum_mesh *mesh = &r->scene->meshes[s->meshes[i]];
    const bool is_black = !(mesh->albedo[0] > 0.0F || mesh->albedo[1] > 0.0F || mesh->albedo[2] > 0.0F);
    if (r->settings.solids != FUM_SOLIDS_SHADED || mesh->is_holdout || is_black) continue;
    for (int axis = 0; axis < 3; axis++) {
      s->positions[3 * n + axis] = s->positions[3 * i + axis];
      s->normals[3 * n + axis] = s->normals[3 * i + axis];
    }
    s->depths[n] = s->depths[i];
    s->meshes[n] = s->meshes[i];
    s->pixels[n++] = s->pixels[i];
  }
  s->count = n;
}

static int32_t add_places(picture *p, int64_t count, const uint32_t *pixels, bool is_middle) {
  const fum_rendering *r = p->r;
  fum_surfaces surfaces = {0};
  int32_t status =
      fum_surfaces_find(r->context, r->scene->caches->solids, &r->view, count, pixels, is_middle, &surfaces);
  if (status != FUM_OK) return status;
  p->share = is_middle ? 1.0F : 1.0F / (float)FUM_PLACES;
  add_presence(p, &surfaces);
  keep_lit(r, &surfaces);
  if (surfaces.count > 0) status = fum_surface_light_find(r, &surfaces, add_light, p);
  fum_surfaces_free(r->context, &surfaces);
  return status;
}

/* Does a channel bend so much across a pixel that its centre doesn't stand for it? The mean of what bends smoothly
 * differs by a twenty-fourth of the bend. */
static bool is_rough(const picture *p, int32_t x, int32_t y) {
  const fum_view *view = &p->r->view;
  const int64_t pixel = (int64_t)y * view->width + x;
  const float *here = p->layers[0] + pixel * p->channels;
  int64_t steps[FUM_STEPS];
  fum_steps_around(view, x, y, steps);
  for (int k = 0; k < FUM_STEPS; k++) {
    const float *before = here - steps[k] * p->channels, *behind = here + steps[k] * p->channels;
    for (int32_t c = 0; c < p->channels; c++) {
      const float smooth = p->r->settings.tolerance * fmaxf(here[c], fmaxf(before[c], behind[c]));
      if (fabsf(before[c] - 2.0F * here[c] + behind[c]) > smooth) return true;
    }
  }
  return false;
}

/* Edges of solids, of what they are painted with and of shadows are looked at anew, in several places a pixel. */
static int32_t refine(picture *p, uint32_t *pixels) {
  const fum_rendering *r = p->r;
  int64_t count = 0;
  for (int64_t i = 0; i < pixel_count(r); i++) {
    if (is_edge(r, i) || is_rough(p, (int32_t)(i % r->view.width), (int32_t)(i / r->view.width)))
      pixels[count++] = (uint32_t)i;
  }
  for (int64_t n = 0; n < count; n++) {
    for (int k = 0; k < 2 && p->layers[k] != NULL; k++)
      memset(p->layers[k] + (int64_t)pixels[n] * p->channels, 0, (size_t)p->channels * sizeof(float));
  }
  return count > 0 ? add_places(p, count, pixels, false) : FUM_OK;
}

static void add_part(float *part, int64_t pixel, float through, const float *radiance) {
  for (int c = 0; c < 3; c++)
    part[3 * pixel + c] += through * radiance[c];
}

/* Puts a layer behind the smoke in front of it. */
static void put_behind(fum_rendering *r, const picture *p, int layer) {
  const int32_t lights = r->scene->light_count;
  for (int64_t i = 0; i < pixel_count(r); i++) {
    const float *seen = p->layers[layer] + i * p->channels, through = r->through[layer][i];
    for (int c = 0; c <= COVER; c++)
      r->combined[4 * i + c] += through * seen[RADIANCE + c];
    for (int c = 0; c < 3 && r->holdout != NULL; c++)
      r->holdout[3 * i + c] += through * seen[HELD];
    for (int32_t l = 0; l < lights; l++) {
      if (r->lights[l] != NULL) add_part(r->lights[l], i, through, seen + part_of(r, l));
    }
    if (r->emission != NULL) add_part(r->emission, i, through, seen + part_of(r, lights));
  }
}

int32_t fum_solids_begin(fum_rendering *r) {
  const bool has_layers[2] = {r->solid.depths != NULL, r->solid.shares != NULL};
  const bool is_needed = r->settings.solids == FUM_SOLIDS_SHADED || r->holdout != NULL;
  int32_t status = FUM_OK;
  for (int k = 0; k < 2 && status == FUM_OK; k++) {
    if (!is_needed || !has_layers[k] || r->combined == NULL) continue;
    status = fum_alloc(r->context, pixel_count(r), sizeof(float), "solids behind smoke", &r->through[k]);
    for (int64_t i = 0; i < pixel_count(r) && status == FUM_OK; i++)
      r->through[k][i] = 1.0F;
  }
  return status;
}

int32_t fum_solids_compose(fum_rendering *r) {
  fum_context *context = r->context;
  if (r->through[0] == NULL) return FUM_OK;
  const double start_s = fum_now_s();
  const int32_t parts_end = part_of(r, r->scene->light_count);
  picture p = {.r = r, .channels = parts_end + (r->emission != NULL ? 3 : 0)};
  uint32_t *pixels = NULL;
  int32_t status = fum_alloc(context, pixel_count(r), sizeof *pixels, "solids in the picture", &pixels);
  for (int k = 0; k < 2 && status == FUM_OK; k++) {
    if (r->through[k] == NULL) continue;
    status =
        fum_alloc(context, pixel_count(r), (size_t)p.channels * sizeof(float), "solids in the picture", &p.layers[k]);
  }
  if (status != FUM_OK) goto done;
  for (int64_t i = 0; i < pixel_count(r); i++)
    pixels[i] = (uint32_t)i;
  status = add_places(&p, pixel_count(r), pixels, true);
  if (status == FUM_OK) status = refine(&p, pixels);
  for (int k = 0; k < 2 && status == FUM_OK && p.layers[k] != NULL; k++)
    put_behind(r, &p, k);
  r->stats.light_s += fum_now_s() - start_s;
done:
  fum_free(context, &p.layers[1]);
  fum_free(context, &p.layers[0]);
  fum_free(context, &pixels);
  return status;
}
