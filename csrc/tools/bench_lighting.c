/* SPDX-License-Identifier: GPL-3.0-or-later */
#include "tools/bench.h"
#include "tools/brute.h"
#include "tools/stage.h"

#include "base/hash.h"

#include <math.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>

/* Errors of the transmittance at randomly chosen particles, over all lights, by the solver that lit them. */
static int measure_errors(fum_scene *scene, const options *o, int32_t solver, const cloud *c, error_summary *out) {
  fum_settings settings = o->settings;
  const int64_t sample = o->sample < c->count ? o->sample : c->count;
  const size_t n = (size_t)(sample > 0 ? sample : 1);
  float *points = malloc(3 * n * sizeof *points), *found = malloc(n * sizeof *found);
  double *errors = malloc(n * (size_t)(o->lights > 0 ? o->lights : 1) * sizeof *errors);
  int status = points == NULL || found == NULL || errors == NULL;
  settings.solver = solver;
  for (int64_t i = 0; i < sample && status == 0; i++) {
    const int64_t chosen = (int64_t)(fum_hash64((uint64_t)i) % (uint64_t)c->count);
    memcpy(points + 3 * i, c->positions + 3 * chosen, 3 * sizeof *points);
  }
  int64_t count = 0;
  for (int light = 0; light < o->lights && status == 0; light++) {
    status = fum_scene_transmittance(scene, &settings, light, sample, points, found);
    double position[3], to[3];
    stage_ring(light, position);
    stage_place(c, position, to);
    for (int64_t i = 0; i < sample && status == 0; i++) {
      const double from[3] = {(double)points[3 * i], (double)points[3 * i + 1], (double)points[3 * i + 2]};
      errors[count++] = fabs((double)found[i] - brute_transmittance(c, from, to));
    }
  }
  if (status == 0) *out = summarize(count, errors);
  free(errors);
  free(found);
  free(points);
  return status;
}

static int light_and_measure(fum_context *context, fum_scene *scene, const options *o, const cloud *c) {
  /* The OpenGL device lights every particle, whatever the picture shows; one pixel that looks away draws nothing. */
  fum_settings settings = o->settings;
  settings.device = FUM_DEVICE_GL;
  fum_camera camera = stage_camera(c, 1, 1);
  camera.clip_start = 0.0;
  camera.clip_end = 1e-6;
  float pixel[4];
  const fum_pass_buffer pass = {.pass = FUM_PASS_COMBINED, .pixels = pixel, .pixels_size = 4};
  fum_render_stats stats;
  fum_render_stats_init(&stats);
  if (fum_render(scene, &camera, &settings, 1, &pass, &stats) != FUM_OK) return bench_fail(context);
  const double rss_mb = peak_rss_mb();
  error_summary errors = {0};
  if (measure_errors(scene, o, stats.solver, c, &errors) != 0) return bench_fail(context);
  printf("{\"particles\": %lld, \"lights\": %d, \"solver\": \"%s\", \"threads\": %d, ", (long long)c->count, o->lights,
         stats.solver == FUM_SOLVER_EXACT ? "exact" : "sweep", o->threads);
  print_settings(&o->settings);
  print_meter(&stats);
  printf("\"build_s\": %.4f, \"light_s\": %.4f, \"sample\": %lld, \"rms\": %.3g, \"p95\": %.3g, \"worst\": %.3g, "
         "\"peak_rss_mb\": %.1f}\n",
         stats.build_s, stats.light_s, (long long)o->sample, errors.rms, errors.p95, errors.worst, rss_mb);
  return 0;
}

int bench_lighting(fum_context *context, const options *o, const cloud *c) {
  fum_scene *scene = NULL;
  int status = stage_create_ring(context, c, o->lights, &scene);
  status = status == FUM_OK ? light_and_measure(context, scene, o, c) : bench_fail(context);
  fum_scene_destroy(scene);
  return status;
}
