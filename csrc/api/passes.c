/* SPDX-License-Identifier: GPL-3.0-or-later */
#include "api/passes.h"

#include "pass/table.h"

#include <stdio.h>
#include <string.h>

static int64_t pixel_count(const fum_rendering *r) {
  return (int64_t)r->view.width * r->view.height;
}

bool fum_pass_is_color(const fum_pass_info *info) {
  return strcmp(info->kind, "COLOR") == 0 && info->per != FUM_PER_RANKS;
}

bool fum_pass_is_by_channel(const fum_pass_info *info) {
  return fum_pass_is_color(info) || info->pass == FUM_PASS_VECTOR || info->pass == FUM_PASS_ERROR;
}

int32_t fum_pass_count(const fum_rendering *r, const fum_pass_info *info) {
  const int32_t counts[] = {
      [FUM_PER_PICTURE] = 1, [FUM_PER_LIGHT] = r->scene->light_count, [FUM_PER_RANKS] = FUM_MAX_RANK_PAIRS};
  return counts[info->per];
}

/* Parts of the light, and what asks the lattice. */
static bool needs_tiles(int32_t pass) {
  return pass == FUM_PASS_LIGHT || pass == FUM_PASS_EMISSION || pass == FUM_PASS_SOLID_SHADOW ||
         pass == FUM_PASS_LIGHT_SOLID_SHADOW || pass == FUM_PASS_ERROR;
}

/* Is it drawn with Combined? */
static bool is_drawn(int32_t pass) {
  return needs_tiles(pass) || pass == FUM_PASS_OPACITY || pass == FUM_PASS_ALBEDO || pass == FUM_PASS_VECTOR ||
         pass == FUM_PASS_CRYPTO_OBJECT || pass == FUM_PASS_HOLDOUT;
}

static int32_t check_pass(const fum_rendering *r, const fum_pass_buffer *wanted) {
  const fum_pass_info *info = fum_pass_find(wanted->pass);
  if (info == NULL) return fum_fail(r->context, FUM_ERROR_ARGUMENT, "pass %d is unknown", (int)wanted->pass);
  const int64_t needed = pixel_count(r) * info->channel_count;
  if (wanted->pixels == NULL || wanted->pixels_size != needed) {
    return fum_fail(r->context, FUM_ERROR_ARGUMENT, "pass %s: room for %lld floats was given, %lld are needed",
                    info->name, (long long)wanted->pixels_size, (long long)needed);
  }
  if (wanted->number < 0 || wanted->number >= fum_pass_count(r, info)) {
    return fum_fail(r->context, FUM_ERROR_ARGUMENT, "pass %s: number %d is not one of %d %s", info->name,
                    (int)wanted->number, (int)fum_pass_count(r, info),
                    info->per == FUM_PER_LIGHT ? "lights of the scene" : "that there are");
  }
  if (needs_tiles(wanted->pass) && r->settings.device == FUM_DEVICE_GL) {
    return fum_fail(r->context, FUM_ERROR_ARGUMENT, "pass %s: OpenGL draws all light at once; use the device tiles",
                    info->name);
  }
  return FUM_OK;
}

int32_t fum_passes_check(const fum_rendering *r, bool is_deep, int32_t pass_count, const fum_pass_buffer *passes) {
  if (is_deep && r->settings.device == FUM_DEVICE_GL) {
    return fum_fail(r->context, FUM_ERROR_ARGUMENT, "deep pixels: OpenGL keeps no depths; use the device tiles");
  }
  if (is_deep && pass_count == 0) return FUM_OK;
  if (pass_count < 1 || passes == NULL) return fum_fail(r->context, FUM_ERROR_ARGUMENT, "no pass was asked for");
  int32_t status = FUM_OK;
  for (int32_t i = 0; i < pass_count && status == FUM_OK; i++)
    status = check_pass(r, &passes[i]);
  return status;
}

float **fum_pass_place(fum_rendering *r, int32_t pass, int32_t number) {
  switch (pass) {
  case FUM_PASS_COMBINED:
    return &r->combined;
  case FUM_PASS_DEPTH:
    return &r->depth;
  case FUM_PASS_POSITION:
    return &r->position;
  case FUM_PASS_EMISSION:
    return &r->emission;
  case FUM_PASS_SHADOW:
    return &r->shadow;
  case FUM_PASS_HOLDOUT:
    return &r->holdout;
  case FUM_PASS_OPACITY:
    return &r->opacity;
  case FUM_PASS_DEPTH_FRONT:
    return &r->depth_front;
  case FUM_PASS_DEPTH_BACK:
    return &r->depth_back;
  case FUM_PASS_ALBEDO:
    return &r->albedo;
  case FUM_PASS_VECTOR:
    return &r->vector;
  case FUM_PASS_SOLID_SHADOW:
    return &r->solid_shadow;
  case FUM_PASS_ERROR:
    return &r->error;
  case FUM_PASS_CRYPTO_OBJECT:
    return &r->crypto[number];
  case FUM_PASS_LIGHT:
    return &r->lights[number];
  case FUM_PASS_LIGHT_SOLID_SHADOW:
    return &r->light_solid_shadows[number];
  default:
    return &r->light_shadows[number];
  }
}

int32_t fum_pass_allocate(fum_rendering *r, int32_t pass, int32_t number) {
  float **place = fum_pass_place(r, pass, number);
  const fum_pass_info *info = fum_pass_find(pass);
  if (*place != NULL) return FUM_OK;
  char what[64];
  snprintf(what, sizeof what, "pass %s", info->name);
  return fum_alloc(r->context, pixel_count(r), (size_t)info->channel_count * sizeof(float), what, place);
}

int32_t fum_passes_allocate_lists(fum_rendering *r) {
  const int32_t lights = r->scene->light_count;
  const char *what = "passes of lights";
  int32_t status = fum_alloc(r->context, lights, sizeof *r->lights, what, &r->lights);
  if (status == FUM_OK) status = fum_alloc(r->context, lights, sizeof *r->light_shadows, what, &r->light_shadows);
  if (status == FUM_OK)
    status = fum_alloc(r->context, lights, sizeof *r->light_solid_shadows, what, &r->light_solid_shadows);
  return status;
}

int32_t fum_passes_allocate(fum_rendering *r, int32_t pass_count, const fum_pass_buffer *passes) {
  int32_t status = fum_passes_allocate_lists(r);
  for (int32_t i = 0; i < pass_count && status == FUM_OK; i++) {
    const int32_t pass = passes[i].pass;
    status = fum_pass_allocate(r, pass, passes[i].number);
    if (status == FUM_OK && is_drawn(pass)) status = fum_pass_allocate(r, FUM_PASS_COMBINED, 0);
    for (; status == FUM_OK && pass == FUM_PASS_CRYPTO_OBJECT && r->crypto_count <= passes[i].number; r->crypto_count++)
      status = fum_pass_allocate(r, pass, r->crypto_count);
    if (status == FUM_OK && pass == FUM_PASS_POSITION) status = fum_pass_allocate(r, FUM_PASS_DEPTH, 0);
  }
  return status;
}

void fum_passes_free(fum_rendering *r) {
  const bool has_lists = r->lights != NULL && r->light_shadows != NULL && r->light_solid_shadows != NULL;
  fum_pass_info info;
  for (int32_t i = 0; fum_pass_get(i, &info) == FUM_OK; i++) {
    const int32_t count = info.per == FUM_PER_LIGHT && !has_lists ? 0 : fum_pass_count(r, &info);
    for (int32_t n = 0; n < count; n++)
      fum_free(r->context, fum_pass_place(r, info.pass, n));
  }
  for (int k = 0; k < 2; k++)
    fum_free(r->context, &r->through[k]);
  fum_free(r->context, &r->light_solid_shadows);
  fum_free(r->context, &r->light_shadows);
  fum_free(r->context, &r->lights);
}

void fum_passes_hand_over(fum_rendering *r, int32_t pass_count, const fum_pass_buffer *passes) {
  for (int32_t i = 0; i < pass_count; i++) {
    const float *from = *fum_pass_place(r, passes[i].pass, passes[i].number);
    memcpy(passes[i].pixels, from, (size_t)passes[i].pixels_size * sizeof *from);
  }
}
