/* SPDX-License-Identifier: GPL-3.0-or-later */
#include "base/vector.h"
#include "scene/scene.h"

#include <stdlib.h>
#include <string.h>

void fum_light_desc_init(fum_light_desc *desc) {
  *desc = (fum_light_desc){.struct_size = sizeof *desc,
                           .intensity = {1.0F, 1.0F, 1.0F},
                           .spot_angle = (float)(FUM_PI / 4.0),
                           .spot_blend = 0.15F,
                           .area_size = {1.0F, 1.0F},
                           .area_spread = (float)FUM_PI,
                           .casts_shadows = 1,
                           .light_sets = UINT64_MAX,
                           .shadow_sets = UINT64_MAX};
  for (int i = 0; i < 4; i++)
    desc->world_from_light[5 * i] = 1.0;
}

static int32_t check_range(fum_context *context, const char *name, const char *field, float value, float low,
                           float high) {
  if (value >= low && value <= high) return FUM_OK;
  return fum_fail(context, FUM_ERROR_ARGUMENT, "%s: %s %g is not within %g..%g", name, field, (double)value,
                  (double)low, (double)high);
}

static int32_t check_shape(fum_context *context, const fum_light_desc *d, const char *name) {
  const float tiny = 1e-6F, pi = 3.1415929F; /* the float just above pi is accepted */
  int32_t status = FUM_OK;
  if (d->type == FUM_LIGHT_POINT || d->type == FUM_LIGHT_SPOT) {
    status = check_range(context, name, "radius", d->radius, 0.0F, 1e18F);
  }
  if (status == FUM_OK && d->type == FUM_LIGHT_SPOT) {
    status = check_range(context, name, "spot_angle", d->spot_angle, tiny, pi);
    if (status == FUM_OK) status = check_range(context, name, "spot_blend", d->spot_blend, 0.0F, 1.0F);
  }
  if (status == FUM_OK && d->type == FUM_LIGHT_SUN)
    status = check_range(context, name, "sun_angle", d->sun_angle, 0.0F, pi);
  if (status == FUM_OK && d->type == FUM_LIGHT_AREA) {
    status = check_range(context, name, "area_spread", d->area_spread, tiny, pi);
    for (int axis = 0; axis < 2 && status == FUM_OK; axis++) {
      status = check_range(context, name, "area_size", d->area_size[axis], 0.0F, 1e18F);
    }
    if (status == FUM_OK && d->area_shape != FUM_AREA_RECTANGLE && d->area_shape != FUM_AREA_ELLIPSE) {
      status = fum_fail(context, FUM_ERROR_ARGUMENT, "%s: area_shape %d is unknown", name, (int)d->area_shape);
    }
  }
  return status;
}

static int32_t check_picture(fum_context *context, const fum_light_desc *d, const char *name) {
  const int32_t most = 16384, width = d->environment_width, height = d->environment_height;
  if (d->environment_pixels == NULL) return FUM_OK;
  if (width < 1 || height < 1 || width > most || height > most) {
    return fum_fail(context, FUM_ERROR_ARGUMENT, "%s: a picture of %d x %d pixels; each must be within 1..%d", name,
                    (int)width, (int)height, (int)most);
  }
  for (int64_t i = 0; i < 3 * (int64_t)width * height; i++) {
    const float value = d->environment_pixels[i];
    if (!(value >= 0.0F && isfinite(value))) {
      const int64_t pixel = i / 3;
      return fum_fail(context, FUM_ERROR_ARGUMENT,
                      "%s: the picture's pixel %lld, %lld holds %g, negative or not finite", name,
                      (long long)(pixel % width), (long long)(pixel / width), (double)value);
    }
  }
  return FUM_OK;
}

static int32_t check_desc(fum_context *context, const fum_light_desc *d, const char *name) {
  if (d->type < FUM_LIGHT_POINT || d->type > FUM_LIGHT_ENVIRONMENT) {
    return fum_fail(context, FUM_ERROR_ARGUMENT, "%s: light type %d is unknown", name, (int)d->type);
  }
  if (!fum_all_finite(d->world_from_light, 16)) {
    return fum_fail(context, FUM_ERROR_ARGUMENT, "%s: the matrix is not finite", name);
  }
  for (int c = 0; c < 3; c++) {
    if (!(d->intensity[c] >= 0.0F && isfinite(d->intensity[c]))) {
      return fum_fail(context, FUM_ERROR_ARGUMENT, "%s: intensity %g is negative or not finite", name,
                      (double)d->intensity[c]);
    }
  }
  double axis[3];
  const bool is_directed = d->type != FUM_LIGHT_POINT;
  for (int column = 0; is_directed && column < 3; column++) {
    if (!fum_matrix_axis(d->world_from_light, column, axis)) {
      return fum_fail(context, FUM_ERROR_ARGUMENT, "%s: the matrix has no scale along axis %d", name, column);
    }
  }
  return d->type == FUM_LIGHT_ENVIRONMENT ? check_picture(context, d, name) : check_shape(context, d, name);
}

/* A copy of an environment's picture, which `*out_pixels` owns; NULL where there is none. */
static int32_t copy_picture(fum_context *context, const fum_light_desc *d, const char *name, float **out_pixels) {
  *out_pixels = NULL;
  if (d->type != FUM_LIGHT_ENVIRONMENT || d->environment_pixels == NULL) return FUM_OK;
  const size_t bytes = 3 * sizeof(float) * (size_t)d->environment_width * (size_t)d->environment_height;
  *out_pixels = malloc(bytes);
  if (*out_pixels == NULL) {
    return fum_fail(context, FUM_ERROR_MEMORY, "%s: no memory for a picture of %d x %d pixels", name,
                    (int)d->environment_width, (int)d->environment_height);
  }
  memcpy(*out_pixels, d->environment_pixels, bytes);
  return FUM_OK;
}

int32_t fum_scene_add_light(fum_scene *scene, const fum_light_desc *desc) {
  fum_context *context = scene->context;
  if (desc == NULL || desc->struct_size < sizeof *desc) {
    return fum_fail(context, FUM_ERROR_ARGUMENT, "light: the description has no valid struct_size");
  }
  const char *name = desc->name != NULL ? desc->name : "light";
  float *pixels = NULL;
  int32_t status = check_desc(context, desc, name);
  if (status == FUM_OK) status = copy_picture(context, desc, name, &pixels);
  if (status != FUM_OK) return status;
  fum_light *grown = realloc(scene->lights, (size_t)(scene->light_count + 1) * sizeof *grown);
  if (grown != NULL) scene->lights = grown;
  char *copy = fum_copy_string(name);
  if (grown == NULL || copy == NULL) {
    free(copy);
    free(pixels);
    return fum_fail(context, FUM_ERROR_MEMORY, "%s: no memory for another light", name);
  }
  fum_light *light = &scene->lights[scene->light_count++];
  *light = (fum_light){.name = copy, .desc = *desc, .pixels = pixels};
  light->desc.name = NULL;
  light->desc.environment_pixels = pixels;
  return FUM_OK;
}

bool fum_scene_is_lit_alike(const fum_scene *scene, int32_t a, int32_t b) {
  for (int32_t i = 0; i < scene->light_count && a != b; i++) {
    const uint64_t sets = scene->lights[i].desc.light_sets;
    if (fum_has_set(sets, a) != fum_has_set(sets, b)) return false;
  }
  return true;
}

void fum_scene_clear_lights(fum_scene *scene) {
  for (int32_t i = 0; i < scene->light_count; i++) {
    free(scene->lights[i].name);
    free(scene->lights[i].pixels);
  }
  free(scene->lights);
  scene->lights = NULL;
  scene->light_count = 0;
}
