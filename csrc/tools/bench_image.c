/* SPDX-License-Identifier: GPL-3.0-or-later */
/* Errors of the picture against the reference. */
#include "tools/bench.h"
#include "tools/stage.h"

#include <math.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>

/* Lights of some rows, in radii from the cloud's middle; the camera stands at (0, -3, 0). */
typedef struct arrangement {
  const char *name;
  int count;
  double positions[2][3], brightness[2];
} arrangement;

static const arrangement ARRANGEMENTS[] = {
    {"side", 1, {{4.0, 0.0, 0.3}}, {1.0}},
    {"front", 1, {{0.3, -4.0, 0.6}}, {1.0}},
    {"behind", 1, {{-0.2, 4.0, 0.4}}, {1.0}},
    {"two", 2, {{3.0, -2.0, 1.5}, {-2.5, 3.0, 0.5}}, {0.6, 0.4}},
};

/* What a render took. */
typedef struct run {
  fum_render_stats stats;
  double processor_s;
} run;

/* A picture, and the reference of every `every`-th pixel of it. */
typedef struct comparison {
  int32_t width, height, every;
  int32_t reference_width, reference_height;
  float *picture;    /* [height][width][4] */
  double *reference; /* [reference_height][reference_width][4] */
  run run;           /* of the median processor time */
  fum_reference_stats reference_stats;
} comparison;

/* First pixel of the reference along a side. */
static int32_t offset(const comparison *k) {
  return k->every / 2;
}

static int32_t count_pixels(int32_t size, int32_t every) {
  return size > every / 2 ? (size - every / 2 - 1) / every + 1 : 0;
}

/* The camera whose pixels' centres are those of the pixels that are compared. */
static fum_camera sparse_camera(const comparison *k, const fum_camera *camera) {
  fum_camera sparse = *camera;
  const double *w = camera->window;
  const double step_x = (w[1] - w[0]) / camera->width, step_y = (w[3] - w[2]) / camera->height;
  const double first = offset(k) + 0.5 - 0.5 * k->every;
  sparse.width = k->reference_width;
  sparse.height = k->reference_height;
  sparse.window[0] = w[0] + first * step_x;
  sparse.window[1] = sparse.window[0] + k->every * step_x * sparse.width;
  sparse.window[2] = w[2] + first * step_y;
  sparse.window[3] = sparse.window[2] + k->every * step_y * sparse.height;
  return sparse;
}

/* RMS of the difference of RGB over the RMS of the reference, and the sum of one over the sum of the other. */
static void find_errors(const comparison *k, double *out_rms, double *out_bias) {
  double differences = 0.0, squares = 0.0, values = 0.0, value_squares = 0.0;
  for (int32_t y = 0; y < k->reference_height; y++) {
    for (int32_t x = 0; x < k->reference_width; x++) {
      const int64_t row = (int64_t)(offset(k) + y * k->every) * k->width;
      const float *found = k->picture + 4 * (row + offset(k) + x * k->every);
      const double *expected = k->reference + 4 * ((int64_t)y * k->reference_width + x);
      for (int c = 0; c < 3; c++) {
        const double difference = (double)found[c] - expected[c];
        differences += difference;
        squares += difference * difference;
        values += expected[c];
        value_squares += expected[c] * expected[c];
      }
    }
  }
  *out_rms = value_squares > 0.0 ? sqrt(squares / value_squares) : 0.0;
  *out_bias = values > 0.0 ? differences / values : 0.0;
}

/* A scene of its own each time, so that nothing is kept from another render. */
static int32_t create_scene(fum_context *context, const cloud *c, const arrangement *lights, fum_scene **out_scene) {
  int32_t status = stage_create(context, c, out_scene);
  for (int i = 0; i < lights->count && status == FUM_OK; i++) {
    status = stage_add_light(*out_scene, c, lights->positions[i], lights->brightness[i]);
  }
  return status;
}

static int32_t find_reference(fum_context *context, const options *o, const cloud *c, const arrangement *lights,
                              comparison *k) {
  const fum_camera camera = stage_camera(c, k->width, k->height), sparse = sparse_camera(k, &camera);
  const int64_t size = 4 * (int64_t)k->reference_width * k->reference_height;
  fum_scene *scene = NULL;
  int32_t status = create_scene(context, c, lights, &scene);
  fum_reference_stats_init(&k->reference_stats);
  if (status == FUM_OK) {
    status = fum_reference_render(scene, &sparse, &o->reference, k->reference, size, NULL, 0, &k->reference_stats);
  }
  fum_scene_destroy(scene);
  return status;
}

static int32_t render_once(fum_context *context, const cloud *c, const arrangement *lights,
                           const fum_settings *settings, comparison *k, run *out_run) {
  const fum_camera camera = stage_camera(c, k->width, k->height);
  const fum_pass_buffer pass = {
      .pass = FUM_PASS_COMBINED, .pixels = k->picture, .pixels_size = 4 * (int64_t)k->width * k->height};
  fum_scene *scene = NULL;
  int32_t status = create_scene(context, c, lights, &scene);
  fum_render_stats_init(&out_run->stats);
  const double start_s = processor_seconds();
  if (status == FUM_OK) status = fum_render(scene, &camera, settings, 1, &pass, &out_run->stats);
  out_run->processor_s = processor_seconds() - start_s;
  fum_scene_destroy(scene);
  return status;
}

static int by_processor_time(const void *a, const void *b) {
  const double first = ((const run *)a)->processor_s, second = ((const run *)b)->processor_s;
  return (first > second) - (first < second);
}

static int32_t render(fum_context *context, const options *o, const cloud *c, const arrangement *lights,
                      const fum_settings *settings, comparison *k) {
  run runs[OPTIONS_MAX_REPEAT];
  int32_t status = FUM_OK;
  for (int i = 0; i < o->repeat && status == FUM_OK; i++) {
    status = render_once(context, c, lights, settings, k, &runs[i]);
  }
  if (status != FUM_OK) return status;
  qsort(runs, (size_t)o->repeat, sizeof runs[0], by_processor_time);
  k->run = runs[o->repeat / 2];
  return status;
}

static void print_row(const options *o, const cloud *c, const arrangement *lights, const fum_settings *settings,
                      const comparison *k) {
  double rms, bias;
  find_errors(k, &rms, &bias);
  printf("{\"scene\": \"%s\", \"light\": \"%s\", \"particles\": %lld, \"depth\": %g, \"device\": \"%s\", "
         "\"tolerance\": %g, \"subsampling\": %g, \"threads\": %d, \"width\": %d, \"height\": %d, \"every\": %d, "
         "\"image_rms_relative\": %.4g, \"bias\": %.4g, \"light_s\": %.4f, \"draw_s\": %.4f, \"total_s\": %.4f, "
         "\"processor_s\": %.4f, "
         "\"slices\": %lld, \"samples\": %lld, \"reference_s\": %.2f, \"reference_error\": %.2g}\n",
         o->file != NULL ? "file" : o->scene, lights->name, (long long)c->count, c->depth,
         settings->device == FUM_DEVICE_GL ? "gl" : "tiles", (double)settings->tolerance, (double)settings->subsampling,
         o->threads, k->width, k->height, k->every, rms, bias, k->run.stats.light_s, k->run.stats.draw_s,
         k->run.stats.total_s, k->run.processor_s, (long long)k->run.stats.slab_count,
         (long long)k->run.stats.light_points, k->reference_stats.total_s, k->reference_stats.error);
  fflush(stdout);
}

static int compare_rows(fum_context *context, const options *o, const cloud *c, const arrangement *lights,
                        comparison *k) {
  int32_t status = find_reference(context, o, c, lights, k);
  for (int i = 0; i < o->row_count && status == FUM_OK; i++) {
    status = render(context, o, c, lights, &o->rows[i], k);
    if (status == FUM_OK) print_row(o, c, lights, &o->rows[i], k);
  }
  return status == FUM_OK ? 0 : bench_fail(context);
}

/* The arrangements that were asked for, each with its rows. */
static int compare(fum_context *context, const options *o, const cloud *c, comparison *k) {
  int status = 0, count = 0;
  for (size_t i = 0; i < sizeof ARRANGEMENTS / sizeof ARRANGEMENTS[0] && status == 0; i++) {
    if (o->light != NULL && strcmp(o->light, ARRANGEMENTS[i].name) != 0) continue;
    status = compare_rows(context, o, c, &ARRANGEMENTS[i], k);
    count++;
  }
  return count == 0 ? usage_error("there is no light", o->light) : status;
}

int bench_image(fum_context *context, const options *o, const cloud *c) {
  comparison k = {.width = o->width, .height = o->height, .every = o->every};
  k.reference_width = count_pixels(k.width, k.every);
  k.reference_height = count_pixels(k.height, k.every);
  if (k.reference_width == 0 || k.reference_height == 0) return usage_error("out of range:", "--every");
  k.picture = malloc(4 * (size_t)k.width * (size_t)k.height * sizeof *k.picture);
  k.reference = malloc(4 * (size_t)k.reference_width * (size_t)k.reference_height * sizeof *k.reference);
  const int status = k.picture == NULL || k.reference == NULL ? bench_no_memory() : compare(context, o, c, &k);
  free(k.reference);
  free(k.picture);
  return status;
}
