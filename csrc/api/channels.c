/* SPDX-License-Identifier: GPL-3.0-or-later */
#include "api/channels.h"

#include "api/caches.h"

#include <stdlib.h>
#include <string.h>

static const float *tint_of(const fum_particles *set, int64_t i) {
  return set->tints != NULL ? set->tints + 3 * i : set->tint;
}

/* Is red, green or blue weakened by the mean extinction everywhere? */
static bool is_mean(const fum_scene *scene, int channel) {
  for (int32_t s = 0; s < scene->particles_count; s++) {
    const fum_particles *set = &scene->particles[s];
    for (int64_t i = 0; i < (set->tints != NULL ? set->count : 1); i++) {
      if (tint_of(set, i)[channel] != 1.0F) return false;
    }
  }
  return true;
}

/* Are two channels weakened alike everywhere? */
static bool are_alike(const fum_scene *scene, int a, int b) {
  for (int32_t s = 0; s < scene->particles_count; s++) {
    const fum_particles *set = &scene->particles[s];
    for (int64_t i = 0; i < (set->tints != NULL ? set->count : 1); i++) {
      const float *tint = tint_of(set, i);
      if (tint[a] != tint[b]) return false;
    }
  }
  return true;
}

static void weigh(const fum_scene *scene, int channel, float *densities) {
  for (int32_t s = 0; s < scene->particles_count; s++) {
    const fum_particles *set = &scene->particles[s];
#pragma omp parallel for num_threads(fum_thread_count(scene->context)) schedule(static)
    for (int64_t i = 0; i < set->count; i++)
      densities[set->offset + i] = set->densities[i] * tint_of(set, i)[channel];
  }
}

/* The scene with other densities, without caches. */
static int32_t make_scene(const fum_scene *scene, float *densities, fum_scene **out_scene) {
  fum_scene *made = calloc(1, sizeof *made);
  fum_particles *sets = calloc((size_t)scene->particles_count, sizeof *sets);
  if (made == NULL || sets == NULL) {
    free(made);
    free(sets);
    return fum_fail(scene->context, FUM_ERROR_MEMORY, "no memory for a colour channel's scene");
  }
  for (int32_t s = 0; s < scene->particles_count; s++) {
    sets[s] = scene->particles[s];
    sets[s].densities = densities + sets[s].offset;
  }
  made->context = scene->context;
  made->particles = sets;
  *out_scene = made;
  return FUM_OK;
}

/* A scene for the channel, the last of those that there are. */
static int32_t add_scene(fum_scene *scene, int channel, fum_channels *channels) {
  fum_context *context = scene->context;
  const int32_t k = channels->count;
  if (is_mean(scene, channel)) {
    channels->scenes[channels->count++] = scene;
    return FUM_OK;
  }
  float *densities = NULL;
  int32_t status = fum_alloc(context, scene->particle_count, sizeof *densities, "a colour channel", &densities);
  if (status == FUM_OK) status = make_scene(scene, densities, &channels->scenes[k]);
  if (status != FUM_OK) {
    fum_free(context, &densities);
    return status;
  }
  weigh(scene, channel, densities);
  channels->densities[k] = densities;
  channels->count++;
  return FUM_OK;
}

static int32_t find_channels(fum_scene *scene, fum_channels *channels) {
  for (int c = 0; c < 3; c++) {
    int like = 0;
    while (like < c && !are_alike(scene, like, c))
      like++;
    channels->of[c] = like < c ? channels->of[like] : channels->count;
    const int32_t status = like < c ? FUM_OK : add_scene(scene, c, channels);
    if (status != FUM_OK) return status;
  }
  return FUM_OK;
}

/* Gives a channel's scene what may have changed since, lights among it; its caches share the solids. */
static int32_t update_scene(const fum_scene *scene, const fum_settings *settings, fum_scene *channel) {
  fum_scene current = *scene;
  current.particles = channel->particles;
  current.caches = channel->caches;
  if (current.caches == NULL) {
    current.caches = calloc(1, sizeof *current.caches);
    if (current.caches == NULL)
      return fum_fail(scene->context, FUM_ERROR_MEMORY, "no memory for a colour channel's caches");
    current.caches->solids = scene->caches->solids;
    current.caches->borrows_solids = true;
  }
  *channel = current;
  return fum_caches_update(channel, settings);
}

int32_t fum_channels_update(fum_scene *scene, const fum_settings *settings, const fum_channels **out_channels) {
  int32_t status = fum_caches_update(scene, settings);
  if (status != FUM_OK) return status;
  fum_channels *channels = &scene->caches->channels;
  if (channels->count == 0) status = find_channels(scene, channels);
  for (int32_t k = 0; k < channels->count && status == FUM_OK; k++) {
    if (channels->densities[k] == NULL) continue;
    status = update_scene(scene, settings, channels->scenes[k]);
    if (status == FUM_OK) scene->caches->build_s += channels->scenes[k]->caches->build_s;
  }
  if (status == FUM_OK) {
    *out_channels = channels;
  } else {
    fum_scene_drop_caches(scene);
  }
  return status;
}

void fum_channels_free(fum_context *context, fum_channels *channels) {
  for (int32_t k = 0; k < channels->count; k++) {
    if (channels->densities[k] == NULL) continue;
    fum_scene_drop_caches(channels->scenes[k]);
    free(channels->scenes[k]->particles);
    free(channels->scenes[k]);
    fum_free(context, &channels->densities[k]);
  }
  *channels = (fum_channels){0};
}
