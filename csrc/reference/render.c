/* SPDX-License-Identifier: GPL-3.0-or-later */
#include "reference/surface.h"
#include "scene/view.h"

#include <string.h>

/* Of a Gaussian's optical depth, what may be cut off, as a share of the tolerance. */
static const double CUT_SHARE = 1e-4;

void fum_reference_settings_init(fum_reference_settings *settings) {
  *settings = (fum_reference_settings){.struct_size = sizeof *settings, .light_samples = 256, .tolerance = 1e-4};
}

void fum_reference_stats_init(fum_reference_stats *stats) {
  *stats = (fum_reference_stats){.struct_size = sizeof *stats};
}

/* One call: what it was asked for, what it needs, and its pixels. */
typedef struct render {
  fum_scene *scene;
  fum_context *context;
  fum_reference_settings settings;
  fum_view view;
  fum_smoke smoke;
  fum_solids *solids;
  fum_reference_lamp *lamps;
  bool wants_depth;
  double *pixels; /* [height][width][4] */
  double *depths; /* [height][width] */
  double *errors; /* [height][width] estimated */
  int64_t step_count, unconverged_count;
} render;

static int32_t check_settings(fum_context *context, const fum_reference_settings *settings,
                              fum_reference_settings *out_settings) {
  fum_reference_settings s;
  fum_reference_settings_init(&s);
  if (settings != NULL) {
    if (settings->struct_size < sizeof *settings) {
      return fum_fail(context, FUM_ERROR_ARGUMENT, "reference settings: struct_size %u is not valid",
                      (unsigned)settings->struct_size);
    }
    s = *settings;
  }
  if (s.light_samples < 1 || s.light_samples > 65536) {
    return fum_fail(context, FUM_ERROR_ARGUMENT, "reference settings: light_samples %d is not within 1..65536",
                    (int)s.light_samples);
  }
  if (!(s.tolerance >= 1e-10 && s.tolerance <= 0.1)) {
    return fum_fail(context, FUM_ERROR_ARGUMENT, "reference settings: tolerance %g is not within 1e-10..0.1",
                    s.tolerance);
  }
  if (s.solids < FUM_SOLIDS_HOLDOUT || s.solids > FUM_SOLIDS_SHADED) {
    return fum_fail(context, FUM_ERROR_ARGUMENT, "reference settings: solids %d is not within 0..1", (int)s.solids);
  }
  *out_settings = s;
  return FUM_OK;
}

static int64_t pixel_count(const render *r) {
  return (int64_t)r->view.width * r->view.height;
}

static int32_t check_buffers(const render *r, const double *combined, int64_t combined_size, const double *depth,
                             int64_t depth_size) {
  const int64_t count = pixel_count(r);
  if (combined == NULL || combined_size != 4 * count) {
    return fum_fail(r->context, FUM_ERROR_ARGUMENT, "reference: room for %lld doubles was given, %lld are needed",
                    (long long)(combined != NULL ? combined_size : 0), (long long)(4 * count));
  }
  if (depth != NULL && depth_size != count) {
    return fum_fail(r->context, FUM_ERROR_ARGUMENT, "reference depth: room for %lld doubles was given, %lld are needed",
                    (long long)depth_size, (long long)count);
  }
  return FUM_OK;
}

static int32_t prepare(render *r) {
  fum_context *context = r->context;
  int32_t status = fum_alloc(context, pixel_count(r), 4 * sizeof *r->pixels, "reference", &r->pixels);
  if (status == FUM_OK) status = fum_alloc(context, pixel_count(r), sizeof *r->depths, "reference", &r->depths);
  if (status == FUM_OK) status = fum_alloc(context, pixel_count(r), sizeof *r->errors, "reference", &r->errors);
  if (status == FUM_OK) status = fum_alloc(context, r->scene->light_count, sizeof *r->lamps, "reference", &r->lamps);
  if (status != FUM_OK) return status;
  fum_scene_find_origin(r->scene);
  fum_view_place(&r->view, r->scene->origin);
  for (int32_t i = 0; i < r->scene->light_count && status == FUM_OK; i++) {
    r->lamps[i] = fum_reference_lamp_make(&r->scene->lights[i].desc, r->scene->origin, r->settings.light_samples);
    status = fum_reference_sky_find(context, &r->lamps[i]);
  }
  if (status == FUM_OK) status = fum_progress_report(context, FUM_STAGE_OCTREE, 0.0F, "Sorting particles into cells");
  if (status == FUM_OK) status = fum_solids_build(r->scene, &r->solids);
  if (status == FUM_OK) status = fum_smoke_init(r->scene, CUT_SHARE * r->settings.tolerance, &r->smoke);
  if (status == FUM_OK) status = fum_smoke_look(&r->smoke, &r->view);
  return status;
}

/* The ray of a pixel's centre, as far as the nearest solid. */
typedef struct pixel_ray {
  fum_way way;
  double speed, end; /* metres along the ray for each metre of depth along the camera's axis; depth of its end */
  bool meets_solid;
  fum_solid_point point; /* on the solid that it meets */
} pixel_ray;

static pixel_ray find_ray(const render *r, int64_t pixel) {
  const fum_view *view = &r->view;
  pixel_ray ray = {.end = view->clip_end};
  double direction[3];
  const double x = (double)(pixel % view->width) + 0.5, y = (double)(pixel / view->width) + 0.5;
  fum_view_ray(view, x, y, ray.way.start, direction);
  ray.speed = sqrt(direction[0] * direction[0] + direction[1] * direction[1] + direction[2] * direction[2]);
  for (int axis = 0; axis < 3; axis++)
    ray.way.direction[axis] = direction[axis] / ray.speed;
  if (fum_solids_hide_from_camera(r->solids)) {
    const double *s = ray.way.start;
    const fum_vec3 from = {(float)s[0], (float)s[1], (float)s[2]};
    const fum_vec3 along = {(float)direction[0], (float)direction[1], (float)direction[2]};
    const float far = (float)view->clip_end;
    const float hit = fum_solids_see(r->solids, from, along, (float)view->clip_start, far, &ray.point);
    ray.meets_solid = hit < far;
    if (ray.meets_solid) ray.end = (double)hit;
  }
  ray.way.length = ray.end * ray.speed;
  return ray;
}

/* Puts the solid at the ray's end behind the smoke. */
static void add_solid(const render *r, const fum_reference_world *world, const pixel_ray *ray, const double through[3],
                      double rgba[4]) {
  if (!ray->meets_solid || r->settings.solids != FUM_SOLIDS_SHADED || r->scene->meshes[ray->point.mesh].is_holdout)
    return;
  double position[3], radiance[3];
  for (int axis = 0; axis < 3; axis++)
    position[axis] = ray->way.start[axis] + ray->way.length * ray->way.direction[axis];
  fum_reference_surface_shine(world, &ray->point, position, ray->way.length, radiance);
  for (int c = 0; c < 3; c++)
    rgba[c] += through[c] * radiance[c];
  rgba[3] = 1.0;
}

static int32_t render_pixel(render *r, const fum_reference_world *world, fum_ray *ray, int64_t pixel,
                            bool *out_converged) {
  fum_ray_result result;
  const pixel_ray seen = find_ray(r, pixel);
  const double start = r->view.clip_start * seen.speed;
  const int32_t status = fum_ray_integrate(ray, world, &seen.way, start, r->wants_depth, &result);
  if (status != FUM_OK) return status;
  memcpy(r->pixels + 4 * pixel, result.radiance, sizeof result.radiance);
  r->pixels[4 * pixel + 3] = result.alpha;
  add_solid(r, world, &seen, result.through, r->pixels + 4 * pixel);
  r->depths[pixel] = fmin(result.half_way / seen.speed, seen.end);
  r->errors[pixel] = result.error;
  *out_converged = result.has_converged;
  return FUM_OK;
}

static int32_t render_pixels(render *r) {
  fum_context *context = r->context;
  const fum_reference_world world = {
      context, &r->smoke, r->solids, r->lamps, r->scene->light_count, r->settings.tolerance};
  const int64_t count = pixel_count(r);
  /* Said here once: with few pixels the other threads may take them all. */
  const int32_t status = fum_progress_report(context, FUM_STAGE_DRAWING, 0.0F, "Marching rays");
  if (status != FUM_OK) return status;
  int64_t steps = 0, unconverged = 0;
  atomic_int_least64_t done = 0;
  atomic_bool is_out_of_memory = false;
#pragma omp parallel num_threads(fum_thread_count(context)) reduction(+ : steps, unconverged)
  {
    fum_ray ray = {0};
#pragma omp for schedule(dynamic)
    for (int64_t i = 0; i < count; i++) {
      bool has_converged = true;
      if (fum_is_cancelled(context) || atomic_load(&is_out_of_memory)) continue;
      if (render_pixel(r, &world, &ray, i, &has_converged) == FUM_ERROR_MEMORY) atomic_store(&is_out_of_memory, true);
      unconverged += has_converged ? 0 : 1;
      const int64_t finished = atomic_fetch_add(&done, 1) + 1;
      if (omp_get_thread_num() == 0) {
        (void)fum_progress_report(context, FUM_STAGE_DRAWING, (float)finished / (float)count, "Marching rays");
      }
    }
    steps += ray.step_count;
    fum_ray_free(&ray);
  }
  r->step_count = steps;
  r->unconverged_count = unconverged;
  if (atomic_load(&is_out_of_memory))
    return fum_fail(context, FUM_ERROR_MEMORY, "reference: no memory for a ray's particles");
  return fum_is_cancelled(context) ? FUM_ERROR_CANCELLED : FUM_OK;
}

/* RMS of the pixels' estimated errors over the RMS of their brightest channels. */
static double relative_error(const render *r) {
  double errors = 0.0, values = 0.0;
  for (int64_t i = 0; i < pixel_count(r); i++) {
    const double *rgb = r->pixels + 4 * i;
    const double brightest = fmax(rgb[0], fmax(rgb[1], rgb[2]));
    errors += r->errors[i] * r->errors[i];
    values += brightest * brightest;
  }
  return values > 0.0 ? sqrt(errors / values) : 0.0;
}

static fum_reference_stats make_stats(const render *r, double start_s) {
  fum_reference_stats stats;
  fum_reference_stats_init(&stats);
  for (int32_t i = 0; i < r->scene->light_count; i++)
    stats.light_sample_count += fum_reference_lamp_samples(&r->lamps[i]);
  stats.particle_count = r->scene->particle_count;
  stats.step_count = r->step_count;
  stats.unconverged_count = r->unconverged_count;
  stats.error = relative_error(r);
  stats.total_s = fum_now_s() - start_s;
  return stats;
}

int32_t fum_reference_render(fum_scene *scene, const fum_camera *camera, const fum_reference_settings *settings,
                             double *out_combined, int64_t combined_size, double *out_depth, int64_t depth_size,
                             fum_reference_stats *out_stats) {
  const double start_s = fum_now_s();
  fum_context *context = scene->context;
  render r = {.scene = scene, .context = context, .smoke.scene = scene, .wants_depth = out_depth != NULL};
  fum_progress_begin(context);
  if (out_stats != NULL && out_stats->struct_size < sizeof *out_stats) {
    return fum_fail(context, FUM_ERROR_ARGUMENT, "reference stats: struct_size %u is not valid",
                    (unsigned)out_stats->struct_size);
  }
  int32_t status = check_settings(context, settings, &r.settings);
  if (status == FUM_OK) status = fum_view_init(context, camera, &r.view);
  if (status == FUM_OK) status = check_buffers(&r, out_combined, combined_size, out_depth, depth_size);
  if (status == FUM_OK) status = prepare(&r);
  if (status == FUM_OK) status = render_pixels(&r);
  if (status != FUM_OK) goto done;
  memcpy(out_combined, r.pixels, (size_t)combined_size * sizeof *out_combined);
  if (out_depth != NULL) memcpy(out_depth, r.depths, (size_t)depth_size * sizeof *out_depth);
  if (out_stats != NULL) *out_stats = make_stats(&r, start_s);
done:
  fum_smoke_free(&r.smoke);
  fum_solids_destroy(r.solids);
  for (int32_t i = 0; i < scene->light_count && r.lamps != NULL; i++)
    fum_free(context, &r.lamps[i].sky);
  fum_free(context, &r.lamps);
  fum_free(context, &r.errors);
  fum_free(context, &r.depths);
  fum_free(context, &r.pixels);
  return status;
}
