/* SPDX-License-Identifier: GPL-3.0-or-later */
#include "api/caches.h"
#include "api/lighting.h"
#include "api/settings.h"
#include "billboard/arrange.h"
#include "billboard/gl.h"
#include "billboard/tiles.h"
#include "lighting/inscatter.h"
#include "lighting/meter.h"
#include "octree/beam.h"
#include "pass/depth.h"
#include "pass/table.h"

#include <string.h>

void fum_render_stats_init(fum_render_stats *stats) {
  *stats = (fum_render_stats){.struct_size = sizeof *stats};
}

/* One call of fum_render: what it was asked for and what it has made so far. */
typedef struct render {
  fum_context *context;
  fum_scene *scene;
  fum_settings settings;
  fum_view view;
  float *solid_depths; /* [height][width]; NULL: no solid in front of the camera */
  float *combined;     /* [height][width][4]; NULL: not asked for */
  float *depth;        /* [height][width]; NULL: not asked for */
  fum_render_stats stats;
} render;

static int64_t pixel_count(const render *r) {
  return (int64_t)r->view.width * r->view.height;
}

static int32_t check_passes(fum_context *context, const fum_view *view, int32_t pass_count,
                            const fum_pass_buffer *passes) {
  if (pass_count < 1 || passes == NULL) return fum_fail(context, FUM_ERROR_ARGUMENT, "no pass was asked for");
  for (int32_t i = 0; i < pass_count; i++) {
    const fum_pass_info *info = fum_pass_find(passes[i].pass);
    if (info == NULL) return fum_fail(context, FUM_ERROR_ARGUMENT, "pass %d is unknown", (int)passes[i].pass);
    const int64_t needed = (int64_t)view->width * view->height * info->channel_count;
    if (passes[i].pixels == NULL || passes[i].pixels_size != needed) {
      return fum_fail(context, FUM_ERROR_ARGUMENT, "pass %s: room for %lld floats was given, %lld are needed",
                      info->name, (long long)passes[i].pixels_size, (long long)needed);
    }
  }
  return FUM_OK;
}

static int32_t allocate_passes(render *r, int32_t pass_count, const fum_pass_buffer *passes) {
  int32_t status = FUM_OK;
  for (int32_t i = 0; i < pass_count && status == FUM_OK; i++) {
    if (passes[i].pass == FUM_PASS_COMBINED && r->combined == NULL) {
      status = fum_alloc(r->context, pixel_count(r), 4 * sizeof(float), "pass Combined", &r->combined);
    } else if (passes[i].pass == FUM_PASS_DEPTH && r->depth == NULL) {
      status = fum_alloc(r->context, pixel_count(r), sizeof(float), "pass Depth", &r->depth);
    }
  }
  return status;
}

/* Depth of the nearest solid for every pixel's centre. */
static int32_t find_solid_depths(render *r) {
  const fum_solids *solids = r->scene->caches->solids;
  if (!fum_solids_hide_from_camera(solids)) return FUM_OK;
  int32_t status = fum_alloc(r->context, pixel_count(r), sizeof(float), "depth of solids", &r->solid_depths);
  if (status != FUM_OK) return status;
  const fum_view *view = &r->view;
#pragma omp parallel for num_threads(fum_thread_count(r->context)) schedule(dynamic, 8)
  for (int32_t y = 0; y < view->height; y++) {
    if (fum_progress_in_loop(r->context, y, 8)) continue;
    for (int32_t x = 0; x < view->width; x++) {
      double start[3], direction[3];
      fum_view_ray(view, x + 0.5, y + 0.5, start, direction);
      const fum_vec3 from = {(float)start[0], (float)start[1], (float)start[2]};
      const fum_vec3 along = {(float)direction[0], (float)direction[1], (float)direction[2]};
      r->solid_depths[(int64_t)y * view->width + x] =
          fum_solids_hit(solids, from, along, (float)view->clip_start, (float)view->clip_end);
    }
  }
  return fum_progress_report(r->context, FUM_STAGE_PASSES, 0.0F, "Finding solids");
}

static fum_viewpoint find_viewpoint(const fum_view *view) {
  const double *m = view->local_from_camera;
  return (fum_viewpoint){.is_directional = view->type == FUM_CAMERA_ORTHOGRAPHIC,
                         .position = {(float)m[3], (float)m[7], (float)m[11]},
                         .direction = {(float)m[2], (float)m[6], (float)m[10]}};
}

static fum_meter_options meter_options(const render *r, const fum_lighting *lighting) {
  return (fum_meter_options){.octree = r->scene->caches->all,
                             .medium = &lighting->medium,
                             .lamp_count = r->scene->light_count,
                             .lamps = lighting->lamps,
                             .error = 0.01 * (double)fum_transmittance_error(&r->settings)};
}

static void note_accuracy(render *r, const fum_accuracy *accuracy) {
  r->stats.accuracy_count = accuracy->count;
  r->stats.accuracy_rms = accuracy->rms;
  r->stats.accuracy_p95 = accuracy->p95;
  r->stats.accuracy_worst = accuracy->worst;
  r->stats.accuracy_bias = accuracy->bias;
}

static int32_t measure_particles(render *r, const fum_meter *meter) {
  const double allowed = (double)fum_transmittance_error(&r->settings);
  fum_accuracy accuracy;
  const int32_t status = fum_meter_read(meter, &accuracy);
  if (status != FUM_OK) return status;
  note_accuracy(r, &accuracy);
  if (accuracy.worst > allowed) {
    fum_warn(r->context,
             "light misses the tolerance %g: a particle's transmittance to a light is wrong by %.2g, %.2g are allowed",
             (double)r->settings.tolerance, accuracy.worst, allowed);
  }
  return FUM_OK;
}

static int32_t light_particles(render *r, float **out_light) {
  const double start_s = fum_now_s();
  const fum_octree *all = r->scene->caches->all;
  fum_lighting lighting = {0};
  fum_meter meter = {0};
  float *light = NULL;
  int32_t status = fum_alloc(r->context, all->count, 3 * sizeof *light, "light of the particles", &light);
  if (status == FUM_OK) status = fum_lighting_begin(r->scene, &r->settings, all, &lighting);
  if (status == FUM_OK) status = fum_receivers_group(r->context, all, &lighting.receivers);
  const fum_meter_options options = meter_options(r, &lighting);
  if (status == FUM_OK) status = fum_meter_begin_particles(r->context, &options, &meter);
  if (status != FUM_OK) goto done;
  lighting.gathering.listen = fum_meter_listen;
  lighting.gathering.listen_user = &meter;
  const fum_viewpoint viewpoint = find_viewpoint(&r->view);
  status = fum_inscatter(r->scene, &lighting.gathering, lighting.lamps, &viewpoint, light);
  if (status == FUM_OK) status = measure_particles(r, &meter);
  if (status != FUM_OK) goto done;
  r->stats.light_points = all->count;
  r->stats.meter_s = meter.seconds;
  for (int32_t i = 0; i < r->scene->light_count; i++)
    r->stats.light_sample_count += lighting.lamps[i].sample_count;
  r->stats.light_s = fum_now_s() - start_s - meter.seconds;
  *out_light = light;
  light = NULL;
done:
  fum_meter_end(&meter);
  fum_lighting_end(r->context, &lighting);
  fum_free(r->context, &light);
  return status;
}

/* Share of a billboard's optical depth that may lie outside of what is drawn: a quarter of the tolerance. */
static float footprint_sigmas(float tolerance) {
  return sqrtf(2.0F * logf(4.0F / fminf(tolerance, 1.0F)));
}

static fum_frame make_frame(const render *r) {
  const fum_view *view = &r->view;
  fum_frame frame = {.type = view->type,
                     .width = view->width,
                     .height = view->height,
                     .clip_start = (float)view->clip_start,
                     .clip_end = (float)view->clip_end,
                     .footprint_sigmas = footprint_sigmas(r->settings.tolerance),
                     .solid_depths = r->solid_depths};
  for (int i = 0; i < 4; i++)
    frame.window[i] = (float)view->window[i];
  return frame;
}

static int32_t draw_billboards(render *r, const float *light) {
  const fum_octree *all = r->scene->caches->all;
  const fum_frame frame = make_frame(r);
  uint32_t *ranks = NULL;
  fum_billboard *billboards = NULL;
  int64_t count = 0;
  double start_s = fum_now_s();
  int32_t status = fum_progress_report(r->context, FUM_STAGE_SORTING, 0.0F, "Sorting particles by depth");
  if (status != FUM_OK) goto done;
  status = fum_arrange_order(r->scene, all, &r->view, frame.footprint_sigmas, &ranks, &count);
  if (status == FUM_OK) status = fum_alloc(r->context, count, sizeof *billboards, "billboards", &billboards);
  if (status != FUM_OK) goto done;
  fum_arrange_billboards(r->scene, all, &r->view, light, count, ranks, billboards);
  r->stats.drawn_count = count;
  r->stats.sort_s = fum_now_s() - start_s;
  start_s = fum_now_s();
  status = fum_gl_draw(r->context, &frame, count, billboards, r->combined, r->stats.device);
  r->stats.draw_s = fum_now_s() - start_s;
done:
  fum_free(r->context, &billboards);
  fum_free(r->context, &ranks);
  return status;
}

/* Every particle lit at its centre, billboards blended by OpenGL. */
static int32_t combine_with_gl(render *r) {
  float *light = NULL;
  int32_t status = light_particles(r, &light);
  if (status == FUM_OK) status = draw_billboards(r, light);
  fum_free(r->context, &light);
  return status;
}

/* Light as tiles look it up. */
typedef struct smoke_light {
  fum_slabs slabs;
  fum_lattice lattice;
} smoke_light;

static void smoke_light_free(fum_context *context, smoke_light *light) {
  fum_lattice_free(context, &light->lattice);
  fum_slabs_free(context, &light->slabs);
}

static int32_t light_smoke_once(render *r, const fum_lighting *lighting, float footprint, float thinnest,
                                float tolerance, smoke_light *out_light) {
  const fum_octree *all = r->scene->caches->all;
  smoke_light light = {0};
  int32_t status = fum_slabs_find(r->context, all, &r->view, tolerance, thinnest, &light.slabs);
  if (status == FUM_OK && light.slabs.count > 0) {
    status = fum_lattice_light(all, &r->view, &light.slabs, footprint, tolerance, &lighting->gathering,
                               r->scene->light_count, lighting->lamps, &light.lattice);
  }
  if (status != FUM_OK) {
    smoke_light_free(r->context, &light);
    return status;
  }
  *out_light = light;
  return FUM_OK;
}

/* How much of the tolerance the light takes: above 1 it is missed. The meter's points are what the camera sees, and a
 * pixel adds up the light of such points, so that their relative RMS is about the most that the picture's can be. */
static double share_of_tolerance(const render *r, const fum_accuracy *accuracy) {
  return accuracy->rms > 0.0 ? accuracy->rms / ((double)r->settings.tolerance * accuracy->level) : 0.0;
}

static int32_t measure_smoke(render *r, fum_meter *meter, const smoke_light *light, double *out_share) {
  fum_accuracy accuracy;
  fum_meter_ask(meter, &light->slabs, &light->lattice);
  const int32_t status = fum_meter_read(meter, &accuracy);
  if (status != FUM_OK) return status;
  note_accuracy(r, &accuracy);
  *out_share = share_of_tolerance(r, &accuracy);
  return FUM_OK;
}

/* Lights the smoke in view, and again in smaller steps if the meter says so. Errors of both kinds of step grow with the
 * tolerance that they are made for. */
static int32_t light_smoke(render *r, const fum_lighting *lighting, float footprint, float thinnest, fum_meter *meter,
                           smoke_light *light) {
  enum { REFINEMENTS = 2 };
  double share = 0.0;
  float tolerance = r->settings.tolerance;
  int32_t status = light_smoke_once(r, lighting, footprint, thinnest, tolerance, light);
  if (status != FUM_OK || light->slabs.count == 0) return status;
  const fum_meter_options options = meter_options(r, lighting);
  const fum_meter_sight sight = {&r->view, (double)footprint, r->solid_depths, &light->slabs, &light->lattice.hidden};
  status = fum_meter_begin_points(r->context, &options, &sight, meter);
  if (status == FUM_OK) status = measure_smoke(r, meter, light, &share);
  while (status == FUM_OK && share > 1.0 && r->stats.refinement_count < REFINEMENTS) {
    smoke_light finer;
    tolerance *= fmaxf(0.25F, 0.7F / (float)share);
    status = light_smoke_once(r, lighting, footprint, thinnest, tolerance, &finer);
    if (status != FUM_OK) break;
    smoke_light_free(r->context, light);
    *light = finer;
    r->stats.refinement_count++;
    status = measure_smoke(r, meter, light, &share);
  }
  if (status == FUM_ERROR_MEMORY && share > 1.0) {
    fum_warn(r->context, "light can't be found in smaller steps: %s", r->context->error);
    status = FUM_OK;
  }
  if (status == FUM_OK && share > 1.0) {
    fum_warn(
        r->context,
        "light misses the tolerance %g: transmittances to the lights are wrong by %.2g of their own size (root mean "
        "squares)",
        (double)r->settings.tolerance, share * (double)r->settings.tolerance);
  }
  return status;
}

/* Light on a lattice, particles added up in slabs. */
static int32_t combine_with_tiles(render *r) {
  const fum_octree *all = r->scene->caches->all;
  const float footprint = footprint_sigmas(r->settings.tolerance);
  float anisotropies[16];
  fum_lighting lighting = {0};
  fum_meter meter = {0};
  smoke_light light = {0};
  fum_splats splats = {0};
  fum_tile_job job = {.scene = r->scene,
                      .octree = all,
                      .view = &r->view,
                      .slabs = &light.slabs,
                      .splats = &splats,
                      .lattice = &light.lattice,
                      .solids = r->scene->caches->solids,
                      .solid_shadow_intensity = r->settings.solid_shadow_intensity,
                      .solid_depths = r->solid_depths,
                      .rgba = r->combined};
  double start_s = fum_now_s();
  int32_t status = fum_tiles_find_looks(r->scene, anisotropies, &job);
  if (status == FUM_OK) status = fum_lighting_begin(r->scene, &r->settings, all, &lighting);
  if (status == FUM_OK) status = light_smoke(r, &lighting, footprint, job.thinnest, &meter, &light);
  if (status != FUM_OK || light.slabs.count == 0) goto done;
  job.lamps = lighting.lamps;
  r->stats.light_points = light.lattice.lit_count;
  r->stats.slab_count = light.slabs.count;
  r->stats.meter_s = meter.seconds;
  for (int32_t i = 0; i < r->scene->light_count; i++)
    r->stats.light_sample_count += lighting.lamps[i].sample_count;
  r->stats.light_s = fum_now_s() - start_s - meter.seconds;
  start_s = fum_now_s();
  status = fum_splats_find(r->context, all, &r->view, footprint, job.thinnest, &splats);
  if (status != FUM_OK) goto done;
  fum_tiles_shade_dust(r->context, &job, &splats);
  r->stats.drawn_count = splats.seen_count;
  r->stats.sort_s = fum_now_s() - start_s;
  start_s = fum_now_s();
  status = fum_tiles_draw(r->context, &job);
  r->stats.draw_s = fum_now_s() - start_s;
  memcpy(r->stats.device, "tiles", sizeof "tiles");
done:
  fum_splats_free(r->context, &splats);
  smoke_light_free(r->context, &light);
  fum_meter_end(&meter);
  fum_lighting_end(r->context, &lighting);
  return status;
}

static int32_t make_combined(render *r) {
  return r->settings.device == FUM_DEVICE_GL ? combine_with_gl(r) : combine_with_tiles(r);
}

static int32_t make_depth(render *r) {
  const double start_s = fum_now_s();
  const fum_octree *all = r->scene->caches->all;
  float *reaches = NULL;
  /* Depth is where the transmittance passes one half; a tenth of the tolerance there is a small step in depth. */
  int32_t status = fum_reach_find(r->context, all, 0.1F * r->settings.tolerance, &reaches);
  if (status == FUM_OK) status = fum_depth_find(r->context, all, reaches, &r->view, r->solid_depths, r->depth);
  fum_free(r->context, &reaches);
  r->stats.passes_s = fum_now_s() - start_s;
  return status;
}

static void hand_over(const render *r, int32_t pass_count, const fum_pass_buffer *passes) {
  for (int32_t i = 0; i < pass_count; i++) {
    const float *from = passes[i].pass == FUM_PASS_COMBINED ? r->combined : r->depth;
    memcpy(passes[i].pixels, from, (size_t)passes[i].pixels_size * sizeof *from);
  }
}

static void fill_stats(render *r) {
  const fum_scene *scene = r->scene;
  fum_render_stats *stats = &r->stats;
  stats->light_count = scene->light_count;
  stats->solver = FUM_SOLVER_EXACT;
  stats->particle_count = scene->particle_count;
  for (int32_t i = 0; i < scene->mesh_count; i++)
    stats->triangle_count += scene->meshes[i].triangle_count;
  stats->memory_bytes = atomic_load(&r->context->memory_peak_bytes);
}

int32_t fum_render(fum_scene *scene, const fum_camera *camera, const fum_settings *settings, int32_t pass_count,
                   const fum_pass_buffer *passes, fum_render_stats *out_stats) {
  const double start_s = fum_now_s();
  render r = {.context = scene->context, .scene = scene};
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
  if (status == FUM_OK) status = check_passes(context, &r.view, pass_count, passes);
  if (status == FUM_OK) status = allocate_passes(&r, pass_count, passes);
  if (status == FUM_OK) status = fum_caches_update(scene, &r.settings);
  if (status != FUM_OK) goto done;
  r.stats.build_s = scene->caches->build_s;
  fum_view_place(&r.view, scene->origin);
  status = find_solid_depths(&r);
  if (status == FUM_OK && r.combined != NULL) status = make_combined(&r);
  if (status == FUM_OK && r.depth != NULL) status = make_depth(&r);
  if (status != FUM_OK) goto done;
  hand_over(&r, pass_count, passes);
  fill_stats(&r);
  r.stats.total_s = fum_now_s() - start_s;
  if (out_stats != NULL) *out_stats = r.stats;
done:
  fum_free(context, &r.depth);
  fum_free(context, &r.combined);
  fum_free(context, &r.solid_depths);
  return status;
}
