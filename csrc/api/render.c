/* SPDX-License-Identifier: GPL-3.0-or-later */
#include "api/passes.h"
#include "api/settings.h"
#include "api/shadow.h"
#include "api/solids.h"
#include "billboard/deep.h"
#include "octree/beam.h"
#include "pass/depth.h"

#include <string.h>

void fum_render_stats_init(fum_render_stats *stats) {
  *stats = (fum_render_stats){.struct_size = sizeof *stats};
}

static int64_t pixel_count(const fum_rendering *r) {
  return (int64_t)r->view.width * r->view.height;
}

/* Adds what one channel took; light is as far off as in the channel where it is farthest. */
static void add_stats(const fum_render_stats *channel, fum_render_stats *stats) {
  const bool is_worse = channel->accuracy_rms >= stats->accuracy_rms;
  stats->light_sample_count = channel->light_sample_count;
  if (stats->solver == FUM_SOLVER_AUTOMATIC || channel->solver == FUM_SOLVER_EXACT) stats->solver = channel->solver;
  if (channel->drawn_count > stats->drawn_count) stats->drawn_count = channel->drawn_count;
  if (channel->slab_count > stats->slab_count) stats->slab_count = channel->slab_count;
  stats->light_s += channel->light_s;
  stats->sort_s += channel->sort_s;
  stats->draw_s += channel->draw_s;
  stats->passes_s += channel->passes_s;
  stats->meter_s += channel->meter_s;
  memcpy(stats->device, channel->device, sizeof stats->device);
  stats->light_points += channel->light_points;
  stats->refinement_count += channel->refinement_count;
  if (!is_worse) return;
  stats->accuracy_count = channel->accuracy_count;
  stats->accuracy_rms = channel->accuracy_rms;
  stats->accuracy_p95 = channel->accuracy_p95;
  stats->accuracy_worst = channel->accuracy_worst;
  stats->accuracy_bias = channel->accuracy_bias;
}

static int32_t make_combined(fum_rendering *r) {
  int32_t status = fum_solids_begin(r);
  if (status != FUM_OK) return status;
  status = r->settings.device == FUM_DEVICE_GL ? fum_combine_with_gl(r) : fum_combine_with_tiles(r);
  return status == FUM_OK ? fum_solids_compose(r) : status;
}

static int32_t make_depths(fum_rendering *r) {
  const fum_octree *all = r->scene->caches->all;
  float *const depths[] = {r->depth, r->depth_front, r->depth_back}, *reaches = NULL;
  const fum_depth_of of[] = {FUM_DEPTH_OF_HALF, FUM_DEPTH_OF_FRONT, FUM_DEPTH_OF_BACK};
  if (depths[0] == NULL && depths[1] == NULL && depths[2] == NULL) return FUM_OK;
  /* Depth is where the transmittance passes one half; a tenth of the tolerance there is a small step in depth. */
  int32_t status = fum_reach_find(r->context, all, 0.1F * r->settings.tolerance, &reaches);
  for (int k = 0; k < 3 && status == FUM_OK; k++) {
    if (depths[k] != NULL) status = fum_depth_find(r->scene, all, reaches, &r->view, r->solid.depths, of[k], depths[k]);
  }
  fum_free(r->context, &reaches);
  return status;
}

static void make_position(fum_rendering *r) {
  const fum_view *view = &r->view;
#pragma omp parallel for num_threads(fum_thread_count(r->context)) schedule(static)
  for (int64_t i = 0; i < pixel_count(r); i++) {
    double start[3], direction[3];
    const double depth = (double)r->depth[i];
    fum_view_ray(view, (double)(i % view->width) + 0.5, (double)(i / view->width) + 0.5, start, direction);
    for (int axis = 0; axis < 3; axis++) {
      const double place = r->scene->origin[axis] + start[axis] + depth * direction[axis];
      r->position[3 * i + axis] = depth < view->clip_end ? (float)place : 0.0F;
    }
  }
}

static bool needs_shadow(const fum_rendering *r) {
  for (int32_t l = 0; l < r->scene->light_count; l++) {
    if (r->light_shadows[l] != NULL) return true;
  }
  return r->shadow != NULL;
}

/* Passes in colour, by the extinction of the rendering's scene. */
static int32_t make_colors(fum_rendering *r) {
  int32_t status = r->combined != NULL ? make_combined(r) : FUM_OK;
  if (status == FUM_OK && r->deep != NULL) status = fum_deep_gather(r->deep);
  const double start_s = fum_now_s();
  if (status == FUM_OK && needs_shadow(r)) status = fum_shadow_find(r);
  r->stats.passes_s = fum_now_s() - start_s;
  return status;
}

/* What is in the channels of a colour that are seen in scene `k`; alpha is the mean of the three. */
static void take_color(const fum_channels *channels, int32_t k, int64_t pixels, int32_t width, const float *from,
                       float *to) {
  for (int c = 0; c < 3; c++) {
    if (channels->of[c] != k) continue;
    for (int64_t i = 0; i < pixels; i++) {
      to[width * i + c] = from[width * i + c];
      if (width == 4) to[width * i + 3] += from[width * i + 3] / 3.0F;
    }
  }
}

/* Adds what scene `k` has of a pass without colours, which is the mean over red, green and blue. */
static void take_value(float share, int64_t count, const float *from, float *to) {
  for (int64_t i = 0; i < count; i++)
    to[i] += share * from[i];
}

/* Drawn passes of `r` as one of the channels' scenes has them. Mattes are entered in place; deep pixels are given to
 * the caller, who joins those of all. */
static int32_t make_channel(fum_rendering *r, const fum_channels *channels, int32_t k, fum_deep **out_deep) {
  fum_rendering part = {.context = r->context,
                        .scene = channels->scenes[k],
                        .settings = r->settings,
                        .camera = r->camera,
                        .view = r->view,
                        .solid = r->solid,
                        .crypto_count = r->crypto_count};
  fum_pass_info info;
  for (int c = 0; c < 3; c++)
    part.channel_share += channels->of[c] == k ? 1.0F / 3.0F : 0.0F;
  memcpy(part.crypto, r->crypto, sizeof part.crypto);
  fum_render_stats_init(&part.stats);
  int32_t status = fum_passes_allocate_lists(&part);
  for (int32_t i = 0; fum_pass_get(i, &info) == FUM_OK; i++) {
    for (int32_t n = 0; n < fum_pass_count(r, &info) && status == FUM_OK; n++) {
      if (fum_pass_is_by_channel(&info) && *fum_pass_place(r, info.pass, n) != NULL)
        status = fum_pass_allocate(&part, info.pass, n);
    }
  }
  if (status == FUM_OK && r->deep != NULL) status = fum_deep_create(r->context, &r->view, &part.deep);
  if (status == FUM_OK) status = make_colors(&part);
  *out_deep = part.deep;
  for (int32_t i = 0; fum_pass_get(i, &info) == FUM_OK && status == FUM_OK; i++) {
    for (int32_t n = 0; n < fum_pass_count(r, &info); n++) {
      float *to = fum_pass_is_by_channel(&info) ? *fum_pass_place(r, info.pass, n) : NULL;
      if (to == NULL) continue;
      const float *from = *fum_pass_place(&part, info.pass, n);
      if (fum_pass_is_color(&info)) {
        take_color(channels, k, pixel_count(r), info.channel_count, from, to);
      } else {
        take_value(part.channel_share, pixel_count(r) * info.channel_count, from, to);
      }
    }
  }
  add_stats(&part.stats, &r->stats);
  memset(part.crypto, 0, sizeof part.crypto);
  fum_passes_free(&part);
  return status;
}

/* Passes that aren't colours, by the mean extinction. */
static int32_t make_values(fum_rendering *r) {
  const double start_s = fum_now_s();
  const int32_t status = make_depths(r);
  for (int64_t i = 0; i < pixel_count(r) && r->opacity != NULL; i++)
    r->opacity[i] = r->combined[4 * i + 3];
  if (status == FUM_OK && r->position != NULL) make_position(r);
  r->stats.passes_s += fum_now_s() - start_s;
  return status;
}

static int32_t make_channels(fum_rendering *r, const fum_channels *channels) {
  fum_deep *deeps[3] = {NULL};
  int32_t status = FUM_OK;
  for (int32_t k = 0; k < channels->count && status == FUM_OK; k++)
    status = make_channel(r, channels, k, &deeps[k]);
  if (status == FUM_OK && r->deep != NULL)
    status = fum_deep_join(deeps, channels->count, channels->of, 0.5F * r->settings.tolerance, r->deep);
  for (int k = 0; k < 3; k++)
    fum_deep_destroy(deeps[k]);
  return status;
}

static int32_t make_passes(fum_rendering *r, const fum_channels *channels) {
  const int32_t status = channels->count == 1 ? make_colors(r) : make_channels(r, channels);
  return status == FUM_OK ? make_values(r) : status;
}

static void fill_stats(fum_rendering *r) {
  const fum_scene *scene = r->scene;
  fum_render_stats *stats = &r->stats;
  stats->light_count = scene->light_count;
  stats->particle_count = scene->particle_count;
  for (int32_t i = 0; i < scene->mesh_count; i++)
    stats->triangle_count += scene->meshes[i].triangle_count;
  stats->memory_bytes = atomic_load(&r->context->memory_peak_bytes);
}

/* Deep pixels come with Combined, which is made for them if it isn't asked for. */
static int32_t allocate_deep(fum_rendering *r) {
  const int32_t status = fum_pass_allocate(r, FUM_PASS_COMBINED, 0);
  return status == FUM_OK ? fum_deep_create(r->context, &r->view, &r->deep) : status;
}

int32_t fum_render(fum_scene *scene, const fum_camera *camera, const fum_settings *settings, int32_t pass_count,
                   const fum_pass_buffer *passes, fum_render_stats *out_stats) {
  return fum_render_deep(scene, camera, settings, pass_count, passes, NULL, out_stats);
}

int32_t fum_render_deep(fum_scene *scene, const fum_camera *camera, const fum_settings *settings, int32_t pass_count,
                        const fum_pass_buffer *passes, fum_deep **out_deep, fum_render_stats *out_stats) {
  const double start_s = fum_now_s();
  fum_rendering r = {.context = scene->context, .scene = scene, .camera = camera, .channel_share = 1.0F};
  fum_context *context = scene->context;
  fum_render_stats_init(&r.stats);
  fum_progress_begin(context);
  atomic_store(&context->memory_peak_bytes, atomic_load(&context->memory_bytes));
  if (out_stats != NULL && out_stats->struct_size < sizeof *out_stats) {
    return fum_fail(context, FUM_ERROR_ARGUMENT, "stats: struct_size %u is not valid",
                    (unsigned)out_stats->struct_size);
  }
  int32_t status = fum_settings_check(context, settings, &r.settings);
  if (status == FUM_OK) status = fum_view_init(context, camera, &r.view);
  if (status == FUM_OK) status = fum_passes_check(&r, out_deep != NULL, pass_count, passes);
  if (status == FUM_OK) status = fum_passes_allocate(&r, pass_count, passes);
  if (status == FUM_OK && out_deep != NULL) status = allocate_deep(&r);
  const fum_channels *channels = NULL;
  if (status == FUM_OK) status = fum_channels_update(scene, &r.settings, &channels);
  if (status != FUM_OK) goto done;
  r.stats.build_s = scene->caches->build_s;
  fum_view_place(&r.view, scene->origin);
  status = fum_solid_view_find(context, scene->caches->solids, &r.view, &r.solid);
  if (status == FUM_OK && r.deep != NULL && r.settings.solids == FUM_SOLIDS_SHADED && r.solid.depths != NULL)
    fum_warn(context, "deep pixels hold the smoke alone: shaded solids aren't in them");
  if (status == FUM_OK) status = make_passes(&r, channels);
  if (status != FUM_OK) goto done;
  fum_passes_hand_over(&r, pass_count, passes);
  fill_stats(&r);
  r.stats.total_s = fum_now_s() - start_s;
  if (out_stats != NULL) *out_stats = r.stats;
  if (out_deep != NULL) {
    *out_deep = r.deep;
    r.deep = NULL;
  }
done:
  fum_deep_destroy(r.deep);
  fum_passes_free(&r);
  fum_solid_view_free(context, &r.solid);
  return status;
}
