/* SPDX-License-Identifier: GPL-3.0-or-later */
#include "api/smeared.h"

float fum_least_blur(const fum_settings *settings) {
  return sqrtf(0.1F * settings->tolerance);
}

static void warn_of_maps(const fum_rendering *r) {
  for (int32_t s = 0; s < r->scene->particles_count; s++) {
    const fum_particles *set = &r->scene->particles[s];
    if (set->map != NULL)
      fum_warn(r->context, "%s: its map isn't seen where motion blur or depth of field smears particles", set->name);
  }
}

int32_t fum_smeared_find(const fum_rendering *r, fum_smeared *out) {
  if (!fum_camera_blurs(r->camera)) return FUM_OK;
  int32_t status = fum_smears_find(r->scene, r->scene->caches->all, r->camera, &r->view, &out->smears);
  if (status == FUM_OK && out->smears.worst <= (double)fum_least_blur(&r->settings)) {
    fum_smeared_free(r->context, out);
    return FUM_OK;
  }
  if (status == FUM_OK) warn_of_maps(r);
  if (status == FUM_OK && r->camera->aperture_radius > 0.0) status = fum_bokeh_find(r->context, r->camera, &out->bokeh);
  return status;
}

void fum_smeared_free(fum_context *context, fum_smeared *smeared) {
  fum_smears_free(context, &smeared->smears);
  fum_bokeh_free(context, &smeared->bokeh);
}
