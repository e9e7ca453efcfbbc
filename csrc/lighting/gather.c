/* SPDX-License-Identifier: GPL-3.0-or-later */
#include "lighting/gather.h"

#include "base/simd.h"

#include <string.h>

fum_vec3 fum_direction_to_viewer(const fum_viewpoint *viewpoint, fum_vec3 point) {
  if (viewpoint->is_directional) return viewpoint->direction;
  const fum_vec3 way = fum_sub(viewpoint->position, point);
  const float length = fum_length(way);
  return length > 0.0F ? fum_scaled(way, 1.0F / length) : (fum_vec3){0.0F, 0.0F, 1.0F};
}

static fum_vec3 point_of(const fum_octree *octree, int64_t i) {
  return (fum_vec3){octree->x[i], octree->y[i], octree->z[i]};
}

/* Where a receiver's shadow rays start. A particle born on a surface stands in it half, and the camera sees the half on
 * its own side: the ray starts a little nearer to the camera, or rounding would decide. */
static fum_vec3 ray_start(const fum_gathering *g, int64_t i, fum_vec3 point) {
  const float sigmas = 0.05F;
  const fum_octree *octree = g->receivers->octree;
  if (g->viewpoint == NULL || octree->inverse_sigmas == NULL) return point;
  return fum_mad(fum_direction_to_viewer(g->viewpoint, point), sigmas / octree->inverse_sigmas[i], point);
}

/* Receivers that are looked at together. */
enum { STRETCH = 1024 };

static int64_t stretches_of(int64_t count) {
  return (count + STRETCH - 1) / STRETCH;
}

static void meet_solids(const fum_gathering *g, const fum_lamp *lamp, const fum_emitter *emitter, int64_t first,
                        int64_t count, float *strengths) {
  for (int64_t k = 0; k < count; k++) {
    const fum_vec3 point = point_of(g->receivers->octree, first + k);
    const fum_way way = fum_emitter_way(emitter, point);
    if (strengths[k] > 0.0F && fum_solids_occlude(g->solids, lamp->desc.shadow_sets, ray_start(g, first + k, point),
                                                  way.direction, way.length))
      strengths[k] *= 1.0F - g->solid_shadow_intensity;
  }
}

/* Strength of one sample at each receiver before smoke; 0 where it doesn't reach. */
static void find_strengths(const fum_gathering *g, const fum_lamp *lamp, const fum_emitter *emitter,
                           float *out_strengths, uint8_t *out_is_lit) {
  const fum_octree *octree = g->receivers->octree;
  const bool meets_solids = g->solids != NULL && lamp->desc.casts_shadows != 0;
#pragma omp parallel for num_threads(fum_thread_count(g->context)) schedule(dynamic, 8)
  for (int64_t stretch = 0; stretch < stretches_of(octree->count); stretch++) {
    if (fum_progress_in_loop(g->context, stretch, 16)) continue;
    const int64_t first = stretch * STRETCH, left = octree->count - first, count = left < STRETCH ? left : STRETCH;
    float *strengths = out_strengths + first;
    if (g->response != NULL) {
      const float *const places[3] = {octree->x + first, octree->y + first, octree->z + first};
      fum_emitter_irradiances(lamp, emitter, places, count, strengths);
      g->response(g->response_user, emitter, first, count, strengths);
    } else {
      for (int64_t k = 0; k < count; k++)
        strengths[k] = 1.0F / (float)lamp->sample_count;
    }
    if (meets_solids) meet_solids(g, lamp, emitter, first, count, strengths);
    for (int64_t k = 0; k < count; k++)
      out_is_lit[first + k] = strengths[k] > 0.0F;
  }
}

/* Optical depth to a sample of a light. */
static int32_t find_depths(const fum_gathering *g, const fum_lamp *lamp, const fum_emitter *emitter,
                           const uint8_t *is_lit, const float progress[2], float *depths) {
  if (lamp->desc.casts_shadows != 0) {
    fum_medium *medium = &g->media->items[fum_media_find(g->media, lamp)];
    return fum_solver_solve(g->context, g->solver, medium, g->receivers, emitter, is_lit, progress, depths);
  }
  memset(depths, 0, (size_t)g->receivers->octree->count * sizeof *depths);
  return FUM_OK;
}

/* What arrives of a sample at receivers next to each other. */
static void find_arriving(int64_t count, const float *strengths, const uint8_t *is_lit, const float *depths,
                          float *out) {
  const float log2_e = 1.44269504F;
  const int64_t whole = count / FUM_LANES * FUM_LANES;
  for (int64_t k = 0; k < whole; k += FUM_LANES)
    fum_vf_store(out + k, fum_vf_load(strengths + k) * fum_vf_exp2(-log2_e * fum_vf_load(depths + k)));
  for (int64_t k = whole; k < count; k++)
    out[k] = strengths[k] * expf(-depths[k]);
  for (int64_t k = 0; k < count; k++)
    out[k] = is_lit[k] ? out[k] : 0.0F;
}

static void put_colors(const float color[3], int64_t count, const float *light, bool adds, float *out_rgb) {
  const float red = color[0], green = color[1], blue = color[2];
  for (int64_t k = 0; k < count; k++) {
    float *rgb = out_rgb + 3 * k;
    rgb[0] = (adds ? rgb[0] : 0.0F) + red * light[k];
    rgb[1] = (adds ? rgb[1] : 0.0F) + green * light[k];
    rgb[2] = (adds ? rgb[2] : 0.0F) + blue * light[k];
  }
}

/* A sample of a light on its way into the light's sum, or with the last one into the result. */
typedef struct arrival {
  const float *strengths, *depths; /* [count] */
  const uint8_t *is_lit;           /* [count] */
  bool is_first, is_last, adds;    /* of the light; the result has light already */
  float *sums;                     /* [count]; NULL: this is the only one */
  float *out_rgb;                  /* [3 count] */
} arrival;

/* What isn't to be added to is written without being read: it may be fresh memory. */
static void add_sample(const fum_gathering *g, const float color[3], const arrival *a) {
  const int64_t total = g->receivers->octree->count;
#pragma omp parallel for num_threads(fum_thread_count(g->context)) schedule(static)
  for (int64_t stretch = 0; stretch < stretches_of(total); stretch++) {
    const int64_t first = stretch * STRETCH, left = total - first, count = left < STRETCH ? left : STRETCH;
    float own[STRETCH];
    find_arriving(count, a->strengths + first, a->is_lit + first, a->depths + first, own);
    for (int64_t k = 0; k < count && !a->is_first; k++)
      own[k] += a->sums[first + k];
    if (a->is_last) {
      put_colors(color, count, own, a->adds, a->out_rgb + 3 * first);
    } else {
      memcpy(a->sums + first, own, (size_t)count * sizeof *own);
    }
  }
}

int32_t fum_gather_light(const fum_gathering *g, const fum_lamp *lamp, const float progress[2], bool adds,
                         float *out_rgb) {
  fum_context *context = g->context;
  const int64_t count = g->receivers->octree->count;
  float *strengths = NULL, *depths = NULL, *sums = NULL;
  uint8_t *is_lit = NULL;
  int32_t status = fum_alloc(context, count, sizeof *strengths, "lighting", &strengths);
  if (status == FUM_OK) status = fum_alloc(context, count, sizeof *depths, "lighting", &depths);
  if (status == FUM_OK) status = fum_alloc(context, count, sizeof *is_lit, "lighting", &is_lit);
  if (status == FUM_OK && lamp->sample_count > 1) status = fum_alloc(context, count, sizeof *sums, "lighting", &sums);
  for (int32_t sample = 0; status == FUM_OK && sample < lamp->sample_count; sample++) {
    const float step = (progress[1] - progress[0]) / (float)lamp->sample_count;
    const float from = progress[0] + step * (float)sample;
    const fum_emitter emitter = fum_lamp_sample(lamp, sample);
    find_strengths(g, lamp, &emitter, strengths, is_lit);
    status = fum_progress_report(context, FUM_STAGE_LIGHTING, from, "Lighting particles");
    if (status != FUM_OK) break;
    status = find_depths(g, lamp, &emitter, is_lit, (float[2]){from, from + step}, depths);
    if (status != FUM_OK) break;
    if (g->listen != NULL) g->listen(g->listen_user, lamp, &emitter, is_lit, depths);
    const bool is_last = sample + 1 == lamp->sample_count;
    add_sample(g, lamp->color, &(arrival){strengths, depths, is_lit, sample == 0, is_last, adds, sums, out_rgb});
  }
  fum_free(context, &is_lit);
  fum_free(context, &sums);
  fum_free(context, &depths);
  fum_free(context, &strengths);
  return status;
}

/* The lamp's own sample that is nearest to one of a finer division. */
static int32_t nearest_sample(const fum_lamp *lamp, const fum_emitter *fine) {
  int32_t nearest = 0;
  float least = INFINITY;
  for (int32_t k = 0; k < lamp->sample_count; k++) {
    const fum_emitter own = fum_lamp_sample(lamp, k);
    const fum_vec3 gap = fum_sub(fine->is_directional ? own.direction : own.position,
                                 fine->is_directional ? fine->direction : fine->position);
    if (fum_dot(gap, gap) >= least) continue;
    least = fum_dot(gap, gap);
    nearest = k;
  }
  return nearest;
}

int32_t fum_gather_on_surfaces(const fum_gathering *g, const fum_lamp *lamp, int32_t fine_count,
                               const float progress[2], float *out_light, float *out_clear) {
  fum_context *context = g->context;
  const int64_t count = g->receivers->octree->count;
  fum_lamp fine = *lamp;
  fine.sample_count = fine_count;
  float *strengths = NULL, *depths = NULL;
  uint8_t *is_lit = NULL;
  int32_t status = fum_alloc(context, count, sizeof *strengths, "lighting", &strengths);
  if (status == FUM_OK) status = fum_alloc(context, count, sizeof *depths, "lighting", &depths);
  if (status == FUM_OK) status = fum_alloc(context, count, sizeof *is_lit, "lighting", &is_lit);
  for (int32_t k = 0; k < lamp->sample_count && status == FUM_OK; k++) {
    const float step = (progress[1] - progress[0]) / (float)lamp->sample_count, from = progress[0] + step * (float)k;
    const fum_emitter own = fum_lamp_sample(lamp, k);
    memset(is_lit, 1, (size_t)count * sizeof *is_lit);
    status = find_depths(g, lamp, &own, is_lit, (float[2]){from, from + step}, depths);
    for (int32_t f = 0; f < fine_count && status == FUM_OK; f++) {
      const fum_emitter sample = fum_lamp_sample(&fine, f);
      if (nearest_sample(lamp, &sample) != k) continue;
      find_strengths(g, &fine, &sample, strengths, is_lit);
#pragma omp parallel for num_threads(fum_thread_count(context)) schedule(static)
      for (int64_t i = 0; i < count; i++) {
        if (!is_lit[i]) continue;
        out_light[i] += strengths[i] * expf(-depths[i]);
        out_clear[i] += strengths[i];
      }
      status = fum_progress_report(context, FUM_STAGE_PASSES, from, "Lighting surfaces");
    }
  }
  fum_free(context, &is_lit);
  fum_free(context, &depths);
  fum_free(context, &strengths);
  return status;
}

/* What the samples of a light add up to at each receiver. */
typedef struct sums {
  float *sent, *arriving, *unblocked; /* irradiance sent, past smoke, past smoke and solids */
} sums;

static void weigh_sample(const fum_gathering *g, const fum_lamp *lamp, const fum_emitter *emitter, const float *depths,
                         const sums *s) {
  const fum_octree *octree = g->receivers->octree;
#pragma omp parallel for num_threads(fum_thread_count(g->context)) schedule(dynamic, 1024)
  for (int64_t i = 0; i < octree->count; i++) {
    if (fum_progress_in_loop(g->context, i, 1 << 14)) continue;
    const fum_vec3 point = point_of(octree, i);
    const fum_way way = fum_emitter_way(emitter, point);
    /* Outside of its beam a light has no weight of its own, but interpolation needs an optical depth there. */
    const float sent = fmaxf(fum_emitter_irradiance(lamp, emitter, point), 1e-20F);
    const float arriving = sent * expf(-fminf(depths[i], 40.0F));
    s->sent[i] += sent;
    s->arriving[i] += arriving;
    const bool is_blocked = lamp->desc.casts_shadows != 0 &&
                            fum_solids_occlude(g->solids, lamp->desc.shadow_sets, point, way.direction, way.length);
    if (s->unblocked != NULL && !is_blocked) s->unblocked[i] += arriving;
  }
}

static void average(const fum_gathering *g, bool is_single, const sums *s, float *depths, float *out_visible) {
  const int64_t count = g->receivers->octree->count;
#pragma omp parallel for num_threads(fum_thread_count(g->context)) schedule(static)
  for (int64_t i = 0; i < count; i++) {
    /* A single sample's depth stays as it is, however large. */
    if (!is_single) depths[i] = -logf(s->arriving[i] / s->sent[i]);
    if (out_visible != NULL) {
      const float share = s->unblocked != NULL ? s->unblocked[i] / s->arriving[i] : 1.0F;
      out_visible[i] = 1.0F - g->solid_shadow_intensity * (1.0F - share);
    }
  }
}

int32_t fum_gather_depths(const fum_gathering *g, const fum_lamp *lamp, const float progress[2], float *out_depths,
                          float *out_visible) {
  fum_context *context = g->context;
  const int64_t count = g->receivers->octree->count;
  const bool needs_rays = g->solids != NULL && out_visible != NULL, needs_sums = needs_rays || lamp->sample_count > 1;
  sums s = {0};
  uint8_t *is_lit = NULL;
  int32_t status = fum_alloc(context, count, sizeof *is_lit, "lighting", &is_lit);
  if (status == FUM_OK && needs_sums) status = fum_alloc(context, count, sizeof *s.sent, "lighting", &s.sent);
  if (status == FUM_OK && needs_sums) status = fum_alloc(context, count, sizeof *s.arriving, "lighting", &s.arriving);
  if (status == FUM_OK && needs_rays) status = fum_alloc(context, count, sizeof *s.unblocked, "lighting", &s.unblocked);
  if (status != FUM_OK) goto done;
  memset(is_lit, 1, (size_t)count * sizeof *is_lit);
  for (int32_t sample = 0; sample < lamp->sample_count; sample++) {
    const float step = (progress[1] - progress[0]) / (float)lamp->sample_count;
    const float from = progress[0] + step * (float)sample;
    const fum_emitter emitter = fum_lamp_sample(lamp, sample);
    status = find_depths(g, lamp, &emitter, is_lit, (float[2]){from, from + step}, out_depths);
    if (status != FUM_OK) goto done;
    if (needs_sums) weigh_sample(g, lamp, &emitter, out_depths, &s);
    status = fum_progress_report(context, FUM_STAGE_LIGHTING, from + step, "Lighting smoke");
    if (status != FUM_OK) goto done;
  }
  average(g, lamp->sample_count == 1, &s, out_depths, out_visible);
done:
  fum_free(context, &is_lit);
  fum_free(context, &s.unblocked);
  fum_free(context, &s.arriving);
  fum_free(context, &s.sent);
  return status;
}

/* Unit direction to the viewer; none where nobody knows it, for smoke that scatters evenly doesn't ask. */
static fum_vec3 viewer_of(const fum_gathering *g, fum_vec3 point) {
  return g->viewpoint != NULL ? fum_direction_to_viewer(g->viewpoint, point) : (fum_vec3){0};
}

/* An environment's lamps on their way, and their sums. */
typedef struct around {
  const fum_lamp *lamps;
  int32_t lamp_count;
  fum_sky_peak *peaks; /* [lamp_count][count] */
  float *arriving,
      *unblocked; /* [lamp_count][count] past smoke, past smoke and solids; the latter NULL: not asked for */
} around;

static void find_peaks(const fum_gathering *g, const around *a) {
  const fum_octree *octree = g->receivers->octree;
#pragma omp parallel for num_threads(fum_thread_count(g->context)) schedule(static)
  for (int64_t i = 0; i < octree->count; i++) {
    const fum_vec3 to_viewer = viewer_of(g, point_of(octree, i));
    for (int32_t l = 0; l < a->lamp_count; l++) {
      const fum_lamp *lamp = &a->lamps[l];
      a->peaks[l * octree->count + i] =
          fum_environment_peak(lamp->environment, lamp->channel, lamp->anisotropy, to_viewer);
    }
  }
}

/* Adds part `part` of the surroundings, which comes through `found`. */
static void add_part(const fum_gathering *g, const around *a, int32_t part, const float *found) {
  const float dark = 20.0F; /* optical depth past which it doesn't matter what solids do */
  const fum_octree *octree = g->receivers->octree;
  const fum_environment *e = a->lamps->environment;
  const fum_vec3 direction = e->parts[part].direction;
  const bool needs_rays = a->unblocked != NULL && a->lamps->desc.casts_shadows != 0;
#pragma omp parallel for num_threads(fum_thread_count(g->context)) schedule(dynamic, 1024)
  for (int64_t i = 0; i < octree->count; i++) {
    if (fum_progress_in_loop(g->context, i, 1 << 14)) continue;
    const fum_vec3 point = point_of(octree, i), to_viewer = viewer_of(g, point);
    const float passing = expf(-fminf(found[i], 40.0F));
    const bool is_blocked = needs_rays && found[i] < dark &&
                            fum_solids_occlude(g->solids, a->lamps->desc.shadow_sets, point, direction, INFINITY);
    for (int32_t l = 0; l < a->lamp_count; l++) {
      const int64_t at = l * octree->count + i;
      const fum_lamp *lamp = &a->lamps[l];
      const float weight = fum_sky_weight(e, part, lamp->channel, lamp->anisotropy, to_viewer, &a->peaks[at]);
      a->arriving[at] += weight * passing;
      if (a->unblocked != NULL && !is_blocked) a->unblocked[at] += weight * passing;
    }
  }
}

/* Turns what arrives into means, as optical depth and as the share that solids let through. */
static void average_around(const fum_gathering *g, const around *a, int32_t index) {
  const fum_octree *octree = g->receivers->octree;
  const fum_lamp *lamp = &a->lamps[index];
  const fum_environment *e = lamp->environment;
#pragma omp parallel for num_threads(fum_thread_count(g->context)) schedule(static)
  for (int64_t i = 0; i < octree->count; i++) {
    const int64_t at = index * octree->count + i;
    const fum_vec3 to_viewer = viewer_of(g, point_of(octree, i));
    float sent = 0.0F;
    for (int32_t part = 0; part < e->count; part++)
      sent += fum_sky_weight(e, part, lamp->channel, lamp->anisotropy, to_viewer, &a->peaks[at]);
    const float arriving = fmaxf(a->arriving[at], 1e-18F * sent);
    if (a->unblocked != NULL) {
      const float share = fminf(fmaxf(a->unblocked[at] / arriving, 0.0F), 1.0F);
      a->unblocked[at] = 1.0F - g->solid_shadow_intensity * (1.0F - share);
    }
    a->arriving[at] = fmaxf(0.0F, -logf(arriving / sent));
  }
}

int32_t fum_gather_around(const fum_gathering *g, const fum_lamp *lamps, int32_t lamp_count, const float progress[2],
                          float *out_depths, float *out_visible) {
  fum_context *context = g->context;
  const int64_t count = g->receivers->octree->count;
  const float step = (progress[1] - progress[0]) / (float)lamps->sample_count;
  around a = {lamps, lamp_count, NULL, out_depths, out_visible};
  float *found = NULL;
  uint8_t *is_lit = NULL;
  int32_t status = fum_alloc(context, count, sizeof *is_lit, "lighting", &is_lit);
  if (status == FUM_OK) status = fum_alloc(context, count, sizeof *found, "lighting", &found);
  if (status == FUM_OK) status = fum_alloc(context, lamp_count * count, sizeof *a.peaks, "lighting", &a.peaks);
  if (status != FUM_OK) goto done;
  find_peaks(g, &a);
  memset(is_lit, 1, (size_t)count * sizeof *is_lit);
  memset(out_depths, 0, (size_t)(lamp_count * count) * sizeof *out_depths);
  if (out_visible != NULL) memset(out_visible, 0, (size_t)(lamp_count * count) * sizeof *out_visible);
  for (int32_t part = 0; part < lamps->sample_count; part++) {
    const float from = progress[0] + step * (float)part;
    const fum_emitter emitter = fum_lamp_sample(lamps, part);
    status = find_depths(g, lamps, &emitter, is_lit, (float[2]){from, from + step}, found);
    if (status == FUM_OK) add_part(g, &a, part, found);
    if (status == FUM_OK) status = fum_progress_report(context, FUM_STAGE_LIGHTING, from + step, "Lighting smoke");
    if (status != FUM_OK) goto done;
  }
  for (int32_t l = 0; l < lamp_count; l++)
    average_around(g, &a, l);
done:
  fum_free(context, &a.peaks);
  fum_free(context, &is_lit);
  fum_free(context, &found);
  return status;
}
