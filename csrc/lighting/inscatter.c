/* SPDX-License-Identifier: GPL-3.0-or-later */
#include "lighting/inscatter.h"

#include <string.h>

float fum_phase(float anisotropy, float cosine) {
  const float g = anisotropy, base = 1.0F + g * g - 2.0F * g * cosine;
  return (1.0F - g * g) / (4.0F * (float)FUM_PI * base * sqrtf(base));
}

/* Who looks at which particles. */
typedef struct viewer {
  uint64_t light_sets; /* of the light */
  const fum_scene *scene;
  const fum_octree *octree;
  const fum_viewpoint *viewpoint;
} viewer;

static float respond(const void *user, uint32_t receiver, fum_vec3 to_light) {
  const viewer *v = user;
  const fum_octree *octree = v->octree;
  const fum_particles *set = fum_scene_particles_of(v->scene, octree->indices[receiver]);
  const float anisotropy = set->anisotropy;
  if (!fum_has_set(v->light_sets, set->light_set)) return 0.0F;
  if (anisotropy == 0.0F) return fum_phase(0.0F, 0.0F);
  const fum_vec3 point = {octree->x[receiver], octree->y[receiver], octree->z[receiver]};
  const fum_vec3 to_camera = fum_direction_to_viewer(v->viewpoint, point);
  return fum_phase(anisotropy, -fum_dot(to_light, to_camera));
}

static bool lights_smoke(const fum_scene *scene, const fum_light_desc *light) {
  for (int32_t s = 0; s < scene->particles_count; s++) {
    const fum_particles *set = &scene->particles[s];
    if (set->count > 0 && set->is_visible_to_camera && fum_has_set(light->light_sets, set->light_set)) return true;
  }
  return false;
}

int32_t fum_lamps_find(const fum_scene *scene, const fum_octree *receivers, int32_t max_samples, fum_lamp **out_lamps) {
  fum_lamp *lamps = NULL;
  const int32_t status = fum_alloc(scene->context, scene->light_count, sizeof *lamps, "lights", &lamps);
  if (status != FUM_OK) return status;
  float bounds[6] = {0};
  if (receivers->node_count > 0) {
    memcpy(bounds, receivers->nodes[0].lower, 3 * sizeof(float));
    memcpy(bounds + 3, receivers->nodes[0].upper, 3 * sizeof(float));
  }
  for (int32_t i = 0; i < scene->light_count; i++) {
    fum_lamp_init(&scene->lights[i].desc, receivers->origin, bounds, max_samples, &lamps[i]);
    lamps[i].lights_smoke = lights_smoke(scene, &lamps[i].desc);
  }
  *out_lamps = lamps;
  return FUM_OK;
}

int32_t fum_inscatter(const fum_scene *scene, const fum_gathering *gathering, const fum_lamp *lamps,
                      const fum_viewpoint *viewpoint, float *out_light) {
  fum_context *context = scene->context;
  const fum_octree *octree = gathering->receivers->octree;
  viewer who = {0, scene, octree, viewpoint};
  fum_gathering g = *gathering;
  g.response = respond;
  g.response_user = &who;
  g.viewpoint = viewpoint;
  int32_t total_samples = 0, samples_done = 0;
  for (int32_t i = 0; i < scene->light_count; i++)
    total_samples += lamps[i].sample_count;
  float *factors = NULL;
  int32_t status = fum_alloc(context, octree->count, sizeof *factors, "lighting", &factors);
  for (int32_t light = 0; light < scene->light_count && status == FUM_OK; light++) {
    const float *color = lamps[light].desc.intensity;
    const float from = (float)samples_done / (float)total_samples;
    samples_done += lamps[light].sample_count;
    if (!lamps[light].lights_smoke || (color[0] <= 0.0F && color[1] <= 0.0F && color[2] <= 0.0F)) continue;
    who.light_sets = lamps[light].desc.light_sets;
    memset(factors, 0, (size_t)octree->count * sizeof *factors);
    status = fum_gather_light(&g, &lamps[light], (float[2]){from, (float)samples_done / (float)total_samples}, factors);
    if (status != FUM_OK) break;
#pragma omp parallel for num_threads(fum_thread_count(context)) schedule(static)
    for (int64_t i = 0; i < octree->count; i++) {
      for (int c = 0; c < 3; c++)
        out_light[3 * i + c] += color[c] * factors[i];
    }
  }
  fum_free(context, &factors);
  return status;
}
