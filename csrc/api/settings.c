/* SPDX-License-Identifier: GPL-3.0-or-later */
#include "api/settings.h"

void fum_settings_init(fum_settings *settings) {
  *settings = (fum_settings){.struct_size = sizeof *settings,
                             .leaf_size = 64,
                             .light_samples = 16,
                             .tolerance = 0.01F,
                             .shadowing_density = 1.0F,
                             .solid_shadow_intensity = 1.0F,
                             .subsampling = 1.0F,
                             .intersection_scale = 1.0F};
}

static int32_t check_float(fum_context *context, const char *name, float value, float low, float high) {
  if (value >= low && value <= high) return FUM_OK;
  return fum_fail(context, FUM_ERROR_ARGUMENT, "settings: %s %g is not within %g..%g", name, (double)value, (double)low,
                  (double)high);
}

static int32_t check_integer(fum_context *context, const char *name, int32_t value, int32_t low, int32_t high) {
  if (value >= low && value <= high) return FUM_OK;
  return fum_fail(context, FUM_ERROR_ARGUMENT, "settings: %s %d is not within %d..%d", name, (int)value, (int)low,
                  (int)high);
}

int32_t fum_settings_check(fum_context *context, const fum_settings *settings, fum_settings *out_settings) {
  fum_settings s;
  fum_settings_init(&s);
  if (settings != NULL) {
    if (settings->struct_size < sizeof *settings) {
      return fum_fail(context, FUM_ERROR_ARGUMENT, "settings: struct_size %u is not valid",
                      (unsigned)settings->struct_size);
    }
    s = *settings;
  }
  int32_t status = check_integer(context, "solver", s.solver, FUM_SOLVER_AUTOMATIC, FUM_SOLVER_SWEEP);
  if (status == FUM_OK) status = check_integer(context, "device", s.device, FUM_DEVICE_AUTO, FUM_DEVICE_TILES);
  if (status == FUM_OK) status = check_integer(context, "leaf_size", s.leaf_size, 1, 4096);
  if (status == FUM_OK) status = check_integer(context, "light_samples", s.light_samples, 1, 1024);
  if (status == FUM_OK) status = check_float(context, "tolerance", s.tolerance, 1e-4F, 0.5F);
  if (status == FUM_OK) status = check_float(context, "shadowing_density", s.shadowing_density, 0.0F, 1e6F);
  if (status == FUM_OK) status = check_float(context, "solid_shadow_intensity", s.solid_shadow_intensity, 0.0F, 1.0F);
  if (status == FUM_OK) status = check_float(context, "subsampling", s.subsampling, 1e-6F, 1.0F);
  if (status == FUM_OK) status = check_float(context, "intersection_scale", s.intersection_scale, 0.01F, 100.0F);
  if (status == FUM_OK) status = check_integer(context, "solids", s.solids, FUM_SOLIDS_HOLDOUT, FUM_SOLIDS_SHADED);
  if (status == FUM_OK) *out_settings = s;
  return status;
}
