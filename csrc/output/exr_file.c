/* SPDX-License-Identifier: GPL-3.0-or-later */
#include "output/exr_file.h"

#include "output/exr.h"

#include <OpenEXR/OpenEXRConfig.h>

#include <errno.h>
#include <stdio.h>
#include <string.h>
#include <unistd.h>

/* OpenEXRCore tells errors to a callback, on the thread that called it. */
static _Thread_local char exr_message[512];

static void keep_message(exr_const_context_t file, exr_result_t code, const char *message) {
  (void)file, (void)code;
  snprintf(exr_message, sizeof exr_message, "%s", message);
}

int32_t fum_exr_status(const fum_exr_file *file, exr_result_t result) {
  if (result == EXR_ERR_SUCCESS) return FUM_OK;
  const char *reason = exr_message[0] != '\0' ? exr_message : exr_get_default_error_message(result);
  const int32_t code = result == EXR_ERR_OUT_OF_MEMORY ? FUM_ERROR_MEMORY : FUM_ERROR_FILE;
  return fum_fail(file->context, code, "\"%s\" can't be written: %s", file->path, reason);
}

void fum_exr_version(char out_version[32]) {
  int major = 0, minor = 0, patch = 0;
  const char *extra = NULL;
  exr_get_library_version(&major, &minor, &patch, &extra);
  snprintf(out_version, 32, "%d.%d.%d", major, minor, patch);
}

static int32_t check_library(fum_context *context) {
  int major = 0, minor = 0, patch = 0;
  const char *extra = NULL;
  exr_get_library_version(&major, &minor, &patch, &extra);
  if (major == OPENEXR_VERSION_MAJOR && minor == OPENEXR_VERSION_MINOR) return FUM_OK;
  return fum_fail(context, FUM_ERROR_LIBRARY,
                  "OpenEXR %d.%d.%d is loaded, but Fumarole was built for %d.%d; files can't be written safely", major,
                  minor, patch, OPENEXR_VERSION_MAJOR, OPENEXR_VERSION_MINOR);
}

int32_t fum_exr_check(fum_context *context, const char *path, int32_t width, int32_t height) {
  if (path == NULL || path[0] == '\0') return fum_fail(context, FUM_ERROR_ARGUMENT, "the path of the image is empty");
  if (width < 1 || width > FUM_EXR_MOST_SIDE || height < 1 || height > FUM_EXR_MOST_SIDE) {
    return fum_fail(context, FUM_ERROR_ARGUMENT, "\"%s\": the size %d x %d is not within 1 to %d", path, width, height,
                    FUM_EXR_MOST_SIDE);
  }
  return FUM_OK;
}

/* A short name beside the target: a rename works within a file system only, and the target's own name may already be
 * as long as names can be. */
static int32_t make_temporary_path(fum_exr_file *file) {
  static atomic_uint counter;
  const char *slash = strrchr(file->path, '/');
  const int folder_length = slash != NULL ? (int)(slash - file->path + 1) : 0;
  const int64_t size = folder_length + 64;
  const int32_t status = fum_alloc(file->context, size, 1, "path", &file->temporary);
  if (status != FUM_OK) return status;
  snprintf(file->temporary, (size_t)size, "%.*s.fumarole-%ld-%u.tmp", folder_length, file->path, (long)getpid(),
           atomic_fetch_add(&counter, 1));
  return FUM_OK;
}

int32_t fum_exr_begin(fum_context *context, const char *path, fum_exr_file *out_file) {
  exr_context_initializer_t settings = EXR_DEFAULT_CONTEXT_INITIALIZER;
  settings.error_handler_fn = keep_message;
  exr_message[0] = '\0';
  *out_file = (fum_exr_file){.context = context, .path = path};
  int32_t status = check_library(context);
  if (status == FUM_OK) status = make_temporary_path(out_file);
  if (status != FUM_OK) return status;
  return fum_exr_status(out_file,
                        exr_start_write(&out_file->exr, out_file->temporary, EXR_WRITE_FILE_DIRECTLY, &settings));
}

int32_t fum_exr_end(fum_exr_file *file, int32_t status) {
  if (file->exr != NULL) {
    const exr_result_t result = exr_finish(&file->exr);
    if (status == FUM_OK) status = fum_exr_status(file, result);
  }
  if (status == FUM_OK && rename(file->temporary, file->path) != 0) {
    status = fum_fail(file->context, FUM_ERROR_FILE, "\"%s\" can't be written: %s", file->path, strerror(errno));
  }
  if (status != FUM_OK && file->temporary != NULL) unlink(file->temporary);
  fum_free(file->context, &file->temporary);
  return status;
}
