/* SPDX-License-Identifier: GPL-3.0-or-later */
#include "api/surface_light.h"

#include <string.h>

static bool has_size(const fum_light_desc *light) {
  if (light->type == FUM_LIGHT_SUN) return light->sun_angle > 0.0F; /* parts of environments are such */
  return light->type == FUM_LIGHT_AREA || light->radius > 0.0F;
}

/* Samples of a light past solids: each draws an edge of its own. */
static int32_t fine_samples(const fum_rendering *r, const fum_lamp *lamp) {
  const int32_t times = 4, most = 1024, wanted = r->settings.light_samples;
  const int32_t fine = !has_size(&lamp->desc) ? 1 : wanted < most / times ? times * wanted : most;
  return fine > lamp->sample_count ? fine : lamp->sample_count;
}

int32_t fum_surface_light_find(const fum_rendering *r, const fum_surfaces *surfaces, fum_surface_light_fn hear,
                               void *user) {
  fum_context *context = r->context;
  fum_octree *points = NULL;
  fum_lighting lighting = {0};
  float *smoky = NULL, *clear = NULL;
  int32_t status =
      fum_octree_build_points(context, r->scene->origin, surfaces->count, surfaces->positions, FUM_GROUP_SIZE, &points);
  if (status == FUM_OK) status = fum_lighting_begin(r->scene, &r->settings, points, &lighting);
  if (status == FUM_OK) status = fum_alloc(context, surfaces->count, sizeof *smoky, "light on solids", &smoky);
  if (status == FUM_OK) status = fum_alloc(context, surfaces->count, sizeof *clear, "light on solids", &clear);
  if (status != FUM_OK) goto done;
  fum_surface surface = {
      .points = points, .normals = surfaces->normals, .meshes = r->scene->meshes, .mesh_indices = surfaces->meshes};
  lighting.gathering.response = fum_surface_respond;
  lighting.gathering.response_user = &surface;
  const float total = (float)fum_lamps_sample_count(&lighting.lamps);
  int32_t done_samples = 0;
  for (fum_lamp_walk walk = {0}; fum_lamps_walk(&lighting.lamps, &walk) && status == FUM_OK;) {
    const fum_lamp *lamp = &walk.lamp;
    memset(smoky, 0, (size_t)surfaces->count * sizeof *smoky);
    memset(clear, 0, (size_t)surfaces->count * sizeof *clear);
    const float from = (float)done_samples / total;
    done_samples += lamp->sample_count;
    const float progress[2] = {from, (float)done_samples / total};
    surface.light_sets = lamp->desc.light_sets;
    status = fum_gather_on_surfaces(&lighting.gathering, lamp, fine_samples(r, lamp), progress, smoky, clear);
    if (status == FUM_OK) hear(user, lamp, surfaces, points->indices, smoky, clear);
  }
done:
  fum_free(context, &clear);
  fum_free(context, &smoky);
  fum_lighting_end(context, &lighting);
  fum_octree_destroy(context, points);
  return status;
}
