/* SPDX-License-Identifier: GPL-3.0-or-later */
#include "lighting/lamps.h"

#include <string.h>

/* Anisotropies of the particles. */
typedef struct looks {
  int32_t count;
  float *anisotropies; /* [count] each once; 0 where there are no particles */
  float steepest;      /* largest magnitude */
} looks;

static int32_t find_looks(const fum_scene *scene, looks *out) {
  const int32_t most = scene->particles_count > 0 ? scene->particles_count : 1;
  const int32_t status = fum_alloc(scene->context, most, sizeof *out->anisotropies, "lights", &out->anisotropies);
  for (int32_t s = 0; s < scene->particles_count && status == FUM_OK; s++) {
    const float g = scene->particles[s].anisotropy;
    int32_t k = 0;
    while (k < out->count && out->anisotropies[k] != g)
      k++;
    if (k == out->count) out->anisotropies[out->count++] = g;
    out->steepest = fmaxf(out->steepest, fabsf(g));
  }
  if (out->count == 0) out->count = 1; /* points are lit without any smoke */
  return status;
}

/* Parts so small that a phase function doesn't change across them: the width of its lobe is about 1 - g. */
static int32_t fine_enough(float anisotropy, int32_t coarse) {
  const float width = 1.0F - anisotropy, wanted = 12.0F / (width * width);
  const int32_t fine = wanted < (float)FUM_MOST_SKY_PARTS ? (int32_t)wanted : FUM_MOST_SKY_PARTS;
  return fine > coarse ? fine : coarse;
}

/* Even light needs fewer directions than a picture's (docs/ACCURACY.md). Errors of what is `share` of all light show by
 * that much less; they fall with the square of the number. */
static int32_t part_count(const fum_light_desc *desc, int32_t max_samples, double share) {
  const int32_t times = desc->environment_pixels != NULL ? 4 : 3, fewest = 6;
  const int32_t most = max_samples < FUM_MOST_SKY_PARTS / times ? times * max_samples : FUM_MOST_SKY_PARTS;
  const int32_t wanted = (int32_t)ceil(sqrt(share) * (double)most);
  return wanted > fewest || most < fewest ? wanted : fewest;
}

static double sum_of(const float rgb[3]) {
  return (double)rgb[0] + (double)rgb[1] + (double)rgb[2];
}

/* What a light that isn't an environment sends in the clear to the middle of the scene, whoever is lit and wherever the
 * camera looks. */
static double find_strength(const fum_scene *scene, const fum_light_desc *desc) {
  const float middle[6] = {0};
  fum_lamp lamp;
  fum_lamp_init(desc, scene->origin, middle, 1, &lamp);
  const fum_emitter sample = fum_lamp_sample(&lamp, 0);
  return (double)fum_emitter_irradiance(&lamp, &sample, (fum_vec3){0}) * sum_of(desc->intensity);
}

static int32_t choose_parts(const fum_scene *scene, int32_t light, int32_t count, float steepest, fum_lamps *lamps) {
  return fum_environment_choose(scene->context, &scene->lights[light].desc, count, fine_enough(steepest, count),
                                &lamps->environments[light]);
}

/* As many parts as there may be, and then fewer of those beside brighter lights. */
static int32_t find_environments(const fum_scene *scene, float steepest, int32_t max_samples, fum_lamps *lamps) {
  int32_t status = FUM_OK;
  double total = 0.0;
  for (int32_t i = 0; i < scene->light_count && status == FUM_OK; i++) {
    const fum_light_desc *desc = &scene->lights[i].desc;
    const bool is_environment = desc->type == FUM_LIGHT_ENVIRONMENT;
    if (is_environment) status = choose_parts(scene, i, part_count(desc, max_samples, 1.0), steepest, lamps);
    total += is_environment ? sum_of(lamps->environments[i].total) : find_strength(scene, desc);
  }
  for (int32_t i = 0; i < scene->light_count && status == FUM_OK; i++) {
    const fum_light_desc *desc = &scene->lights[i].desc;
    fum_environment *e = &lamps->environments[i];
    if (desc->type != FUM_LIGHT_ENVIRONMENT || e->count == 0) continue;
    const int32_t count = part_count(desc, max_samples, fum_least(sum_of(e->total) / total, 1.0));
    if (count >= part_count(desc, max_samples, 1.0)) continue;
    fum_environment_free(scene->context, e);
    status = choose_parts(scene, i, count, steepest, lamps);
  }
  return status;
}

/* Has all of it the colour of the whole? */
static bool has_one_color(const fum_environment *e, int32_t brightest) {
  const float most = e->total[brightest], slack = 1e-5F;
  for (int32_t i = 0; i < e->count; i++) {
    const float *rgb = e->parts[i].irradiance, own = rgb[brightest];
    for (int c = 0; c < 3; c++) {
      if (fabsf(rgb[c] * most - own * e->total[c]) > slack * most * fmaxf(own, rgb[c])) return false;
    }
  }
  return true;
}

/* Does it shine on any smoke that the camera sees? */
static bool lights_smoke(const fum_scene *scene, const fum_light_desc *light) {
  for (int32_t s = 0; s < scene->particles_count; s++) {
    const fum_particles *set = &scene->particles[s];
    if (set->count > 0 && set->is_visible_to_camera && fum_has_set(light->light_sets, set->light_set)) return true;
  }
  return false;
}

/* Lamps of an environment; with out_lamps NULL only how many. */
static int32_t make_around(const fum_lamp *lamp, const looks *looks, fum_lamp *out_lamps) {
  const fum_environment *e = lamp->environment;
  const int32_t brightest = e->total[0] >= e->total[1] && e->total[0] >= e->total[2] ? 0
                            : e->total[1] >= e->total[2]                             ? 1
                                                                                     : 2;
  const bool is_plain = has_one_color(e, brightest);
  int32_t count = 0;
  for (int32_t k = 0; k < looks->count; k++) {
    for (int32_t c = 0; c < 3; c++) {
      if (is_plain ? c != brightest : !(e->total[c] > 0.0F)) continue;
      if (out_lamps != NULL) {
        fum_lamp *own = &out_lamps[count];
        *own = *lamp;
        own->index += count;
        own->anisotropy = looks->anisotropies[k];
        own->channel = c;
        for (int channel = 0; channel < 3; channel++) {
          const float share = e->total[c] > 0.0F ? e->total[channel] / e->total[c] : 0.0F;
          own->color[channel] = is_plain ? share : channel == c ? 1.0F : 0.0F;
        }
      }
      count++;
    }
  }
  return count;
}

/* The lamp, or the lamps, of a light, from lamps->items[lamps->count] on, and counts them; with no items only counts.
 */
static void make_lamps(const fum_scene *scene, const fum_octree *receivers, int32_t light, int32_t max_samples,
                       const looks *looks, fum_lamps *lamps) {
  float bounds[6] = {0};
  fum_lamp lamp;
  if (receivers->node_count > 0) {
    memcpy(bounds, receivers->nodes[0].lower, 3 * sizeof(float));
    memcpy(bounds + 3, receivers->nodes[0].upper, 3 * sizeof(float));
  }
  fum_lamp_init(&scene->lights[light].desc, receivers->origin, bounds, max_samples, &lamp);
  lamp.index = lamps->count;
  lamp.light = light;
  lamp.lights_smoke = lights_smoke(scene, &lamp.desc);
  fum_lamp *out = lamps->items != NULL ? &lamps->items[lamps->count] : NULL;
  if (lamp.desc.type != FUM_LIGHT_ENVIRONMENT) {
    if (out != NULL) *out = lamp;
    lamps->count++;
    return;
  }
  lamp.environment = &lamps->environments[light];
  lamp.sample_count = lamp.environment->count;
  lamps->count += lamp.sample_count > 0 ? make_around(&lamp, looks, out) : 0;
}

int32_t fum_lamps_find(const fum_scene *scene, const fum_octree *receivers, int32_t max_samples, fum_lamps *out_lamps) {
  fum_context *context = scene->context;
  fum_lamps lamps = {.light_count = scene->light_count};
  looks looks = {0};
  int32_t status = find_looks(scene, &looks);
  if (status == FUM_OK)
    status = fum_alloc(context, scene->light_count, sizeof *lamps.environments, "lights", &lamps.environments);
  if (status == FUM_OK) status = find_environments(scene, looks.steepest, max_samples, &lamps);
  if (status != FUM_OK) goto done;
  for (int32_t i = 0; i < scene->light_count; i++)
    make_lamps(scene, receivers, i, max_samples, &looks, &lamps);
  status = fum_alloc(context, lamps.count, sizeof *lamps.items, "lights", &lamps.items);
  if (status != FUM_OK) goto done;
  lamps.count = 0;
  for (int32_t i = 0; i < scene->light_count; i++)
    make_lamps(scene, receivers, i, max_samples, &looks, &lamps);
  *out_lamps = lamps;
  lamps = (fum_lamps){0};
done:
  fum_free(context, &looks.anisotropies);
  fum_lamps_free(context, &lamps);
  return status;
}

void fum_lamps_free(fum_context *context, fum_lamps *lamps) {
  for (int32_t i = 0; i < lamps->light_count && lamps->environments != NULL; i++)
    fum_environment_free(context, &lamps->environments[i]);
  fum_free(context, &lamps->environments);
  fum_free(context, &lamps->items);
}

int32_t fum_lamps_alike(const fum_lamps *lamps, int32_t first) {
  const fum_environment *environment = lamps->items[first].environment;
  int32_t count = 1;
  while (environment != NULL && first + count < lamps->count && lamps->items[first + count].environment == environment)
    count++;
  return count;
}

int32_t fum_lamps_most_alike(const fum_lamps *lamps) {
  int32_t most = 1;
  for (int32_t i = 0; i < lamps->count; i++)
    most = fum_lamps_alike(lamps, i) > most ? fum_lamps_alike(lamps, i) : most;
  return most;
}

int32_t fum_lamps_sample_count(const fum_lamps *lamps) {
  int32_t count = 0;
  for (int32_t i = 0; i < lamps->count; i += fum_lamps_alike(lamps, i))
    count += lamps->items[i].sample_count;
  return count;
}

bool fum_lamps_walk(const fum_lamps *lamps, fum_lamp_walk *walk) {
  if (walk->next >= lamps->count) return false;
  const fum_lamp *lamp = &lamps->items[walk->next];
  walk->lamp = *lamp;
  if (lamp->environment == NULL) {
    walk->next++;
    return true;
  }
  const fum_sky *part = &lamp->environment->parts[walk->part++];
  walk->lamp.desc.type = FUM_LIGHT_SUN;
  walk->lamp.desc.sun_angle = 0.0F;
  walk->lamp.back = part->direction;
  walk->lamp.sample_count = 1;
  memcpy(walk->lamp.color, part->irradiance, sizeof walk->lamp.color);
  if (walk->part < lamp->environment->count) return true;
  walk->next += fum_lamps_alike(lamps, walk->next);
  walk->part = 0;
  return true;
}
