/* SPDX-License-Identifier: GPL-3.0-or-later */
#include "lighting/gather.h"

/* Strength of one sample at each receiver before smoke; 0 where it doesn't reach. */
static void find_strengths(const fum_gathering *g, const fum_lamp *lamp, const fum_emitter *emitter,
                           float *out_strengths, uint8_t *out_is_lit) {
  const fum_octree *octree = g->receivers->octree;
#pragma omp parallel for num_threads(fum_thread_count(g->context)) schedule(dynamic, 1024)
  for (int64_t i = 0; i < octree->count; i++) {
    if (fum_progress_in_loop(g->context, i, 1 << 14)) continue;
    const fum_vec3 point = {octree->x[i], octree->y[i], octree->z[i]};
    fum_vec3 to_light = emitter->direction;
    float distance = INFINITY;
    if (!emitter->is_directional) {
      const fum_vec3 way = fum_sub(emitter->position, point);
      distance = fum_length(way);
      to_light = distance > 0.0F ? fum_scaled(way, 1.0F / distance) : (fum_vec3){0.0F, 0.0F, 1.0F};
    }
    float strength = 1.0F / (float)lamp->sample_count;
    if (g->response != NULL) {
      strength = fum_emitter_irradiance(lamp, emitter, point) * g->response(g->response_user, (uint32_t)i, to_light);
    }
    if (strength > 0.0F && fum_solids_occlude(g->solids, point, to_light, distance)) {
      strength *= 1.0F - g->solid_shadow_intensity;
    }
    out_strengths[i] = strength;
    out_is_lit[i] = strength > 0.0F;
  }
}

int32_t fum_gather_light(const fum_gathering *g, const fum_lamp *lamp, const float progress[2], float *out_light) {
  fum_context *context = g->context;
  const int64_t count = g->receivers->octree->count;
  float *strengths = NULL, *depths = NULL;
  uint8_t *is_lit = NULL;
  int32_t status = fum_alloc(context, count, sizeof *strengths, "lighting", &strengths);
  if (status == FUM_OK) status = fum_alloc(context, count, sizeof *depths, "lighting", &depths);
  if (status == FUM_OK) status = fum_alloc(context, count, sizeof *is_lit, "lighting", &is_lit);
  for (int32_t sample = 0; status == FUM_OK && sample < lamp->sample_count; sample++) {
    const float step = (progress[1] - progress[0]) / (float)lamp->sample_count;
    const float from = progress[0] + step * (float)sample;
    const fum_emitter emitter = fum_lamp_sample(lamp, sample);
    find_strengths(g, lamp, &emitter, strengths, is_lit);
    status = fum_progress_report(context, FUM_STAGE_LIGHTING, from, "Lighting particles");
    if (status != FUM_OK) break;
    status = fum_exact_solve(context, g->medium, g->receivers, &emitter, is_lit, (float[2]){from, from + step}, depths);
    if (status != FUM_OK) break;
#pragma omp parallel for num_threads(fum_thread_count(context)) schedule(static)
    for (int64_t i = 0; i < count; i++) {
      if (is_lit[i]) out_light[i] += strengths[i] * expf(-depths[i]);
    }
  }
  fum_free(context, &is_lit);
  fum_free(context, &depths);
  fum_free(context, &strengths);
  return status;
}
