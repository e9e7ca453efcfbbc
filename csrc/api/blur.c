/* SPDX-License-Identifier: GPL-3.0-or-later */
#include "api/caches.h"
#include "api/settings.h"
#include "billboard/blur_meter.h"
#include "lighting/smears.h"

int32_t fum_blur_measure(fum_scene *scene, const fum_camera *camera, const fum_settings *settings, double *out_error,
                         int32_t *out_samples) {
  fum_settings checked;
  fum_view view;
  fum_blur_errors errors = {0};
  fum_progress_begin(scene->context);
  int32_t status = fum_settings_check(scene->context, settings, &checked);
  if (status == FUM_OK) status = fum_view_init(scene->context, camera, &view);
  if (status != FUM_OK) return status;
  if (fum_camera_blurs(camera)) {
    status = fum_caches_update(scene, &checked);
    if (status != FUM_OK) return status;
    fum_view_place(&view, scene->origin);
    const fum_caches *caches = scene->caches;
    status = fum_blur_meter_read(scene, caches->all, caches->solids, camera, &view, &errors);
    if (status != FUM_OK) return status;
  }
  *out_error = errors.of[0];
  *out_samples = fum_blur_samples_needed(&errors, (double)checked.tolerance);
  return FUM_OK;
}
