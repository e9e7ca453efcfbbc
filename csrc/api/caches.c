/* SPDX-License-Identifier: GPL-3.0-or-later */
#include "api/caches.h"

#include <stdlib.h>

/* Frees the media, and the octrees that they alone have. */
static void drop_media(fum_context *context, fum_caches *caches) {
  for (int32_t k = 0; k < caches->media.count; k++) {
    fum_medium_end(context, &caches->media.items[k]);
    if (caches->casters[k] != caches->all) fum_octree_destroy(context, caches->casters[k]);
  }
  free(caches->casters);
  free(caches->media.items);
  caches->casters = NULL;
  caches->media = (fum_media){0};
}

static void drop_octrees(fum_context *context, fum_caches *caches) {
  drop_media(context, caches);
  fum_octree_destroy(context, caches->all);
  caches->all = NULL;
}

void fum_scene_drop_caches(fum_scene *scene) {
  fum_caches *caches = scene->caches;
  if (caches == NULL) return;
  fum_channels_free(scene->context, &caches->channels);
  drop_octrees(scene->context, caches);
  if (!caches->borrows_solids) fum_solids_destroy(caches->solids);
  free(caches);
  scene->caches = NULL;
}

/* Is a set of particles among the casters, those of `shadow_sets`? NULL: among what the camera sees? */
static bool belongs(const fum_particles *set, const uint64_t *shadow_sets) {
  return shadow_sets != NULL ? fum_has_set(*shadow_sets, set->shadow_set) : set->is_visible_to_camera;
}

static int32_t build(fum_scene *scene, const fum_settings *settings, float subsampling, const uint64_t *shadow_sets,
                     fum_octree **out_octree) {
  bool *takes = malloc((size_t)scene->particles_count + 1);
  if (takes == NULL) return fum_fail(scene->context, FUM_ERROR_MEMORY, "no memory for the sets of particles");
  for (int32_t s = 0; s < scene->particles_count; s++)
    takes[s] = belongs(&scene->particles[s], shadow_sets);
  const fum_octree_options options = {settings->leaf_size, subsampling, takes};
  const int32_t status = fum_octree_build(scene, &options, out_octree);
  free(takes);
  return status;
}

/* Do the same particles block as the camera sees? */
static bool are_all_casters(const fum_scene *scene, uint64_t shadow_sets) {
  for (int32_t s = 0; s < scene->particles_count; s++) {
    const fum_particles *set = &scene->particles[s];
    if (set->count > 0 && belongs(set, NULL) != belongs(set, &shadow_sets)) return false;
  }
  return true;
}

static uint64_t find_present(const fum_scene *scene) {
  uint64_t present = 0;
  for (int32_t s = 0; s < scene->particles_count; s++) {
    const fum_particles *set = &scene->particles[s];
    if (set->count > 0 && set->shadow_set >= 0) present |= UINT64_C(1) << set->shadow_set;
  }
  return present;
}

/* Lists the choices of sets that the lights make; where none casts shadows, all. Returns how many. */
static int32_t list_choices(const fum_scene *scene, uint64_t present, uint64_t *out_choices) {
  int32_t count = 0;
  for (int32_t l = 0; l < scene->light_count; l++) {
    const fum_light_desc *light = &scene->lights[l].desc;
    int32_t k = 0;
    if (light->casts_shadows == 0) continue;
    while (k < count && out_choices[k] != (light->shadow_sets & present))
      k++;
    if (k == count) out_choices[count++] = light->shadow_sets & present;
  }
  if (count == 0) out_choices[count++] = present;
  return count;
}

/* Moves what was built for the same sets into place `k` of the new media. */
static bool take_over(fum_caches *from, fum_caches *to, int32_t k, uint64_t sets) {
  for (int32_t i = 0; i < from->media.count; i++) {
    if (from->casters[i] == NULL || from->media.items[i].sets != sets) continue;
    to->casters[k] = from->casters[i];
    to->media.items[k] = from->media.items[i];
    from->casters[i] = NULL;
    from->media.items[i] = (fum_medium){0};
    return true;
  }
  return false;
}

/* Octrees of what blocks the lights; those that are there already are kept. `out_has_built`: not all were. */
static int32_t find_casters(fum_scene *scene, const fum_settings *settings, bool *out_has_built) {
  fum_context *context = scene->context;
  fum_caches *caches = scene->caches;
  uint64_t *choices = malloc((size_t)(scene->light_count + 1) * sizeof *choices);
  fum_caches old = *caches, new = *caches;
  int32_t status = FUM_OK;
  if (choices == NULL) return fum_fail(context, FUM_ERROR_MEMORY, "no memory for the scene's caches");
  const uint64_t present = find_present(scene);
  const int32_t count = list_choices(scene, present, choices);
  new.casters = calloc((size_t)count, sizeof *new.casters);
  new.media = (fum_media){.present = present, .items = calloc((size_t)count, sizeof *new.media.items)};
  if (new.casters == NULL || new.media.items == NULL)
    status = fum_fail(context, FUM_ERROR_MEMORY, "no memory for the scene's caches");
  for (int32_t k = 0; k < count && status == FUM_OK; k++) {
    new.media.count = k + 1;
    if (take_over(&old, &new, k, choices[k])) continue;
    new.casters[k] = caches->all;
    new.media.items[k].sets = choices[k];
    if (settings->subsampling >= 1.0F && are_all_casters(scene, choices[k])) continue;
    new.casters[k] = NULL;
    *out_has_built = true;
    status = build(scene, settings, settings->subsampling, &choices[k], &new.casters[k]);
  }
  drop_media(context, &old);
  *caches = new;
  free(choices);
  return status;
}

int32_t fum_caches_update(fum_scene *scene, const fum_settings *settings) {
  fum_context *context = scene->context;
  fum_caches *caches = scene->caches;
  const double start_s = fum_now_s();
  int32_t status = FUM_OK;
  if (caches == NULL) {
    scene->caches = caches = calloc(1, sizeof *caches);
    if (caches == NULL) return fum_fail(context, FUM_ERROR_MEMORY, "no memory for the scene's caches");
    fum_scene_find_origin(scene);
    status = fum_solids_build(scene, &caches->solids);
    if (status != FUM_OK) goto done;
  }
  caches->build_s = 0.0;
  const bool is_current =
      caches->all != NULL && caches->leaf_size == settings->leaf_size && caches->subsampling == settings->subsampling;
  if (!is_current) {
    drop_octrees(context, caches);
    caches->leaf_size = settings->leaf_size;
    caches->subsampling = settings->subsampling;
    status = build(scene, settings, 1.0F, NULL, &caches->all);
  }
  bool has_built = !is_current;
  if (status == FUM_OK) status = find_casters(scene, settings, &has_built);
  if (status == FUM_OK && has_built) caches->build_s = fum_now_s() - start_s;
done:
  if (status != FUM_OK) fum_scene_drop_caches(scene);
  return status;
}

int32_t fum_caches_find_media(fum_scene *scene, const fum_settings *settings, float error) {
  fum_caches *caches = scene->caches;
  int32_t status = FUM_OK;
  for (int32_t k = 0; k < caches->media.count && status == FUM_OK; k++) {
    fum_medium *old = &caches->media.items[k];
    fum_medium medium = {.sets = old->sets,
                         .octree = caches->casters[k],
                         .sigma_scale = settings->intersection_scale,
                         .depth_scale = settings->shadowing_density * settings->intersection_scale,
                         .depth_limit = -logf(error)};
    if (old->octree == medium.octree && old->sigma_scale == medium.sigma_scale &&
        old->depth_scale == medium.depth_scale && old->error == error)
      continue;
    fum_medium_end(scene->context, old);
    *old = (fum_medium){.sets = medium.sets};
    status = fum_medium_begin(scene->context, error, &medium);
    if (status == FUM_OK) *old = medium;
  }
  return status;
}
