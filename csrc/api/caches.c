/* SPDX-License-Identifier: GPL-3.0-or-later */
#include "api/caches.h"

#include <stdlib.h>

static void drop_medium(fum_context *context, fum_caches *caches) {
  fum_medium_end(context, &caches->medium);
  caches->medium = (fum_medium){0};
}

static void drop_octrees(fum_context *context, fum_caches *caches) {
  drop_medium(context, caches);
  if (caches->density != caches->all) fum_octree_destroy(context, caches->density);
  fum_octree_destroy(context, caches->all);
  caches->all = caches->density = NULL;
}

void fum_scene_drop_caches(fum_scene *scene) {
  fum_caches *caches = scene->caches;
  if (caches == NULL) return;
  drop_octrees(scene->context, caches);
  fum_solids_destroy(caches->solids);
  free(caches);
  scene->caches = NULL;
}

static int32_t build_octrees(fum_scene *scene, const fum_settings *settings) {
  fum_caches *caches = scene->caches;
  fum_octree_options options = {settings->leaf_size, 1.0F};
  caches->leaf_size = settings->leaf_size;
  caches->subsampling = settings->subsampling;
  int32_t status = fum_octree_build(scene, &options, &caches->all);
  if (status != FUM_OK) return status;
  caches->density = caches->all;
  if (settings->subsampling >= 1.0F) return FUM_OK;
  fum_octree *density = NULL;
  options.subsampling = settings->subsampling;
  status = fum_octree_build(scene, &options, &density);
  if (status == FUM_OK) caches->density = density;
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
  if (is_current) return FUM_OK;
  drop_octrees(context, caches);
  status = build_octrees(scene, settings);
  if (status == FUM_OK) caches->build_s = fum_now_s() - start_s;
done:
  if (status != FUM_OK) fum_scene_drop_caches(scene);
  return status;
}

int32_t fum_caches_find_medium(fum_scene *scene, const fum_settings *settings, float error) {
  fum_caches *caches = scene->caches;
  fum_medium medium = {.octree = caches->density,
                       .sigma_scale = settings->intersection_scale,
                       .depth_scale = settings->shadowing_density * settings->intersection_scale,
                       .depth_limit = -logf(error)};
  const fum_medium *old = &caches->medium;
  if (old->octree == medium.octree && old->sigma_scale == medium.sigma_scale &&
      old->depth_scale == medium.depth_scale && old->error == error)
    return FUM_OK;
  drop_medium(scene->context, caches);
  const int32_t status = fum_medium_begin(scene->context, error, &medium);
  if (status != FUM_OK) return status;
  caches->medium = medium;
  return FUM_OK;
}
