/* SPDX-License-Identifier: GPL-3.0-or-later */
#include "api/particle_light.h"

#include "lighting/inscatter.h"

/* An exact solver keeps every particle within a tenth of the tolerance; of a sweep, errors as small as a quarter of it
 * in the root mean square don't show. */
static bool keeps_tolerance(const fum_rendering *r, const fum_lighting *lighting, const fum_accuracy *accuracy) {
  if (lighting->solver.sweep_count > 0) return accuracy->rms <= 0.25 * (double)r->settings.tolerance;
  return accuracy->worst <= (double)fum_transmittance_error(&r->settings);
}

/* Lights every particle, and measures that. */
static int32_t light_once(fum_rendering *r, fum_lighting *lighting, float *const *by_light, float *light,
                          bool *out_keeps) {
  const fum_meter_options options = fum_find_meter_options(r, lighting);
  const fum_viewpoint viewpoint = fum_find_viewpoint(&r->view);
  fum_meter meter = {0};
  fum_accuracy accuracy;
  int32_t status = fum_meter_begin_particles(r->context, &options, &meter);
  if (status != FUM_OK) return status;
  lighting->gathering.listen = fum_meter_listen;
  lighting->gathering.listen_user = &meter;
  status = fum_inscatter(r->scene, &lighting->gathering, &lighting->lamps, &viewpoint, by_light, light);
  if (status == FUM_OK) status = fum_meter_read(&meter, &accuracy);
  if (status == FUM_OK) {
    fum_note_accuracy(&accuracy, &r->stats);
    *out_keeps = keeps_tolerance(r, lighting, &accuracy);
  }
  r->stats.meter_s += meter.seconds;
  fum_meter_end(&meter);
  return status;
}

int32_t fum_light_particles(fum_rendering *r, fum_lighting *lighting, float *const *by_light, float *out_light) {
  bool keeps = true;
  int32_t status = light_once(r, lighting, by_light, out_light, &keeps);
  while (status == FUM_OK && !keeps && fum_solver_fall_back(&lighting->solver))
    status = light_once(r, lighting, by_light, out_light, &keeps);
  for (int32_t l = 0; l < r->scene->light_count && by_light != NULL && status == FUM_OK; l++) {
    for (int64_t i = 0; i < 3 * r->scene->caches->all->count && by_light[l] != NULL; i++)
      out_light[i] += by_light[l][i];
  }
  if (status == FUM_OK && !keeps) {
    fum_warn(r->context,
             "light misses the tolerance %g: particles' transmittances to lights are wrong by %.2g at worst, "
             "%.2g in the root mean square",
             (double)r->settings.tolerance, r->stats.accuracy_worst, r->stats.accuracy_rms);
  }
  return status;
}
