/* SPDX-License-Identifier: GPL-3.0-or-later */
#include "api/combine.h"

float fum_footprint_sigmas(const fum_scene *scene, float tolerance) {
  return sqrtf(2.0F * logf(4.0F * fum_scene_map_traits(scene).edge / fminf(tolerance, 1.0F)));
}

fum_viewpoint fum_find_viewpoint(const fum_view *view) {
  const double *m = view->local_from_camera;
  return (fum_viewpoint){.is_directional = view->type == FUM_CAMERA_ORTHOGRAPHIC,
                         .position = {(float)m[3], (float)m[7], (float)m[11]},
                         .direction = {(float)m[2], (float)m[6], (float)m[10]}};
}

fum_meter_options fum_find_meter_options(const fum_rendering *r, const fum_lighting *lighting) {
  return (fum_meter_options){.scene = r->scene,
                             .octree = r->scene->caches->all,
                             .media = lighting->media,
                             .lamps = &lighting->lamps,
                             .viewpoint = fum_find_viewpoint(&r->view),
                             .error = 0.01 * (double)fum_transmittance_error(&r->settings)};
}

void fum_note_accuracy(const fum_accuracy *accuracy, fum_render_stats *stats) {
  stats->accuracy_count = accuracy->count;
  stats->accuracy_rms = accuracy->rms;
  stats->accuracy_p95 = accuracy->p95;
  stats->accuracy_worst = accuracy->worst;
  stats->accuracy_bias = accuracy->bias;
}

void fum_note_lighting(const fum_lighting *lighting, fum_rendering *r) {
  const bool is_swept = lighting->solver.sweep_count > 0 && lighting->solver.exact_count == 0;
  r->stats.solver = is_swept ? FUM_SOLVER_SWEEP : FUM_SOLVER_EXACT;
  r->stats.light_sample_count = fum_lamps_sample_count(&lighting->lamps);
}
