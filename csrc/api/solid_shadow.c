/* SPDX-License-Identifier: GPL-3.0-or-later */
#include "api/solid_shadow.h"

#include "billboard/tiles.h"

bool fum_solid_shadow_is_wanted(const fum_rendering *r) {
  for (int32_t l = 0; l < r->scene->light_count; l++) {
    if (r->light_solid_shadows[l] != NULL) return true;
  }
  return r->solid_shadow != NULL;
}

/* What smoke scatters: of all lights, and of those that are asked for. */
typedef struct scattered {
  float *rgba;    /* [height][width][4] */
  float **lights; /* [light_count] [height][width][3], or NULL */
} scattered;

static int64_t pixel_count(const fum_rendering *r) {
  return (int64_t)r->view.width * r->view.height;
}

void fum_solid_shadow_begin(fum_rendering *r) {
  for (int32_t l = -1; l < r->scene->light_count; l++) {
    float *shares = l < 0 ? r->solid_shadow : r->light_solid_shadows[l];
    for (int64_t i = 0; i < 3 * pixel_count(r) && shares != NULL; i++)
      shares[i] = 1.0F;
  }
}

static void scattered_free(const fum_rendering *r, scattered *s) {
  for (int32_t l = 0; l < r->scene->light_count && s->lights != NULL; l++)
    fum_free(r->context, &s->lights[l]);
  fum_free(r->context, &s->lights);
  fum_free(r->context, &s->rgba);
}

static int32_t draw(const fum_rendering *r, fum_tile_job job, scattered *s) {
  const char *what = "shadows of solids";
  const int32_t lights = r->scene->light_count;
  int32_t status = fum_alloc(r->context, pixel_count(r), 4 * sizeof *s->rgba, what, &s->rgba);
  if (status == FUM_OK) status = fum_alloc(r->context, lights, sizeof *s->lights, what, &s->lights);
  for (int32_t l = 0; l < lights && status == FUM_OK; l++) {
    if (r->light_solid_shadows[l] != NULL)
      status = fum_alloc(r->context, pixel_count(r), 3 * sizeof(float), what, &s->lights[l]);
  }
  if (status != FUM_OK) return status;
  job.glows = false;
  job.emission = NULL;
  job.rgba = s->rgba;
  job.light_rgb = s->lights;
  return fum_tiles_draw(r->context, &job);
}

static void write_shares(const fum_rendering *r, const float *shadowed, const float *clear, int32_t stride,
                         float *out) {
  for (int64_t i = 0; i < 3 * pixel_count(r) && out != NULL; i++) {
    const int64_t at = i / 3 * stride + i % 3;
    out[i] = clear[at] > 0.0F ? fminf(shadowed[at] / clear[at], 1.0F) : 1.0F;
  }
}

int32_t fum_solid_shadow_find(fum_rendering *r, const fum_tile_job *job) {
  if (r->scene->caches->solids == NULL) return FUM_OK;
  fum_lattice unblocked = *job->lattice;
  fum_tile_job clear_job = *job;
  scattered shadowed = {0}, clear = {0};
  unblocked.visible = NULL;
  clear_job.lattice = &unblocked;
  clear_job.solids = NULL;
  int32_t status = draw(r, *job, &shadowed);
  if (status == FUM_OK) status = draw(r, clear_job, &clear);
  if (status == FUM_OK) write_shares(r, shadowed.rgba, clear.rgba, 4, r->solid_shadow);
  for (int32_t l = 0; l < r->scene->light_count && status == FUM_OK; l++)
    write_shares(r, shadowed.lights[l], clear.lights[l], 3, r->light_solid_shadows[l]);
  scattered_free(r, &shadowed);
  scattered_free(r, &clear);
  return status;
}
