/* SPDX-License-Identifier: GPL-3.0-or-later */
#include "billboard/tiles.h"

#include "base/cpu.h"
#include "base/vector.h"
#include "billboard/deep.h"
#include "billboard/dust.h"
#include "billboard/tile_light.h"

#include <stdlib.h>
#include <string.h>

void fum_tile_plain(const fum_tile_job *job, int64_t index, fum_tile_scratch *scratch);
void fum_tile_avx2(const fum_tile_job *job, int64_t index, fum_tile_scratch *scratch);
void fum_tile_avx512(const fum_tile_job *job, int64_t index, fum_tile_scratch *scratch);

fum_tile_fn fum_tile_get(void) {
  return FUM_CPU_CHOOSE(fum_tile_plain, fum_tile_avx2, fum_tile_avx512);
}

static bool is_of_class(const fum_scene *scene, const fum_particles *set, const fum_tile_class *class) {
  return set->anisotropy == class->anisotropy && fum_scene_is_lit_alike(scene, set->light_set, class->light_set);
}

int32_t fum_tiles_find_looks(const fum_scene *scene, fum_tile_class classes[FUM_MAX_CLASSES], fum_tile_job *job) {
  const fum_particles *first = NULL;
  const int32_t status =
      fum_alloc(scene->context, scene->particles_count, sizeof *job->class_of, "looks of smoke", &job->class_of);
  if (status != FUM_OK) return status;
  job->class_count = 0;
  job->is_uniform = true;
  job->has_maps = fum_scene_map_traits(scene).has_maps;
  job->glows = false;
  job->classes = classes;
  for (int32_t s = 0; s < scene->particles_count; s++) {
    const fum_particles *set = &scene->particles[s];
    if (set->count == 0 || !set->is_visible_to_camera) continue;
    int32_t k = 0;
    while (k < job->class_count && !is_of_class(scene, set, &classes[k]))
      k++;
    if (k == FUM_MAX_CLASSES) {
      return fum_fail(scene->context, FUM_ERROR_ARGUMENT,
                      "%s: more than %d different anisotropies, those lit by different lights counted apart", set->name,
                      (int)FUM_MAX_CLASSES);
    }
    if (k == job->class_count) classes[job->class_count++] = (fum_tile_class){set->anisotropy, set->light_set};
    job->class_of[s] = (uint8_t)k;
    const bool glows =
        set->emissions != NULL || set->emission[0] > 0.0F || set->emission[1] > 0.0F || set->emission[2] > 0.0F;
    job->glows = job->glows || glows;
    if (first == NULL) first = set;
    const bool is_like_first = set->albedos == NULL && memcmp(set->albedo, first->albedo, sizeof set->albedo) == 0;
    const bool is_varied = glows || (set->map != NULL && set->map->is_colored);
    job->is_uniform = job->is_uniform && is_like_first && job->class_count == 1 && !is_varied;
    memcpy(job->albedo, set->albedo, sizeof job->albedo);
  }
  /* Something that glows without absorbing gets an optical depth too thin to be seen. */
  job->thinnest = job->glows ? 1e-5F : 0.0F;
  return FUM_OK;
}

/* Mean over the lights that shine on a particle of how much it shades itself, weighted with what each sends. */
static double find_self_shade(const fum_tile_job *job, int64_t i) {
  const fum_octree *octree = job->octree;
  const double *m = job->view->local_from_camera;
  const fum_vec3 at = {octree->x[i], octree->y[i], octree->z[i]}, back = {(float)m[2], (float)m[6], (float)m[10]};
  const fum_vec3 camera = {(float)m[3], (float)m[7], (float)m[11]};
  const fum_vec3 to_camera = job->view->type == FUM_CAMERA_PERSPECTIVE ? fum_sub(camera, at) : back;
  const fum_particles *set = fum_scene_particles_of(job->scene, octree->indices[i]);
  double shaded = 0.0, sent = 0.0;
  for (int32_t l = 0; l < job->lattice->lamp_count; l++) {
    const fum_lamp *lamp = &job->lamps->items[l];
    if (!fum_has_set(lamp->desc.light_sets, set->light_set)) continue;
    const bool is_blocked = lamp->desc.casts_shadows != 0 && fum_has_set(lamp->desc.shadow_sets, set->shadow_set);
    const fum_emitter sample = fum_lamp_sample(lamp, 0);
    const fum_environment *around = lamp->environment;
    /* All around, the mean of the cosines is taken for them: their squares count little. */
    const fum_vec3 to_light = around != NULL          ? around->mean
                              : sample.is_directional ? sample.direction
                                                      : fum_sub(lamp->position, at);
    const float lengths = (around != NULL ? 1.0F : fum_length(to_light)) * fum_length(to_camera), *color = lamp->color;
    const float sends = around != NULL ? around->total[lamp->channel] : fum_emitter_irradiance(lamp, &sample, at);
    const double strength = (double)(sends * (color[0] + color[1] + color[2]));
    const double cosine = lengths > 0.0F ? (double)(fum_dot(to_light, to_camera) / lengths) : 1.0;
    const double shade = fum_dust_shade((double)octree->optical_depths[i], cosine);
    shaded += strength * (is_blocked ? shade : 1.0);
    sent += strength;
  }
  return sent > 0.0 ? shaded / sent : 1.0;
}

void fum_tiles_shade_dust(fum_context *context, fum_tile_job *job, fum_splats *splats) {
  const float dense = 0.04F; /* below, it shades itself by less than a hundredth */
  int64_t count = 0;
  if (!splats->has_dust) return;
#pragma omp parallel for num_threads(fum_thread_count(context)) schedule(static) reduction(+ : count)
  for (int64_t i = 0; i < splats->count; i++) {
    fum_splat *s = &splats->splats[i];
    if (!(s->width > s->sigma) || job->octree->optical_depths[i] < dense) continue;
    /* The wider a particle is drawn, the less of its shade meets a sample of light. */
    const double missed = 1.0 - (double)(s->sigma * s->sigma) / (double)(s->width * s->width);
    s->self_shade = (float)(1.0 - missed * (1.0 - find_self_shade(job, i)));
    count++;
  }
  if (count > 0) job->is_uniform = false;
}

int32_t fum_tiles_draw(fum_context *context, const fum_tile_job *job) {
  const int64_t tiles = (int64_t)job->splats->columns * job->splats->rows;
  const fum_tile_fn render_tile = fum_tile_get();
  /* Said here once: with few tiles the other threads may take them all. */
  const int32_t status = fum_progress_report(context, FUM_STAGE_DRAWING, 0.0F, "Drawing tiles");
  if (status != FUM_OK) return status;
  atomic_int_least64_t tiles_done = 0;
  atomic_bool is_out_of_memory = false;
#pragma omp parallel num_threads(fum_thread_count(context))
  {
    fum_tile_scratch scratch = {0};
    const size_t lamps = (size_t)(job->lattice->lamp_count > 0 ? job->lattice->lamp_count : 1);
    scratch.held = malloc(lamps * sizeof *scratch.held);
    scratch.parts = malloc(((size_t)job->scene->light_count + 1) * sizeof *scratch.parts);
    if (job->deep != NULL) scratch.deep = fum_deep_tile_create();
    const bool has_deep = job->deep == NULL || scratch.deep != NULL;
    if (scratch.held == NULL || scratch.parts == NULL || !has_deep) atomic_store(&is_out_of_memory, true);
#pragma omp for schedule(dynamic)
    for (int64_t i = 0; i < tiles; i++) {
      if (fum_is_cancelled(context) || atomic_load(&is_out_of_memory)) continue;
      if (job->wanted == NULL || job->wanted[i]) render_tile(job, i, &scratch);
      if (job->deep != NULL && !fum_deep_end(scratch.deep, job, i)) scratch.is_out_of_memory = true;
      if (scratch.is_out_of_memory) atomic_store(&is_out_of_memory, true);
      const int64_t done = atomic_fetch_add(&tiles_done, 1) + 1;
      if (omp_get_thread_num() == 0) {
        (void)fum_progress_report(context, FUM_STAGE_DRAWING, (float)done / (float)tiles, "Drawing tiles");
      }
    }
    free(scratch.slabs);
    fum_deep_tile_free(scratch.deep);
    free(scratch.parts);
    free(scratch.held);
  }
  if (atomic_load(&is_out_of_memory))
    return fum_fail(context, FUM_ERROR_MEMORY, "drawing: no memory for a tile's slabs");
  return fum_is_cancelled(context) ? FUM_ERROR_CANCELLED : FUM_OK;
}
