/* SPDX-License-Identifier: GPL-3.0-or-later */
/* What the benchmark was asked for on its command line. */
#ifndef FUM_TOOLS_OPTIONS_H
#define FUM_TOOLS_OPTIONS_H

#include "fumarole.h"

typedef struct options {
  const char *command, *scene, *file, *exr;
  int64_t particles; /* -1: the scene's own */
  int64_t sample;
  double depth; /* optical depth; 0: the scene's own */
  int32_t lights, threads, width, height;
  int32_t every;       /* image: compare every such pixel of every such row */
  int32_t wants_depth; /* Depth pass as well */
  fum_settings settings;
  fum_reference_settings reference;
} options;

/* Returns 0; 1 when only the usage was asked for and printed; 2 when the arguments are wrong and the usage was printed
 * on standard error. */
int options_parse(int argc, char **argv, options *out_options);

/* Says what is wrong and how to do it. Returns 2. */
int usage_error(const char *what, const char *value);

#endif
