/* SPDX-License-Identifier: GPL-3.0-or-later */
#include "base/hash.h"
#include "base/radix.h"
#include "base/vector.h"
#include "scene/scene.h"

#include <stdlib.h>
#include <string.h>

static const int64_t MAX_PARTICLES = 4294967294;

void fum_particles_desc_init(fum_particles_desc *desc) {
  *desc = (fum_particles_desc){.struct_size = sizeof *desc,
                               .radius = 0.1F,
                               .density = 1.0F,
                               .albedo = {0.8F, 0.8F, 0.8F},
                               .visible_to_camera = 1,
                               .extinction_color = {1.0F, 1.0F, 1.0F}};
}

static bool is_extensive(float value) {
  return isfinite(value) && value >= 0.0F;
}

static bool is_albedo(const float *rgb) {
  for (int c = 0; c < 3; c++) {
    if (!(rgb[c] >= 0.0F && rgb[c] <= 1.0F)) return false;
  }
  return true;
}

static bool are_extensive(const float *rgb) {
  return is_extensive(rgb[0]) && is_extensive(rgb[1]) && is_extensive(rgb[2]);
}

static bool is_finite3(const float *v) {
  return isfinite(v[0]) && isfinite(v[1]) && isfinite(v[2]);
}

static int32_t check_desc(fum_context *context, const fum_particles_desc *d, const char *name) {
  if (d->count < 0) {
    return fum_fail(context, FUM_ERROR_ARGUMENT, "%s: count %lld is negative", name, (long long)d->count);
  }
  if (d->count > 0 && d->positions == NULL)
    return fum_fail(context, FUM_ERROR_ARGUMENT, "%s: positions are missing", name);
  if (!(d->anisotropy > -1.0F && d->anisotropy < 1.0F)) {
    return fum_fail(context, FUM_ERROR_ARGUMENT, "%s: anisotropy %g is not between -1 and 1", name,
                    (double)d->anisotropy);
  }
  if (d->radii == NULL && !is_extensive(d->radius)) {
    return fum_fail(context, FUM_ERROR_ARGUMENT, "%s: radius %g is not a length", name, (double)d->radius);
  }
  if (d->densities == NULL && !is_extensive(d->density)) {
    return fum_fail(context, FUM_ERROR_ARGUMENT, "%s: density %g is negative or not finite", name, (double)d->density);
  }
  if (d->albedos == NULL && !is_albedo(d->albedo)) {
    return fum_fail(context, FUM_ERROR_ARGUMENT, "%s: albedo %g %g %g is not within 0..1", name, (double)d->albedo[0],
                    (double)d->albedo[1], (double)d->albedo[2]);
  }
  if (d->emissions == NULL && !are_extensive(d->emission)) {
    return fum_fail(context, FUM_ERROR_ARGUMENT, "%s: emission %g %g %g is negative or not finite", name,
                    (double)d->emission[0], (double)d->emission[1], (double)d->emission[2]);
  }
  const float *color = d->extinction_color;
  if (d->extinction_colors == NULL && !are_extensive(color)) {
    return fum_fail(context, FUM_ERROR_ARGUMENT, "%s: extinction colour %g %g %g is negative or not finite", name,
                    (double)color[0], (double)color[1], (double)color[2]);
  }
  return fum_check_link_sets(context, name, d->light_set, d->shadow_set, -1);
}

/* Why particles are dropped, with the first culprit, for one warning. */
typedef struct drop_report {
  int64_t count, first;
  const char *what;
} drop_report;

/* The field that makes particle i unusable, or NULL. */
static const char *unusable_field(const fum_particles_desc *d, int64_t i) {
  if (!is_finite3(d->positions + 3 * i)) return "position";
  if (d->radii != NULL && !is_extensive(d->radii[i])) return "radius";
  if (d->densities != NULL && !is_extensive(d->densities[i])) return "density";
  if (d->albedos != NULL && !is_albedo(d->albedos + 3 * i)) return "albedo";
  if (d->emissions != NULL && !are_extensive(d->emissions + 3 * i)) return "emission";
  if (d->extinction_colors != NULL && !are_extensive(d->extinction_colors + 3 * i)) return "extinction colour";
  if (d->velocities != NULL && !is_finite3(d->velocities + 3 * i)) return "velocity";
  return NULL;
}

static bool has_size(const fum_particles_desc *d, int64_t i) {
  return d->radii != NULL ? d->radii[i] > 0.0F : d->radius > 0.0F;
}

/* Whether every particle is usable and already where its id puts it: then nothing has to be chosen or sorted. */
static bool is_tidy(fum_context *context, const fum_particles_desc *d) {
  int64_t untidy = 0;
#pragma omp parallel for num_threads(fum_thread_count(context)) schedule(static) reduction(+ : untidy)
  for (int64_t i = 0; i < d->count; i++)
    untidy += unusable_field(d, i) != NULL || !has_size(d, i) || (d->ids != NULL && i > 0 && d->ids[i] < d->ids[i - 1]);
  return untidy == 0;
}

/* Indices of the usable particles in the order of their ids. */
static int32_t choose_particles(fum_context *context, const fum_particles_desc *d, uint32_t *out_chosen,
                                int64_t *out_count, drop_report *out_report) {
  int64_t count = 0;
  bool ascending = true;
  uint64_t last_id = 0;
  for (int64_t i = 0; i < d->count; i++) {
    const char *field = unusable_field(d, i);
    if (field != NULL) {
      if (out_report->count++ == 0) *out_report = (drop_report){.count = 1, .first = i, .what = field};
      continue;
    }
    if (!has_size(d, i)) continue;
    if (d->ids != NULL) {
      ascending = ascending && (count == 0 || d->ids[i] >= last_id);
      last_id = d->ids[i];
    }
    out_chosen[count++] = (uint32_t)i;
  }
  *out_count = count;
  if (ascending) return FUM_OK;
  uint64_t *keys = NULL;
  int32_t status = fum_alloc(context, count, sizeof *keys, "particle ids", &keys);
  if (status != FUM_OK) return status;
  for (int64_t i = 0; i < count; i++)
    keys[i] = d->ids[out_chosen[i]];
  status = fum_radix_sort(context, count, 0, keys, out_chosen);
  fum_free(context, &keys);
  return status;
}

/* `chosen` NULL: all, in the order they have. */
static int32_t gather(fum_context *context, const char *name, const float *from, int width, int64_t count,
                      const uint32_t *chosen, float **out) {
  if (from == NULL) return FUM_OK;
  const int32_t status = fum_alloc(context, count * width, sizeof **out, name, out);
  if (status != FUM_OK) return status;
  float *to = *out;
#pragma omp parallel for num_threads(fum_thread_count(context)) schedule(static)
  for (int64_t i = 0; i < count; i++) {
    const int64_t source = chosen != NULL ? chosen[i] : i;
    for (int c = 0; c < width; c++)
      to[i * width + c] = from[source * width + c];
  }
  return FUM_OK;
}

static int32_t gather_uniform(fum_context *context, const char *name, const float *from, float uniform, int64_t count,
                              const uint32_t *chosen, float **out) {
  if (from != NULL) return gather(context, name, from, 1, count, chosen, out);
  const int32_t status = fum_alloc(context, count, sizeof **out, name, out);
  for (int64_t i = 0; status == FUM_OK && i < count; i++)
    (*out)[i] = uniform;
  return status;
}

static void free_particles(fum_context *context, fum_particles *set) {
  free(set->name);
  free(set->matte_name);
  fum_free(context, &set->positions);
  fum_free(context, &set->sigmas);
  fum_free(context, &set->densities);
  fum_free(context, &set->tints);
  fum_free(context, &set->albedos);
  fum_free(context, &set->emissions);
  fum_free(context, &set->velocities);
  fum_free(context, &set->ids);
  fum_map_drop(context, &set->map);
}

void fum_scene_free_particles(fum_scene *scene) {
  for (int32_t i = 0; i < scene->particles_count; i++)
    free_particles(scene->context, &scene->particles[i]);
  free(scene->particles);
  scene->particles = NULL;
  scene->particles_count = 0;
}

/* Makes a factor for each channel one on the density and the channels' shares of it. Without extinction there is no
 * share, and grey is as good as any. */
static void split_tint(float rgb[3], float *density) {
  const double mean = ((double)rgb[0] + (double)rgb[1] + (double)rgb[2]) / 3.0;
  *density *= (float)mean;
  for (int c = 0; c < 3; c++)
    rgb[c] = mean > 0.0 ? (float)((double)rgb[c] / mean) : 1.0F;
}

static void split_tints(fum_context *context, fum_particles *set) {
  const float *one = set->tint;
  if (set->tints == NULL && one[0] == 1.0F && one[1] == 1.0F && one[2] == 1.0F) return;
  float mean = 1.0F;
  split_tint(set->tint, &mean);
#pragma omp parallel for num_threads(fum_thread_count(context)) schedule(static)
  for (int64_t i = 0; i < set->count; i++) {
    if (set->tints != NULL) {
      split_tint(set->tints + 3 * i, &set->densities[i]);
    } else {
      set->densities[i] *= mean;
    }
  }
}

static int32_t copy_particles(fum_context *context, const fum_particles_desc *d, const char *name, int64_t count,
                              const uint32_t *chosen, fum_particles *set) {
  int32_t status = gather(context, name, d->positions, 3, count, chosen, &set->positions);
  if (status == FUM_OK) status = gather_uniform(context, name, d->radii, d->radius, count, chosen, &set->sigmas);
  if (status == FUM_OK)
    status = gather_uniform(context, name, d->densities, d->density, count, chosen, &set->densities);
  if (status == FUM_OK) status = gather(context, name, d->albedos, 3, count, chosen, &set->albedos);
  if (status == FUM_OK) status = gather(context, name, d->emissions, 3, count, chosen, &set->emissions);
  if (status == FUM_OK) status = gather(context, name, d->extinction_colors, 3, count, chosen, &set->tints);
  if (status == FUM_OK) status = gather(context, name, d->velocities, 3, count, chosen, &set->velocities);
  if (status == FUM_OK && d->ids != NULL) status = fum_alloc(context, count, sizeof *set->ids, name, &set->ids);
  if (status != FUM_OK) return status;
  for (int64_t i = 0; i < count; i++)
    set->sigmas[i] *= 0.5F;
  split_tints(context, set);
  for (int64_t i = 0; set->ids != NULL && i < count; i++)
    set->ids[i] = d->ids[chosen != NULL ? chosen[i] : i];
  return FUM_OK;
}

/* Ids that were given are trusted to differ between sets of one name. Without them such sets are told apart by their
 * order. */
static uint64_t find_seed(const fum_scene *scene, const char *name, bool has_ids) {
  for (int32_t s = scene->particles_count - 1; s >= 0 && !has_ids; s--) {
    const fum_particles *other = &scene->particles[s];
    if (other->ids == NULL && strcmp(other->name, name) == 0) return fum_hash64(other->seed);
  }
  return fum_hash_text(name);
}

/* Instances of one object bring its map again and again: of those alike the scene keeps one. */
static void share_map(const fum_scene *scene, fum_particles *set) {
  for (int32_t s = 0; s < scene->particles_count && set->map != NULL; s++) {
    fum_map *known = scene->particles[s].map;
    if (known == NULL || known == set->map || !fum_map_is_like(known, set->map)) continue;
    fum_map_drop(scene->context, &set->map);
    known->user_count++;
    set->map = known;
    return;
  }
}

int32_t fum_scene_add_particles(fum_scene *scene, const fum_particles_desc *desc) {
  fum_context *context = scene->context;
  if (desc == NULL || desc->struct_size < sizeof *desc) {
    return fum_fail(context, FUM_ERROR_ARGUMENT, "particles: the description has no valid struct_size");
  }
  const char *name = desc->name != NULL ? desc->name : "particles";
  int32_t status = check_desc(context, desc, name);
  if (status != FUM_OK) return status;
  if (desc->count > MAX_PARTICLES - scene->particle_count) {
    return fum_fail(context, FUM_ERROR_ARGUMENT, "%s: %lld particles exceed the limit of %lld in a scene", name,
                    (long long)desc->count, (long long)MAX_PARTICLES);
  }
  uint32_t *chosen = NULL;
  int64_t count = 0;
  drop_report report = {0};
  fum_particles set = {.offset = scene->particle_count,
                       .seed = find_seed(scene, name, desc->ids != NULL),
                       .anisotropy = desc->anisotropy,
                       .light_set = desc->light_set,
                       .shadow_set = desc->shadow_set,
                       .is_visible_to_camera = desc->visible_to_camera != 0};
  memcpy(set.albedo, desc->albedo, sizeof set.albedo);
  memcpy(set.emission, desc->emission, sizeof set.emission);
  memcpy(set.tint, desc->extinction_color, sizeof set.tint);
  if (is_tidy(context, desc)) {
    count = desc->count;
  } else {
    status = fum_alloc(context, desc->count, sizeof *chosen, name, &chosen);
    if (status == FUM_OK) status = choose_particles(context, desc, chosen, &count, &report);
    if (status != FUM_OK) goto done;
  }
  set.count = count;
  status = copy_particles(context, desc, name, count, chosen, &set);
  if (status == FUM_OK && desc->map != NULL)
    status = fum_map_create(context, name, desc->map_width, desc->map_height, desc->map, &set.map);
  if (status != FUM_OK) goto done;
  share_map(scene, &set);
  set.name = fum_copy_string(name);
  set.matte_name = fum_copy_string(desc->matte_name != NULL ? desc->matte_name : name);
  fum_particles *grown = realloc(scene->particles, (size_t)(scene->particles_count + 1) * sizeof *grown);
  if (grown != NULL) scene->particles = grown;
  if (set.name == NULL || set.matte_name == NULL || grown == NULL) {
    status = fum_fail(context, FUM_ERROR_MEMORY, "%s: no memory for another set of particles", name);
    goto done;
  }
  scene->particles[scene->particles_count++] = set;
  scene->particle_count += count;
  set = (fum_particles){0};
  fum_scene_drop_caches(scene);
  if (report.count > 0) {
    fum_warn(context, "%s: %lld of %lld particles were dropped; the first, number %lld, has an invalid %s", name,
             (long long)report.count, (long long)desc->count, (long long)report.first, report.what);
  }
done:
  free_particles(context, &set);
  fum_free(context, &chosen);
  return status;
}

const fum_particles *fum_scene_particles_of(const fum_scene *scene, int64_t index) {
  int32_t low = 0, high = scene->particles_count - 1;
  while (low < high) {
    const int32_t middle = (low + high + 1) / 2;
    if (scene->particles[middle].offset <= index) {
      low = middle;
    } else {
      high = middle - 1;
    }
  }
  return &scene->particles[low];
}

fum_map_traits fum_scene_map_traits(const fum_scene *scene) {
  fum_map_traits traits = {.edge = 1.0F, .contrast = 1.0F};
  for (int32_t s = 0; s < scene->particles_count; s++) {
    const fum_particles *set = &scene->particles[s];
    if (set->map == NULL || set->count == 0 || !set->is_visible_to_camera) continue;
    traits.has_maps = true;
    traits.edge = fum_max(traits.edge, set->map->edge);
    traits.contrast = fum_max(traits.contrast, set->map->contrast);
  }
  return traits;
}

uint64_t fum_particle_identity(const fum_particles *set, int64_t index_in_set) {
  const uint64_t id = set->ids != NULL ? set->ids[index_in_set] : (uint64_t)index_in_set;
  return set->seed ^ id;
}
