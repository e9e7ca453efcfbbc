/* SPDX-License-Identifier: GPL-3.0-or-later */
/* fumarole-bench: times and errors as JSON lines on standard output. */
#include "fumarole.h"
#include "tools/brute.h"
#include "tools/cloud.h"

#include "base/hash.h"

#include <math.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>
#include <sys/resource.h>

static const char USAGE[] =
    "usage: fumarole-bench lighting|frame [OPTIONS]\n"
    "  --particles N    of a generated turbulent plume (default 250000)\n"
    "  --file F.ply     particles of a binary little-endian PLY instead: x y z [radius density red green blue]\n"
    "  --lights K       point lights around it (default 1)\n"
    "  --threads T      default: all cores\n"
    "  --tolerance X    default 0.01\n"
    "  --leaf N         leaf size of the octree (default: the library's)\n"
    "  --subsampling S  share of the particles that cast shadows (default 1)\n"
    "  lighting: --solver automatic|exact, --sample N (particles checked by brute force, default 256)\n"
    "  frame: --width W --height H (default 960 x 540) --device auto|gl --depth (Depth pass as well) --exr FILE\n";

typedef struct options {
  const char *command, *file, *exr;
  long long particles, sample;
  int lights, threads, width, height, wants_depth;
  fum_settings settings;
} options;

static int usage_error(const char *what, const char *value) {
  fprintf(stderr, "fumarole-bench: %s %s\n%s", what, value, USAGE);
  return 2;
}

/* Index of `text` among the names, or -1. */
static int choose(const char *text, const char *const *names, int count) {
  for (int i = 0; i < count; i++) {
    if (strcmp(text, names[i]) == 0) return i;
  }
  return -1;
}

static int parse_value(options *o, const char *name, const char *value) {
  static const char *const solvers[] = {"automatic", "exact"}, *const devices[] = {"auto", "gl"};
  char *end = NULL;
  const double number = strtod(value, &end);
  const int is_number = end != value && *end == '\0';
  if (strcmp(name, "--file") == 0) {
    o->file = value;
  } else if (strcmp(name, "--exr") == 0) {
    o->exr = value;
  } else if (strcmp(name, "--solver") == 0) {
    o->settings.solver = choose(value, solvers, 2);
    return o->settings.solver < 0;
  } else if (strcmp(name, "--device") == 0) {
    o->settings.device = choose(value, devices, 2);
    return o->settings.device < 0;
  } else if (!is_number) {
    return 1;
  } else if (strcmp(name, "--particles") == 0) {
    o->particles = (long long)number;
  } else if (strcmp(name, "--sample") == 0) {
    o->sample = (long long)number;
  } else if (strcmp(name, "--lights") == 0) {
    o->lights = (int)number;
  } else if (strcmp(name, "--threads") == 0) {
    o->threads = (int)number;
  } else if (strcmp(name, "--tolerance") == 0) {
    o->settings.tolerance = (float)number;
  } else if (strcmp(name, "--leaf") == 0) {
    o->settings.leaf_size = (int32_t)number;
  } else if (strcmp(name, "--subsampling") == 0) {
    o->settings.subsampling = (float)number;
  } else if (strcmp(name, "--width") == 0) {
    o->width = (int)number;
  } else if (strcmp(name, "--height") == 0) {
    o->height = (int)number;
  } else {
    return 1;
  }
  return 0;
}

static int parse(int argc, char **argv, options *o) {
  *o = (options){.particles = 250000, .sample = 256, .lights = 1, .width = 960, .height = 540};
  fum_settings_init(&o->settings);
  if (argc < 2) return usage_error("a command is missing", "");
  o->command = argv[1];
  if (strcmp(o->command, "--help") == 0) {
    printf("%s", USAGE);
    exit(0);
  }
  if (strcmp(o->command, "lighting") != 0 && strcmp(o->command, "frame") != 0) {
    return usage_error("unknown command", o->command);
  }
  for (int i = 2; i < argc; i++) {
    if (strcmp(argv[i], "--depth") == 0) {
      o->wants_depth = 1;
      continue;
    }
    if (i + 1 >= argc || parse_value(o, argv[i], argv[i + 1]) != 0) return usage_error("can't use", argv[i]);
    i++;
  }
  if (o->particles < 0 || o->lights < 0 || o->lights > 1024 || o->sample < 0) return usage_error("out of range:", "counts");
  return 0;
}

static int fail(const fum_context *context) {
  fprintf(stderr, "fumarole-bench: %s\n", fum_last_error(context));
  return 1;
}

static void bounds_of(const cloud *c, double middle[3], double *radius) {
  double lower[3] = {INFINITY, INFINITY, INFINITY}, upper[3] = {-INFINITY, -INFINITY, -INFINITY};
  for (int64_t i = 0; i < 3 * c->count; i++) {
    lower[i % 3] = fmin(lower[i % 3], (double)c->positions[i]);
    upper[i % 3] = fmax(upper[i % 3], (double)c->positions[i]);
  }
  double squared = 0.0;
  for (int axis = 0; axis < 3; axis++) {
    middle[axis] = c->count > 0 ? 0.5 * (lower[axis] + upper[axis]) : 0.0;
    const double side = c->count > 0 ? upper[axis] - lower[axis] : 1.0;
    squared += side * side;
  }
  *radius = fmax(0.5 * sqrt(squared), 1e-3);
}

/* Lights stand on a ring around the cloud, above its middle. */
static void light_position(const double middle[3], double radius, int index, double out[3]) {
  const double angle = 0.7 + 2.39996 * index;
  out[0] = middle[0] + 2.5 * radius * cos(angle);
  out[1] = middle[1] + 2.5 * radius * sin(angle);
  out[2] = middle[2] + 1.2 * radius;
}

static int32_t fill_scene(fum_scene *scene, const cloud *c, int lights) {
  fum_particles_desc particles;
  fum_particles_desc_init(&particles);
  particles.name = "cloud";
  particles.count = c->count;
  particles.positions = c->positions;
  particles.radii = c->radii;
  particles.densities = c->densities;
  particles.albedos = c->albedos;
  int32_t status = fum_scene_add_particles(scene, &particles);
  double middle[3], radius;
  bounds_of(c, middle, &radius);
  for (int i = 0; i < lights && status == FUM_OK; i++) {
    fum_light_desc light;
    fum_light_desc_init(&light);
    double position[3];
    light_position(middle, radius, i, position);
    for (int axis = 0; axis < 3; axis++) {
      light.world_from_light[4 * axis + 3] = position[axis];
      light.intensity[axis] = (float)(40.0 * radius * radius / lights);
    }
    status = fum_scene_add_light(scene, &light);
  }
  return status;
}

/* Looks at the cloud from the front, so that it fills most of the height. */
static fum_camera make_camera(const cloud *c, int width, int height) {
  double middle[3], radius;
  bounds_of(c, middle, &radius);
  fum_camera camera;
  fum_camera_init(&camera);
  const double tangent = 0.36, aspect = (double)width / (double)height;
  const double matrix[16] = {1, 0, 0, middle[0], 0, 0, -1, middle[1] - 3.0 * radius, 0, 1, 0, middle[2], 0, 0, 0, 1};
  memcpy(camera.world_from_camera, matrix, sizeof matrix);
  const double window[4] = {-tangent * aspect, tangent * aspect, -tangent, tangent};
  memcpy(camera.window, window, sizeof window);
  camera.clip_start = 0.01 * radius;
  camera.clip_end = 10.0 * radius;
  camera.width = width;
  camera.height = height;
  return camera;
}

static double peak_rss_mb(void) {
  struct rusage usage;
  getrusage(RUSAGE_SELF, &usage);
  return (double)usage.ru_maxrss / 1024.0;
}

static const char *solver_name(int32_t solver) { return solver == FUM_SOLVER_EXACT ? "exact" : "automatic"; }

/* Errors of the transmittance at randomly chosen particles, over all lights. */
static int measure_errors(fum_scene *scene, const options *o, const cloud *c, error_summary *out) {
  const int64_t sample = o->sample < c->count ? o->sample : c->count;
  const size_t n = (size_t)(sample > 0 ? sample : 1);
  double middle[3], radius;
  bounds_of(c, middle, &radius);
  float *points = malloc(3 * n * sizeof *points), *found = malloc(n * sizeof *found);
  double *errors = malloc(n * (size_t)(o->lights > 0 ? o->lights : 1) * sizeof *errors);
  int status = points == NULL || found == NULL || errors == NULL;
  for (int64_t i = 0; i < sample && status == 0; i++) {
    const int64_t chosen = (int64_t)(fum_hash64((uint64_t)i) % (uint64_t)c->count);
    memcpy(points + 3 * i, c->positions + 3 * chosen, 3 * sizeof *points);
  }
  int64_t count = 0;
  for (int light = 0; light < o->lights && status == 0; light++) {
    status = fum_scene_transmittance(scene, &o->settings, light, sample, points, found);
    double to[3];
    light_position(middle, radius, light, to);
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

static int bench_lighting(fum_context *context, fum_scene *scene, const options *o, const cloud *c) {
  /* Every particle is lit whatever the picture shows: one pixel that looks away draws nothing. */
  fum_camera camera = make_camera(c, 1, 1);
  camera.clip_start = 0.0;
  camera.clip_end = 1e-6;
  float pixel[4];
  const fum_pass_buffer pass = {.pass = FUM_PASS_COMBINED, .pixels = pixel, .pixels_size = 4};
  fum_render_stats stats;
  fum_render_stats_init(&stats);
  if (fum_render(scene, &camera, &o->settings, 1, &pass, &stats) != FUM_OK) return fail(context);
  const double rss_mb = peak_rss_mb();
  error_summary errors = {0};
  if (measure_errors(scene, o, c, &errors) != 0) return fail(context);
  printf("{\"particles\": %lld, \"lights\": %d, \"solver\": \"%s\", \"threads\": %d, \"build_s\": %.4f, \"light_s\": %.4f, "
         "\"rms\": %.3g, \"p95\": %.3g, \"worst\": %.3g, \"peak_rss_mb\": %.1f}\n",
         (long long)c->count, o->lights, solver_name(stats.solver), o->threads, stats.build_s, stats.light_s, errors.rms,
         errors.p95, errors.worst, rss_mb);
  return 0;
}

static int write_exr(fum_context *context, const options *o, const float *combined, const float *depth) {
  const fum_image_layer layers[2] = {{"", "RGBA", combined}, {"Depth", "Z", depth}};
  const int32_t status = fum_exr_write(context, o->exr, o->width, o->height, o->wants_depth ? 2 : 1, layers);
  return status == FUM_OK ? 0 : fail(context);
}

static int bench_frame(fum_context *context, fum_scene *scene, const options *o, const cloud *c) {
  if (o->width < 1 || o->height < 1) return usage_error("out of range:", "--width, --height");
  const size_t pixels = (size_t)o->width * (size_t)o->height;
  float *combined = malloc(4 * pixels * sizeof *combined), *depth = malloc(pixels * sizeof *depth);
  if (combined == NULL || depth == NULL) {
    free(combined);
    free(depth);
    fprintf(stderr, "fumarole-bench: no memory for the picture\n");
    return 1;
  }
  const fum_camera camera = make_camera(c, o->width, o->height);
  const fum_pass_buffer passes[2] = {
      {.pass = FUM_PASS_COMBINED, .pixels = combined, .pixels_size = (int64_t)(4 * pixels)},
      {.pass = FUM_PASS_DEPTH, .pixels = depth, .pixels_size = (int64_t)pixels}};
  fum_render_stats stats;
  fum_render_stats_init(&stats);
  int status = fum_render(scene, &camera, &o->settings, o->wants_depth ? 2 : 1, passes, &stats) == FUM_OK ? 0 : fail(context);
  if (status == 0) {
    printf("{\"particles\": %lld, \"lights\": %d, \"solver\": \"%s\", \"threads\": %d, \"width\": %d, \"height\": %d, "
           "\"device\": \"%s\", \"drawn\": %lld, \"build_s\": %.4f, \"light_s\": %.4f, \"sort_s\": %.4f, \"draw_s\": %.4f, "
           "\"passes_s\": %.4f, \"total_s\": %.4f, \"peak_rss_mb\": %.1f}\n",
           (long long)c->count, o->lights, solver_name(stats.solver), o->threads, o->width, o->height, stats.device,
           (long long)stats.drawn_count, stats.build_s, stats.light_s, stats.sort_s, stats.draw_s, stats.passes_s,
           stats.total_s, peak_rss_mb());
    if (o->exr != NULL) status = write_exr(context, o, combined, depth);
  }
  free(depth);
  free(combined);
  return status;
}

static int run(fum_context *context, const options *o, const cloud *c) {
  fum_scene *scene = NULL;
  int status = fum_context_set_threads(context, o->threads);
  if (status == FUM_OK) status = fum_scene_create(context, &scene);
  if (status == FUM_OK) status = fill_scene(scene, c, o->lights);
  if (status != FUM_OK) {
    status = fail(context);
  } else if (strcmp(o->command, "lighting") == 0) {
    status = bench_lighting(context, scene, o, c);
  } else {
    status = bench_frame(context, scene, o, c);
  }
  fum_scene_destroy(scene);
  return status;
}

int main(int argc, char **argv) {
  options o;
  int status = parse(argc, argv, &o);
  if (status != 0) return status;
  char error[256] = "no memory for the particles";
  cloud c = {0};
  status = o.file != NULL ? cloud_read_ply(o.file, &c, error) : cloud_plume(o.particles, &c);
  if (status != 0) {
    fprintf(stderr, "fumarole-bench: %s\n", error);
    return 1;
  }
  fum_context *context = NULL;
  status = fum_context_create(&context) == FUM_OK ? run(context, &o, &c) : fail(NULL);
  fum_context_destroy(context);
  cloud_free(&c);
  return status;
}
