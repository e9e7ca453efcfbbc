/* SPDX-License-Identifier: GPL-3.0-or-later */
#include "api/combine.h"
#include "billboard/arrange.h"
#include "billboard/gl.h"
#include "lighting/inscatter.h"

static int32_t measure_particles(fum_rendering *r, const fum_meter *meter) {
  const double allowed = (double)fum_transmittance_error(&r->settings);
  fum_accuracy accuracy;
  const int32_t status = fum_meter_read(meter, &accuracy);
  if (status != FUM_OK) return status;
  fum_note_accuracy(&accuracy, &r->stats);
  if (accuracy.worst > allowed) {
    fum_warn(r->context,
             "light misses the tolerance %g: a particle's transmittance to a light is wrong by %.2g, %.2g are allowed",
             (double)r->settings.tolerance, accuracy.worst, allowed);
  }
  return FUM_OK;
}

static int32_t light_particles(fum_rendering *r, float **out_light) {
  const double start_s = fum_now_s();
  const fum_octree *all = r->scene->caches->all;
  fum_lighting lighting = {0};
  fum_meter meter = {0};
  float *light = NULL;
  int32_t status = fum_alloc(r->context, all->count, 3 * sizeof *light, "light of the particles", &light);
  if (status == FUM_OK) status = fum_lighting_begin(r->scene, &r->settings, all, &lighting);
  if (status == FUM_OK) status = fum_receivers_group(r->context, all, &lighting.receivers);
  const fum_meter_options options = fum_find_meter_options(r, &lighting);
  if (status == FUM_OK) status = fum_meter_begin_particles(r->context, &options, &meter);
  if (status != FUM_OK) goto done;
  lighting.gathering.listen = fum_meter_listen;
  lighting.gathering.listen_user = &meter;
  const fum_viewpoint viewpoint = fum_find_viewpoint(&r->view);
  status = fum_inscatter(r->scene, &lighting.gathering, lighting.lamps, &viewpoint, light);
  if (status == FUM_OK) status = measure_particles(r, &meter);
  if (status != FUM_OK) goto done;
  r->stats.light_points = all->count;
  r->stats.meter_s = meter.seconds;
  fum_note_lighting(&lighting, r);
  r->stats.light_s = fum_now_s() - start_s - meter.seconds;
  *out_light = light;
  light = NULL;
done:
  fum_meter_end(&meter);
  fum_lighting_end(r->context, &lighting);
  fum_free(r->context, &light);
  return status;
}

static fum_frame make_frame(const fum_rendering *r) {
  const fum_view *view = &r->view;
  fum_frame frame = {.type = view->type,
                     .width = view->width,
                     .height = view->height,
                     .clip_start = (float)view->clip_start,
                     .clip_end = (float)view->clip_end,
                     .footprint_sigmas = fum_footprint_sigmas(r->settings.tolerance),
                     .solid_depths = r->solid_depths};
  for (int i = 0; i < 4; i++)
    frame.window[i] = (float)view->window[i];
  return frame;
}

static int32_t draw_billboards(fum_rendering *r, const float *light) {
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

int32_t fum_combine_with_gl(fum_rendering *r) {
  float *light = NULL;
  int32_t status = light_particles(r, &light);
  if (status == FUM_OK) status = draw_billboards(r, light);
  fum_free(r->context, &light);
  return status;
}
