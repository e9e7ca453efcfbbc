/* SPDX-License-Identifier: GPL-3.0-or-later */
#include "api/lighting.h"

#include "api/settings.h"

#include <string.h>

/* The tolerance is for the picture; transmittance to a light is kept within a tenth of it. Half of that may be lost by
 * not hearing far particles, half by ending walks early. */
float fum_transmittance_error(const fum_settings *settings) {
  return 0.1F * settings->tolerance;
}

int32_t fum_lighting_begin(fum_scene *scene, const fum_settings *settings, const fum_octree *receivers,
                           fum_lighting *out_lighting) {
  fum_context *context = scene->context;
  const float error = 0.5F * fum_transmittance_error(settings);
  fum_lighting lighting = {0};
  int32_t status = fum_caches_find_media(scene, settings, error);
  if (status == FUM_OK) status = fum_lamps_find(scene, receivers, settings->light_samples, &lighting.lamps);
  if (status != FUM_OK) {
    fum_lighting_end(context, &lighting);
    return status;
  }
  lighting.media = &scene->caches->media;
  lighting.receivers.octree = receivers;
  *out_lighting = lighting;
  out_lighting->solver = (fum_solver){.wanted = settings->solver, .tolerance = settings->tolerance};
  out_lighting->gathering = (fum_gathering){.context = context,
                                            .solver = &out_lighting->solver,
                                            .media = out_lighting->media,
                                            .solids = scene->caches->solids,
                                            .solid_shadow_intensity = settings->solid_shadow_intensity,
                                            .receivers = &out_lighting->receivers};
  return FUM_OK;
}

void fum_lighting_end(fum_context *context, fum_lighting *lighting) {
  fum_lamps_free(context, &lighting->lamps);
  fum_receivers_free(context, &lighting->receivers);
}

static float face_light(const fum_surface *s, int64_t i, fum_vec3 to_light) {
  if (s->mesh_indices != NULL && !fum_has_set(s->light_sets, s->meshes[s->mesh_indices[i]].light_set)) return 0.0F;
  if (s->normals == NULL) return 1.0F;
  const float *n = s->normals + 3 * i;
  return fmaxf(0.0F, n[0] * to_light.x + n[1] * to_light.y + n[2] * to_light.z);
}

void fum_surface_respond(const void *user, const fum_emitter *emitter, int64_t first, int64_t count, float *strengths) {
  const fum_surface *s = user;
  for (int64_t k = 0; k < count; k++) {
    const fum_octree *p = s->points;
    const fum_vec3 point = {p->x[first + k], p->y[first + k], p->z[first + k]};
    strengths[k] *= face_light(s, p->indices[first + k], fum_emitter_way(emitter, point).direction);
  }
}

static int32_t check_points(fum_scene *scene, int32_t light, int64_t count, const float *positions, const float *out) {
  fum_context *context = scene->context;
  if (light < 0 || light >= scene->light_count) {
    return fum_fail(context, FUM_ERROR_ARGUMENT, "light %d is not one of the scene's %d lights", (int)light,
                    (int)scene->light_count);
  }
  if (count < 0 || count > UINT32_MAX - 1 || (count > 0 && (positions == NULL || out == NULL))) {
    return fum_fail(context, FUM_ERROR_ARGUMENT, "points: count %lld is out of range or an array is null",
                    (long long)count);
  }
  for (int64_t i = 0; i < 3 * count; i++) {
    if (!isfinite(positions[i])) {
      return fum_fail(context, FUM_ERROR_ARGUMENT, "points: position %lld is not finite", (long long)(i / 3));
    }
  }
  return FUM_OK;
}

/* What arrives of a light at points, [3 count]: irradiance, or the mean of its samples' transmittances, in each channel
 * the same. */
static int32_t add_lamps(const fum_lighting *lighting, int32_t light, bool is_transmittance, int64_t count,
                         float *out) {
  int32_t status = FUM_OK;
  float sent = 0.0F;
  bool adds = false;
  for (fum_lamp_walk walk = {0}; fum_lamps_walk(&lighting->lamps, &walk) && status == FUM_OK;) {
    float *color = walk.lamp.color;
    if (walk.lamp.light != light) continue;
    const float share = walk.lamp.environment != NULL ? color[0] + color[1] + color[2] : 1.0F;
    sent += share;
    for (int c = 0; c < 3 && is_transmittance; c++)
      color[c] = share;
    status = fum_gather_light(&lighting->gathering, &walk.lamp, (float[2]){0.0F, 1.0F}, adds, out);
    adds = true;
  }
  for (int64_t i = 0; i < 3 * count && is_transmittance && sent > 0.0F; i++)
    out[i] /= sent;
  return status;
}

/* At points of a scene whose caches are current, [3 count]. `normals` are used for irradiance. */
static int32_t light_points(fum_scene *scene, const fum_settings *settings, int32_t light, int64_t count,
                            const float *positions, const float *normals, bool is_transmittance, float *out) {
  fum_context *context = scene->context;
  fum_octree *points = NULL;
  fum_lighting lighting = {0};
  float *local = NULL, *sums = NULL;
  int32_t status = fum_alloc(context, count, 3 * sizeof *local, "points", &local);
  for (int64_t i = 0; status == FUM_OK && i < 3 * count; i++) {
    local[i] = (float)((double)positions[i] - scene->origin[i % 3]);
  }
  if (status == FUM_OK) {
    status = fum_octree_build_points(context, scene->origin, count, local, FUM_GROUP_SIZE, &points);
  }
  if (status == FUM_OK) status = fum_lighting_begin(scene, settings, points, &lighting);
  if (status == FUM_OK) status = fum_alloc(context, count, 3 * sizeof *sums, "points", &sums);
  if (status != FUM_OK) goto done;
  const fum_surface surfaces = {.points = points, .normals = normals};
  /* Nothing measures these: only an exact solver keeps what is promised of them. */
  if (lighting.solver.wanted == FUM_SOLVER_AUTOMATIC) lighting.solver.wanted = FUM_SOLVER_EXACT;
  lighting.gathering.response = is_transmittance ? NULL : fum_surface_respond;
  lighting.gathering.response_user = &surfaces;
  status = add_lamps(&lighting, light, is_transmittance, count, sums);
  for (int64_t i = 0; i < 3 * count && status == FUM_OK; i++)
    out[3 * (int64_t)points->indices[i / 3] + i % 3] = sums[i];
done:
  fum_free(context, &local);
  fum_free(context, &sums);
  fum_lighting_end(context, &lighting);
  fum_octree_destroy(context, points);
  return status;
}

/* Each channel by its own extinction. */
static int32_t light_channels(fum_scene *scene, const fum_settings *settings, int32_t light, int64_t count,
                              const float *positions, const float *normals, bool is_transmittance, float *out) {
  const fum_channels *channels = NULL;
  float *rgb = NULL;
  fum_settings checked;
  fum_progress_begin(scene->context);
  int32_t status = fum_settings_check(scene->context, settings, &checked);
  if (status == FUM_OK) status = fum_channels_update(scene, &checked, &channels);
  if (status == FUM_OK) status = fum_alloc(scene->context, count, 3 * sizeof *rgb, "points", &rgb);
  for (int32_t k = 0; status == FUM_OK && k < channels->count; k++) {
    status = light_points(channels->scenes[k], &checked, light, count, positions, normals, is_transmittance, rgb);
    for (int c = 0; c < 3; c++) {
      for (int64_t i = 0; channels->of[c] == k && i < count; i++)
        out[3 * i + c] = rgb[3 * i + c];
    }
  }
  fum_free(scene->context, &rgb);
  return status;
}

int32_t fum_scene_transmittance(fum_scene *scene, const fum_settings *settings, int32_t light, int64_t count,
                                const float *positions, float *out_transmittance) {
  int32_t status = check_points(scene, light, count, positions, out_transmittance);
  if (status != FUM_OK) return status;
  float *rgb = NULL;
  status = fum_alloc(scene->context, count, 3 * sizeof *rgb, "points", &rgb);
  if (status == FUM_OK) status = light_channels(scene, settings, light, count, positions, NULL, true, rgb);
  for (int64_t i = 0; status == FUM_OK && i < count; i++) {
    const double sum = (double)rgb[3 * i] + (double)rgb[3 * i + 1] + (double)rgb[3 * i + 2];
    out_transmittance[i] = (float)(sum / 3.0); /* of three equal floats exactly that float */
  }
  fum_free(scene->context, &rgb);
  return status;
}

int32_t fum_scene_irradiance(fum_scene *scene, const fum_settings *settings, int32_t light, int64_t count,
                             const float *positions, const float *normals, float *out_irradiance) {
  fum_context *context = scene->context;
  int32_t status = check_points(scene, light, count, positions, out_irradiance);
  if (status != FUM_OK) return status;
  for (int64_t i = 0; normals != NULL && i < 3 * count; i++) {
    if (!isfinite(normals[i])) {
      return fum_fail(context, FUM_ERROR_ARGUMENT, "points: normal %lld is not finite", (long long)(i / 3));
    }
  }
  float *rgb = NULL;
  status = fum_alloc(context, count, 3 * sizeof *rgb, "points", &rgb);
  if (status == FUM_OK) status = light_channels(scene, settings, light, count, positions, normals, false, rgb);
  if (status == FUM_OK && count > 0) memcpy(out_irradiance, rgb, 3 * (size_t)count * sizeof *rgb);
  fum_free(context, &rgb);
  return status;
}
