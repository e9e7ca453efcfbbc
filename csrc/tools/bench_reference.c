/* SPDX-License-Identifier: GPL-3.0-or-later */
#include "tools/bench.h"
#include "tools/stage.h"

#include <stdio.h>
#include <stdlib.h>

static int write_picture(fum_context *context, const options *o, const double *pixels, int64_t count) {
  float *rounded = malloc((size_t)count * sizeof *rounded);
  if (rounded == NULL) return bench_no_memory();
  for (int64_t i = 0; i < count; i++)
    rounded[i] = (float)pixels[i];
  const fum_image_layer layer = {"", "RGBA", rounded};
  const int32_t status = fum_exr_write(context, o->exr, o->width, o->height, 1, &layer);
  free(rounded);
  return status == FUM_OK ? 0 : bench_fail(context);
}

static int march(fum_context *context, fum_scene *scene, const options *o, const cloud *c, double *pixels,
                 int64_t count) {
  const fum_camera camera = stage_camera(c, o->width, o->height);
  fum_reference_stats stats;
  fum_reference_stats_init(&stats);
  if (fum_reference_render(scene, &camera, &o->reference, pixels, count, NULL, 0, &stats) != FUM_OK) {
    return bench_fail(context);
  }
  printf("{\"particles\": %lld, \"depth\": %g, \"lights\": %d, \"threads\": %d, \"width\": %d, \"height\": %d, "
         "\"tolerance\": %g, \"seconds\": %.3f, \"error\": %.3g, \"steps\": %lld, \"unconverged\": %lld}\n",
         (long long)c->count, c->depth, o->lights, o->threads, o->width, o->height, o->reference.tolerance,
         stats.total_s, stats.error, (long long)stats.step_count, (long long)stats.unconverged_count);
  return o->exr != NULL ? write_picture(context, o, pixels, count) : 0;
}

int bench_reference(fum_context *context, const options *o, const cloud *c) {
  const int64_t count = 4 * (int64_t)o->width * o->height;
  fum_scene *scene = NULL;
  double *pixels = malloc((size_t)count * sizeof *pixels);
  int status = stage_create_ring(context, c, o->lights, &scene);
  if (pixels == NULL) {
    status = bench_no_memory();
  } else {
    status = status == FUM_OK ? march(context, scene, o, c, pixels, count) : bench_fail(context);
  }
  fum_scene_destroy(scene);
  free(pixels);
  return status;
}
