/* SPDX-License-Identifier: GPL-3.0-or-later */
#include "api/smeared_parts.h"

#include <string.h>

/* Radiance that an opaque particle shows: of one light, or with `light` NULL what it emits. */
static void find_sources(const fum_rendering *r, const float *light, float thinnest, float *out_values) {
  const fum_octree *all = r->scene->caches->all;
#pragma omp parallel for num_threads(fum_thread_count(r->context)) schedule(static)
  for (int64_t rank = 0; rank < all->count; rank++) {
    const fum_particles *set = fum_scene_particles_of(r->scene, all->indices[rank]);
    const int64_t i = all->indices[rank] - set->offset;
    const float *albedo = set->albedos != NULL ? set->albedos + 3 * i : set->albedo;
    const float *emission = set->emissions != NULL ? set->emissions + 3 * i : set->emission;
    const float density = fum_max(set->densities[i], thinnest / (set->sigmas[i] * (float)FUM_SQRT_2PI));
    for (int c = 0; c < 3; c++) {
      const float glow = density > 0.0F ? emission[c] / density : 0.0F;
      out_values[3 * rank + c] = light != NULL ? albedo[c] * light[3 * rank + c] : glow;
    }
  }
}

int32_t fum_smeared_parts_make(fum_rendering *r, float *const *by_light, float thinnest, fum_draw_values_fn draw_values,
                               void *user) {
  const int64_t pixels = (int64_t)r->view.width * r->view.height;
  float *values = NULL, *rgba = NULL;
  int32_t status = fum_alloc(r->context, r->scene->caches->all->count, 3 * sizeof *values, "passes", &values);
  if (status == FUM_OK) status = fum_alloc(r->context, pixels, 4 * sizeof *rgba, "passes", &rgba);
  for (int32_t l = -1; l < r->scene->light_count && status == FUM_OK; l++) {
    float *out = l < 0 ? r->emission : r->lights[l];
    if (out == NULL) continue;
    find_sources(r, l < 0 ? NULL : by_light[l], thinnest, values);
    memset(rgba, 0, 4 * (size_t)pixels * sizeof *rgba);
    status = draw_values(user, values, true, rgba);
    for (int64_t i = 0; i < 3 * pixels && status == FUM_OK; i++)
      out[i] = rgba[i / 3 * 4 + i % 3];
  }
  fum_free(r->context, &rgba);
  fum_free(r->context, &values);
  return status;
}
