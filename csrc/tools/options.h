/* SPDX-License-Identifier: GPL-3.0-or-later */
/* What the benchmark was asked for on its command line. */
#ifndef FUM_TOOLS_OPTIONS_H
#define FUM_TOOLS_OPTIONS_H

#include "fumarole.h"

enum { OPTIONS_MAX_ROWS = 64, OPTIONS_MAX_REPEAT = 15 };

typedef struct options {
  const char *command, *scene, *file, *exr;
  const char *light; /* image: name of the one arrangement of lights; NULL: all */
  int64_t particles; /* -1: the scene's own */
  int64_t sample;
  double depth;   /* optical depth; 0: the scene's own */
  double overlap; /* n sigma^3; 0: the scene's own */
  double grow;    /* frame: factor on the particles' radius as the camera sees it */
  double dense;   /* factor on the particles' density */
  int32_t lights, threads, width, height;
  int32_t every;       /* image: compare every such pixel of every such row */
  int32_t repeat;      /* image: renders of each row, of which the one of the median processor time counts */
  int32_t wants_depth; /* Depth pass as well */
  int32_t row_count;
  fum_settings rows[OPTIONS_MAX_ROWS]; /* image: settings of each row */
  fum_settings settings;               /* the last of them */
  fum_reference_settings reference;
} options;

/* Returns 0; 1 when only the usage was asked for and printed; 2 when the arguments are wrong and the usage was printed
 * on standard error. */
int options_parse(int argc, char **argv, options *out_options);

/* Says what is wrong and how to do it. Returns 2. */
int usage_error(const char *what, const char *value);

#endif
