/* SPDX-License-Identifier: GPL-3.0-or-later */
#include "tools/bench.h"
#include "tools/stage.h"

#include <stdio.h>
#include <stdlib.h>

/* With them lights see particles that are drawn larger as they were. */
static fum_settings settings_of(const options *o) {
  fum_settings settings = o->settings;
  settings.intersection_scale = (float)(1.0 / o->grow);
  settings.shadowing_density = (float)o->grow;
  return settings;
}

/* What was asked for and what came of it. */
static void print_row(const options *o, const cloud *c, const fum_render_stats *s) {
  printf("{\"particles\": %lld, \"lights\": %d, \"solver\": \"%s\", \"threads\": %d, \"width\": %d, \"height\": %d, "
         "\"device\": \"%s\", \"grow\": %g, \"dense\": %g, ",
         (long long)c->count, o->lights, s->solver == FUM_SOLVER_EXACT ? "exact" : "sweep", o->threads, o->width,
         o->height, s->device, o->grow, o->dense);
  print_settings(&o->settings);
  print_meter(s);
  printf("\"drawn\": %lld, \"build_s\": %.4f, \"light_s\": %.4f, \"sort_s\": %.4f, \"draw_s\": %.4f, "
         "\"passes_s\": %.4f, \"total_s\": %.4f, \"peak_rss_mb\": %.1f}\n",
         (long long)s->drawn_count, s->build_s, s->light_s, s->sort_s, s->draw_s, s->passes_s, s->total_s,
         peak_rss_mb());
}

/* Renders, prints the row and writes the picture. `depth` NULL: without. */
static int draw(fum_context *context, fum_scene *scene, const options *o, const cloud *c, float *combined,
                float *depth) {
  const int64_t pixels = (int64_t)o->width * o->height;
  const fum_camera camera = stage_camera(c, o->width, o->height);
  const fum_pass_buffer passes[2] = {{.pass = FUM_PASS_COMBINED, .pixels = combined, .pixels_size = 4 * pixels},
                                     {.pass = FUM_PASS_DEPTH, .pixels = depth, .pixels_size = pixels}};
  const fum_settings settings = settings_of(o);
  fum_render_stats stats;
  fum_render_stats_init(&stats);
  if (fum_render(scene, &camera, &settings, depth != NULL ? 2 : 1, passes, &stats) != FUM_OK) {
    return bench_fail(context);
  }
  print_row(o, c, &stats);
  if (o->exr == NULL) return 0;
  const fum_image_layer layers[2] = {{"", "RGBA", combined}, {"Depth", "Z", depth}};
  const int32_t status = fum_exr_write(context, o->exr, o->width, o->height, depth != NULL ? 2 : 1, layers);
  return status == FUM_OK ? 0 : bench_fail(context);
}

int bench_frame(fum_context *context, const options *o, const cloud *c) {
  const size_t pixels = (size_t)o->width * (size_t)o->height;
  fum_scene *scene = NULL;
  float *depth = NULL, *combined = malloc(4 * pixels * sizeof *combined);
  if (o->wants_depth) depth = malloc(pixels * sizeof *depth);
  int status = stage_create_ring(context, c, o->lights, &scene);
  if (combined == NULL || (o->wants_depth && depth == NULL)) {
    status = bench_no_memory();
  } else {
    status = status == FUM_OK ? draw(context, scene, o, c, combined, depth) : bench_fail(context);
  }
  fum_scene_destroy(scene);
  free(depth);
  free(combined);
  return status;
}
