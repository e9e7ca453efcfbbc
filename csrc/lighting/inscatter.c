/* SPDX-License-Identifier: GPL-3.0-or-later */
#include "lighting/inscatter.h"

#include "lighting/phase.h"

/* Who looks at which particles. */
typedef struct viewer {
  bool are_alike;      /* the light shines on all particles, and all of them scatter evenly */
  uint64_t light_sets; /* of the light */
  const fum_scene *scene;
  const fum_octree *octree;
  const fum_viewpoint *viewpoint;
} viewer;

static float scatter(const viewer *v, const fum_emitter *emitter, const fum_particles *set, int64_t i) {
  const fum_octree *octree = v->octree;
  if (!fum_has_set(v->light_sets, set->light_set)) return 0.0F;
  if (set->anisotropy == 0.0F) return fum_phase(0.0F, 0.0F);
  const fum_vec3 point = {octree->x[i], octree->y[i], octree->z[i]};
  const fum_vec3 to_light = fum_emitter_way(emitter, point).direction;
  return fum_phase(set->anisotropy, -fum_dot(to_light, fum_direction_to_viewer(v->viewpoint, point)));
}

static void respond(const void *user, const fum_emitter *emitter, int64_t first, int64_t count, float *strengths) {
  const viewer *v = user;
  if (v->are_alike) {
    for (int64_t k = 0; k < count; k++)
      strengths[k] *= fum_phase(0.0F, 0.0F);
    return;
  }
  for (int64_t k = 0; k < count; k++) {
    const fum_particles *set = fum_scene_particles_of(v->scene, v->octree->indices[first + k]);
    strengths[k] *= scatter(v, emitter, set, first + k);
  }
}

static bool are_alike(const fum_scene *scene, uint64_t light_sets) {
  for (int32_t s = 0; s < scene->particles_count; s++) {
    const fum_particles *set = &scene->particles[s];
    if (set->anisotropy != 0.0F || !fum_has_set(light_sets, set->light_set)) return false;
  }
  return true;
}

int32_t fum_inscatter(const fum_scene *scene, const fum_gathering *gathering, const fum_lamps *lamps,
                      const fum_viewpoint *viewpoint, float *const *by_light, float *out_light) {
  viewer who = {.scene = scene, .octree = gathering->receivers->octree, .viewpoint = viewpoint};
  fum_gathering g = *gathering;
  g.response = respond;
  g.response_user = &who;
  g.viewpoint = viewpoint;
  const int32_t total_samples = fum_lamps_sample_count(lamps);
  const float *begun = NULL; /* the light by itself that the last lamp was of */
  bool is_lit = false;       /* out_light holds some */
  int32_t samples_done = 0, status = FUM_OK;
  for (fum_lamp_walk walk = {0}; fum_lamps_walk(lamps, &walk) && status == FUM_OK;) {
    const float *color = walk.lamp.color;
    float *own = by_light != NULL ? by_light[walk.lamp.light] : NULL;
    const float from = (float)samples_done / (float)total_samples;
    samples_done += walk.lamp.sample_count;
    if (!walk.lamp.lights_smoke || (color[0] <= 0.0F && color[1] <= 0.0F && color[2] <= 0.0F)) continue;
    who.light_sets = walk.lamp.desc.light_sets;
    who.are_alike = are_alike(scene, who.light_sets);
    const float progress[2] = {from, (float)samples_done / (float)total_samples};
    const bool adds = own != NULL ? own == begun : is_lit;
    status = fum_gather_light(&g, &walk.lamp, progress, adds, own != NULL ? own : out_light);
    begun = own != NULL ? own : begun;
    is_lit = is_lit || own == NULL;
  }
  return status;
}
