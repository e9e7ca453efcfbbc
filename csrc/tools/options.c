/* SPDX-License-Identifier: GPL-3.0-or-later */
#include "tools/options.h"

#include <stdbool.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>

static const char USAGE[] =
    "usage: fumarole-bench lighting|frame|reference|image [OPTIONS]\n"
    "  --scene NAME     plume (default 250000 particles, of image 1000000), ball (2000), puff (1), six (6), mixed "
    "(300, radii 1 to 30),\n"
    "                   edge (2000, half of them behind a wall). Default plume, of image ball\n"
    "  --particles N\n"
    "  --overlap X      n sigma^3 of plume (0.7), ball, mixed and edge (0.5): widens the particles at the same depth\n"
    "  --file F.ply     particles of a binary little-endian PLY instead: x y z [radius density red green blue]\n"
    "  --lights K       point lights around it (default 1)\n"
    "  --threads T      default: all cores\n"
    "  --tolerance X    default 0.01, of reference 0.0001\n"
    "  --leaf N         leaf size of the octree (default: the library's)\n"
    "  --subsampling S  share of the particles that cast shadows (default 1)\n"
    "  --device auto|gl|tiles\n"
    "  --width W --height H   default 960 x 540, of reference and image 96 x 96, of image\n"
    "                   --scene plume 768 x 768\n"
    "lighting: time and errors of the transmittance\n"
    "  --solver automatic|exact|sweep, --sample N (particles checked by brute force, default 256)\n"
    "frame: time of a picture\n"
    "  --depth (Depth pass as well), --exr FILE\n"
    "  --grow X (particles are drawn X times as large, as opaque and lit as before), --dense X (times their density)\n"
    "reference: the same picture by brute force\n"
    "  --depth D (optical depth across the scene), --exr FILE\n"
    "image: errors of the picture against the reference, a row for each position of the light\n"
    "  --depth D (default 5, of puff and six 3 a particle, of plume 8), --reference-tolerance X (default 0.0001),\n"
    "  --every N (compares every Nth pixel of every Nth row; default 1, of plume 64),\n"
    "  --light side|front|behind|two (one of them alone), --repeat N (the one of median time of N renders, 15 at "
    "most),\n"
    "  --then (the options after it change settings for one more row against the same reference, 64 at most)\n";

int usage_error(const char *what, const char *value) {
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

static bool parse_choice(const char *value, const char *const *names, int count, int32_t *out) {
  const int chosen = choose(value, names, count);
  if (chosen >= 0) *out = chosen;
  return chosen >= 0;
}

/* Where a numeric option goes. One of the pointers is set. */
typedef struct number_option {
  const char *name;
  int64_t *big;
  int32_t *whole;
  float *single;
  double *real;
} number_option;

static bool parse_number(options *o, const char *name, const char *value) {
  const bool is_reference = strcmp(o->command, "reference") == 0;
  const number_option table[] = {
      {"--particles", .big = &o->particles},
      {"--sample", .big = &o->sample},
      {"--depth", .real = &o->depth},
      {"--overlap", .real = &o->overlap},
      {"--grow", .real = &o->grow},
      {"--dense", .real = &o->dense},
      {"--lights", .whole = &o->lights},
      {"--threads", .whole = &o->threads},
      {"--width", .whole = &o->width},
      {"--height", .whole = &o->height},
      {"--every", .whole = &o->every},
      {"--repeat", .whole = &o->repeat},
      {"--leaf", .whole = &o->settings.leaf_size},
      {"--subsampling", .single = &o->settings.subsampling},
      {"--tolerance", .single = is_reference ? NULL : &o->settings.tolerance,
       .real = is_reference ? &o->reference.tolerance : NULL},
      {"--reference-tolerance", .real = &o->reference.tolerance},
  };
  char *end = NULL;
  const double number = strtod(value, &end);
  if (end == value || *end != '\0' || !(number > -2e9 && number < 9e15)) return false;
  for (size_t i = 0; i < sizeof table / sizeof table[0]; i++) {
    if (strcmp(name, table[i].name) != 0) continue;
    if (table[i].big != NULL) *table[i].big = (int64_t)number;
    if (table[i].whole != NULL) *table[i].whole = (int32_t)(number < 2e9 ? number : 2e9);
    if (table[i].single != NULL) *table[i].single = (float)number;
    if (table[i].real != NULL) *table[i].real = number;
    return true;
  }
  return false;
}

static bool parse_option(options *o, const char *name, const char *value) {
  static const char *const solvers[] = {"automatic", "exact", "sweep"}, *const devices[] = {"auto", "gl", "tiles"};
  const char **text = strcmp(name, "--file") == 0    ? &o->file
                      : strcmp(name, "--light") == 0 ? &o->light
                      : strcmp(name, "--exr") == 0   ? &o->exr
                      : strcmp(name, "--scene") == 0 ? &o->scene
                                                     : NULL;
  if (text != NULL) {
    *text = value;
    return true;
  }
  if (strcmp(name, "--solver") == 0) return parse_choice(value, solvers, 3, &o->settings.solver);
  if (strcmp(name, "--device") == 0) return parse_choice(value, devices, 3, &o->settings.device);
  return parse_number(o, name, value);
}

static void set_defaults(options *o, const char *command) {
  *o = (options){.command = command,
                 .scene = strcmp(command, "image") == 0 ? "ball" : "plume",
                 .particles = -1,
                 .sample = 256,
                 .lights = 1,
                 .grow = 1.0,
                 .dense = 1.0,
                 .repeat = 1};
  fum_settings_init(&o->settings);
  fum_reference_settings_init(&o->reference);
}

/* Sizes that were not asked for. A million particles of the plume are seen in pixels smaller than they are. */
static void set_sizes(options *o) {
  const bool is_image = strcmp(o->command, "image") == 0, is_reference = strcmp(o->command, "reference") == 0;
  const bool is_plume = is_image && o->file == NULL && strcmp(o->scene, "plume") == 0;
  if (o->width == 0) o->width = is_plume ? 768 : is_image || is_reference ? 96 : 960;
  if (o->height == 0) o->height = is_plume ? 768 : is_image || is_reference ? 96 : 540;
  if (o->every == 0) o->every = is_plume ? 64 : 1;
  if (o->particles == -1 && is_plume) o->particles = 1000000;
}

static bool is_in_range(const options *o) {
  const bool is_frame = strcmp(o->command, "frame") == 0;
  if (!is_frame && (o->grow != 1.0 || o->dense != 1.0)) return false;
  return o->particles >= -1 && o->lights >= 0 && o->lights <= 1024 && o->sample >= 0 && o->depth >= 0.0 &&
         o->overlap >= 0.0 && o->grow >= 0.01 && o->grow <= 100.0 && o->dense >= 0.0 && o->dense <= 1e6 &&
         o->every >= 1 && o->every <= 1024 && o->repeat >= 1 && o->repeat <= OPTIONS_MAX_REPEAT && o->width >= 1 &&
         o->height >= 1 && o->width <= 65536 && o->height <= 65536;
}

int options_parse(int argc, char **argv, options *o) {
  static const char *const commands[] = {"lighting", "frame", "reference", "image"};
  if (argc < 2) return usage_error("a command is missing", "");
  if (strcmp(argv[1], "--help") == 0) {
    printf("%s", USAGE);
    return 1;
  }
  if (choose(argv[1], commands, 4) < 0) return usage_error("unknown command", argv[1]);
  set_defaults(o, argv[1]);
  for (int i = 2; i < argc; i++) {
    if (strcmp(argv[i], "--depth") == 0 && strcmp(o->command, "frame") == 0) {
      o->wants_depth = 1;
      continue;
    }
    if (strcmp(argv[i], "--then") == 0 && strcmp(o->command, "image") == 0 && o->row_count + 1 < OPTIONS_MAX_ROWS) {
      o->rows[o->row_count++] = o->settings;
      continue;
    }
    if (i + 1 >= argc || !parse_option(o, argv[i], argv[i + 1])) return usage_error("can't use", argv[i]);
    i++;
  }
  o->rows[o->row_count++] = o->settings;
  set_sizes(o);
  if (!is_in_range(o)) return usage_error("out of range:", "a number");
  return 0;
}
