/* SPDX-License-Identifier: GPL-3.0-or-later */
/* An OpenEXR file on its way: written beside its path under a temporary name, and put there in one step. */
#ifndef FUM_OUTPUT_EXR_FILE_H
#define FUM_OUTPUT_EXR_FILE_H

#include "base/context.h"

#include <OpenEXR/openexr.h>

enum { FUM_EXR_MOST_SIDE = 65536 };

typedef struct fum_exr_file {
  fum_context *context;
  const char *path;
  char *temporary;
  exr_context_t exr;
} fum_exr_file;

/* Refuses an empty path and sizes that files can't have. */
int32_t fum_exr_check(fum_context *context, const char *path, int32_t width, int32_t height);

/* Begins a file; fum_exr_end must follow, whatever this returns. */
int32_t fum_exr_begin(fum_context *context, const char *path, fum_exr_file *out_file);

/* FUM_OK for a success; else notes what OpenEXR says, with the path. */
int32_t fum_exr_status(const fum_exr_file *file, exr_result_t result);

/* Ends the file. With the status FUM_OK it takes its place; else nothing is left of it. Returns the status, or why it
 * can't take its place. */
int32_t fum_exr_end(fum_exr_file *file, int32_t status);

#endif
