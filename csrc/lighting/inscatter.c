/* SPDX-License-Identifier: GPL-3.0-or-later */
#include "lighting/inscatter.h"

#include "lighting/phase.h"

#include <string.h>

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

int32_t fum_inscatter(const fum_scene *scene, const fum_gathering *gathering, const fum_lamps *lamps,
                      const fum_viewpoint *viewpoint, float *const *by_light, float *out_light) {
  fum_context *context = scene->context;
  const fum_octree *octree = gathering->receivers->octree;
  viewer who = {0, scene, octree, viewpoint};
  fum_gathering g = *gathering;
  g.response = respond;
  g.response_user = &who;
  g.viewpoint = viewpoint;
  const int32_t total_samples = fum_lamps_sample_count(lamps);
  int32_t samples_done = 0;
  float *factors = NULL;
  int32_t status = fum_alloc(context, octree->count, sizeof *factors, "lighting", &factors);
  for (fum_lamp_walk walk = {0}; fum_lamps_walk(lamps, &walk) && status == FUM_OK;) {
    const float *color = walk.lamp.color;
    float *own = by_light != NULL ? by_light[walk.lamp.light] : NULL, *out = own != NULL ? own : out_light;
    const float from = (float)samples_done / (float)total_samples;
    samples_done += walk.lamp.sample_count;
    if (!walk.lamp.lights_smoke || (color[0] <= 0.0F && color[1] <= 0.0F && color[2] <= 0.0F)) continue;
    who.light_sets = walk.lamp.desc.light_sets;
    memset(factors, 0, (size_t)octree->count * sizeof *factors);
    status = fum_gather_light(&g, &walk.lamp, (float[2]){from, (float)samples_done / (float)total_samples}, factors);
    if (status != FUM_OK) break;
#pragma omp parallel for num_threads(fum_thread_count(context)) schedule(static)
    for (int64_t i = 0; i < octree->count; i++) {
      for (int c = 0; c < 3; c++)
        out[3 * i + c] += color[c] * factors[i];
    }
  }
  fum_free(context, &factors);
  return status;
}
