/* SPDX-License-Identifier: GPL-3.0-or-later */
#include "base/context.h"

#include "base/cpu.h"
#include "billboard/gl.h"
#include "output/exr.h"
#include "solid/solid.h"

#include <stdio.h>
#include <stdlib.h>
#include <string.h>

enum { MAX_THREADS = 1024 };

/* Why the last fum_context_create of this thread failed: there is no context yet to hold it. */
static _Thread_local char create_error[1024];

#define TEXT_OF(x) #x
#define TEXT(x) TEXT_OF(x)

const char *fum_version(void) {
  return TEXT(FUM_VERSION_MAJOR) "." TEXT(FUM_VERSION_MINOR) "." TEXT(FUM_VERSION_PATCH);
}

const char *fum_build_info(void) {
  static _Thread_local char info[256];
  char embree[32], openexr[32];
  fum_solids_embree_version(embree);
  fum_exr_version(openexr);
  snprintf(info, sizeof info, "Fumarole %s, %s, Embree %s, OpenEXR %s", fum_version(), fum_cpu_name(fum_cpu()), embree,
           openexr);
  return info;
}

int32_t fum_context_create(fum_context **out_context) {
  create_error[0] = '\0';
  if (out_context == NULL) {
    snprintf(create_error, sizeof create_error, "fum_context_create: out_context is null");
    return FUM_ERROR_ARGUMENT;
  }
  fum_context *context = calloc(1, sizeof *context);
  if (context == NULL) {
    snprintf(create_error, sizeof create_error, "no memory for a context");
    return FUM_ERROR_MEMORY;
  }
  int32_t status = fum_solids_check_embree(context);
  if (status != FUM_OK) {
    memcpy(create_error, context->error, sizeof create_error);
    free(context);
    return status;
  }
  *out_context = context;
  return FUM_OK;
}

void fum_context_destroy(fum_context *context) {
  if (context == NULL) return;
  fum_gl_destroy(context->gl);
  fum_warnings_clear(context);
  free(context);
}

int32_t fum_context_set_threads(fum_context *context, int32_t threads) {
  if (threads < 0 || threads > MAX_THREADS) {
    return fum_fail(context, FUM_ERROR_ARGUMENT, "threads %d is not within 0..%d", (int)threads, (int)MAX_THREADS);
  }
  context->threads = threads;
  return FUM_OK;
}

void fum_context_set_progress(fum_context *context, fum_progress_fn progress, void *user) {
  context->progress = progress;
  context->progress_user = user;
}

const char *fum_last_error(const fum_context *context) {
  return context != NULL ? context->error : create_error;
}

int32_t fum_warning_count(const fum_context *context) {
  return context->warning_count;
}

const char *fum_warning(const fum_context *context, int32_t index) {
  return index >= 0 && index < context->warning_count ? context->warnings[index] : NULL;
}

void fum_warnings_clear(fum_context *context) {
  for (int32_t i = 0; i < context->warning_count; i++)
    free(context->warnings[i]);
  free(context->warnings);
  context->warnings = NULL;
  context->warning_count = 0;
}
