/* SPDX-License-Identifier: GPL-3.0-or-later */
/* Writes OpenEXR files through OpenEXRCore's C API. */
#include "output/exr.h"

#include <OpenEXR/OpenEXRConfig.h>
#include <OpenEXR/openexr.h>

#include <errno.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>
#include <unistd.h>

enum { MOST_SIDE = 65536, MOST_CHANNELS = 1024, SHORT_NAME = 31, LONG_NAME = 255 };

typedef struct channel {
  char name[LONG_NAME + 1];
  const float *pixels; /* of the first pixel */
  int64_t pixel_floats;
} channel;

typedef struct image {
  const char *path;
  int32_t width, height, channel_count;
  channel *channels; /* by name, the order of the file */
} image;

/* OpenEXRCore tells errors to a callback, on the thread that called it. */
static _Thread_local char exr_message[512];

static void keep_message(exr_const_context_t file, exr_result_t code, const char *message) {
  (void)file, (void)code;
  snprintf(exr_message, sizeof exr_message, "%s", message);
}

static int32_t fail_exr(fum_context *context, const char *path, exr_result_t result) {
  const char *reason = exr_message[0] != '\0' ? exr_message : exr_get_default_error_message(result);
  const int32_t code = result == EXR_ERR_OUT_OF_MEMORY ? FUM_ERROR_MEMORY : FUM_ERROR_FILE;
  return fum_fail(context, code, "\"%s\" can't be written: %s", path, reason);
}

void fum_exr_version(char out_version[32]) {
  int major = 0, minor = 0, patch = 0;
  const char *extra = NULL;
  exr_get_library_version(&major, &minor, &patch, &extra);
  snprintf(out_version, 32, "%d.%d.%d", major, minor, patch);
}

int32_t fum_exr_check_library(fum_context *context) {
  int major = 0, minor = 0, patch = 0;
  const char *extra = NULL;
  exr_get_library_version(&major, &minor, &patch, &extra);
  if (major == OPENEXR_VERSION_MAJOR && minor == OPENEXR_VERSION_MINOR) return FUM_OK;
  return fum_fail(context, FUM_ERROR_LIBRARY,
                  "OpenEXR %d.%d.%d is loaded, but Fumarole was built for %d.%d; files can't be written safely", major,
                  minor, patch, OPENEXR_VERSION_MAJOR, OPENEXR_VERSION_MINOR);
}

/* ---- Channels ---------------------------------------------------------------------------------------------------- */

static int32_t check_layer(fum_context *context, int32_t index, const fum_image_layer *layer) {
  if (layer->name == NULL || layer->channels == NULL || layer->pixels == NULL) {
    return fum_fail(context, FUM_ERROR_ARGUMENT, "layer %d: name, channels and pixels must not be null", index);
  }
  const size_t longest = LONG_NAME - 2; /* a dot and a letter follow */
  if (strlen(layer->name) > longest) {
    return fum_fail(context, FUM_ERROR_ARGUMENT,
                    "layer %d: the name \"%.64s...\" has %zu bytes, at most %zu are possible", index, layer->name,
                    strlen(layer->name), longest);
  }
  if (layer->channels[0] == '\0') {
    return fum_fail(context, FUM_ERROR_ARGUMENT, "layer %d \"%s\" has no channels", index, layer->name);
  }
  for (const char *letter = layer->channels; *letter != '\0'; letter++) {
    if (*letter <= ' ' || *letter > '~' || *letter == '.') {
      return fum_fail(context, FUM_ERROR_ARGUMENT, "layer %d \"%s\": byte 0x%02x can't name a channel", index,
                      layer->name, (unsigned)(unsigned char)*letter);
    }
  }
  return FUM_OK;
}

static int compare_channels(const void *a, const void *b) {
  return strcmp(((const channel *)a)->name, ((const channel *)b)->name);
}

static int32_t check_image(fum_context *context, const char *path, int32_t width, int32_t height, int32_t layer_count,
                           const fum_image_layer *layers, int32_t *out_channel_count) {
  if (path == NULL || path[0] == '\0') return fum_fail(context, FUM_ERROR_ARGUMENT, "the path of the image is empty");
  if (width < 1 || width > MOST_SIDE || height < 1 || height > MOST_SIDE) {
    return fum_fail(context, FUM_ERROR_ARGUMENT, "\"%s\": the size %d x %d is not within 1 to %d", path, width, height,
                    MOST_SIDE);
  }
  if (layer_count < 1 || layer_count > MOST_CHANNELS || layers == NULL) {
    return fum_fail(context, FUM_ERROR_ARGUMENT, "\"%s\": %d layers given, 1 to %d are possible", path,
                    layers != NULL ? layer_count : 0, MOST_CHANNELS);
  }
  size_t count = 0;
  for (int32_t i = 0; i < layer_count; i++) {
    const int32_t status = check_layer(context, i, &layers[i]);
    if (status != FUM_OK) return status;
    count += strlen(layers[i].channels);
  }
  if (count > MOST_CHANNELS) {
    return fum_fail(context, FUM_ERROR_ARGUMENT, "\"%s\": %zu channels given, at most %d are possible", path, count,
                    MOST_CHANNELS);
  }
  *out_channel_count = (int32_t)count;
  return FUM_OK;
}

/* The format wants channels ordered by name, each once. */
static int32_t collect_channels(fum_context *context, image *image, int32_t layer_count,
                                const fum_image_layer *layers) {
  channel *next = image->channels;
  for (int32_t i = 0; i < layer_count; i++) {
    const size_t letters = strlen(layers[i].channels);
    for (size_t k = 0; k < letters; k++, next++) {
      next->pixels = layers[i].pixels + k;
      next->pixel_floats = (int64_t)letters;
      snprintf(next->name, sizeof next->name, "%s%s%c", layers[i].name, layers[i].name[0] != '\0' ? "." : "",
               layers[i].channels[k]);
    }
  }
  qsort(image->channels, (size_t)image->channel_count, sizeof *image->channels, compare_channels);
  for (int32_t i = 1; i < image->channel_count; i++) {
    if (strcmp(image->channels[i - 1].name, image->channels[i].name) == 0) {
      return fum_fail(context, FUM_ERROR_ARGUMENT, "\"%s\": the channel \"%s\" is given twice", image->path,
                      image->channels[i].name);
    }
  }
  return FUM_OK;
}

/* ---- Writing ----------------------------------------------------------------------------------------------------- */

static exr_result_t write_header(exr_context_t file, const image *image) {
  int part = 0, long_names = 0;
  for (int32_t i = 0; i < image->channel_count; i++)
    long_names |= strlen(image->channels[i].name) > SHORT_NAME;
  exr_result_t result = exr_set_longname_support(file, long_names);
  if (result == EXR_ERR_SUCCESS) result = exr_add_part(file, NULL, EXR_STORAGE_SCANLINE, &part);
  if (result == EXR_ERR_SUCCESS) {
    result = exr_initialize_required_attr_simple(file, part, image->width, image->height, EXR_COMPRESSION_ZIP);
  }
  for (int32_t i = 0; i < image->channel_count && result == EXR_ERR_SUCCESS; i++) {
    result = exr_add_channel(file, part, image->channels[i].name, EXR_PIXEL_FLOAT, EXR_PERCEPTUALLY_LOGARITHMIC, 1, 1);
  }
  return result == EXR_ERR_SUCCESS ? exr_write_header(file) : result;
}

/* Rows from `first` of the file, which counts from the top, one plane a channel. */
static void gather_rows(const image *image, int32_t first, int32_t row_count, float *out_planes) {
  for (int32_t c = 0; c < image->channel_count; c++) {
    const channel *channel = &image->channels[c];
    for (int32_t row = 0; row < row_count; row++) {
      const float *from =
          channel->pixels + (int64_t)(image->height - 1 - first - row) * image->width * channel->pixel_floats;
      for (int32_t x = 0; x < image->width; x++)
        *out_planes++ = from[x * channel->pixel_floats];
    }
  }
}

static exr_result_t write_block(exr_context_t file, exr_encode_pipeline_t *encoder, const image *image, int32_t first,
                                int32_t row_count, float *planes) {
  exr_chunk_info_t block;
  exr_result_t result = exr_write_scanline_chunk_info(file, 0, first, &block);
  if (result != EXR_ERR_SUCCESS) return result;
  const bool fresh = encoder->channels == NULL;
  result = fresh ? exr_encoding_initialize(file, 0, &block, encoder) : exr_encoding_update(file, 0, &block, encoder);
  if (result != EXR_ERR_SUCCESS) return result;
  gather_rows(image, first, row_count, planes);
  for (int16_t c = 0; c < encoder->channel_count; c++) {
    exr_coding_channel_info_t *channel = &encoder->channels[c];
    channel->user_pixel_stride = (int32_t)sizeof *planes;
    channel->user_line_stride = image->width * (int32_t)sizeof *planes;
    channel->encode_from_ptr = (const uint8_t *)(planes + (int64_t)c * row_count * image->width);
  }
  if (fresh) result = exr_encoding_choose_default_routines(file, 0, encoder);
  return result == EXR_ERR_SUCCESS ? exr_encoding_run(file, 0, encoder) : result;
}

static int32_t write_blocks(fum_context *context, exr_context_t file, const image *image) {
  exr_encode_pipeline_t encoder = EXR_ENCODE_PIPELINE_INITIALIZER;
  float *planes = NULL;
  int32_t block_rows = 0;
  exr_result_t result = exr_get_scanlines_per_chunk(file, 0, &block_rows);
  if (result != EXR_ERR_SUCCESS) return fail_exr(context, image->path, result);
  const int32_t status = fum_alloc(context, (int64_t)image->channel_count * image->width * block_rows, sizeof *planes,
                                   "rows of the image", &planes);
  if (status != FUM_OK) return status;
  for (int32_t first = 0; first < image->height && result == EXR_ERR_SUCCESS; first += block_rows) {
    const int32_t left = image->height - first;
    result = write_block(file, &encoder, image, first, left < block_rows ? left : block_rows, planes);
  }
  exr_encoding_destroy(file, &encoder);
  fum_free(context, &planes);
  return result == EXR_ERR_SUCCESS ? FUM_OK : fail_exr(context, image->path, result);
}

static int32_t write_file(fum_context *context, const char *temporary, const image *image) {
  exr_context_t file = NULL;
  exr_context_initializer_t settings = EXR_DEFAULT_CONTEXT_INITIALIZER;
  settings.error_handler_fn = keep_message;
  exr_message[0] = '\0';
  exr_result_t result = exr_start_write(&file, temporary, EXR_WRITE_FILE_DIRECTLY, &settings);
  if (result != EXR_ERR_SUCCESS) return fail_exr(context, image->path, result);
  result = write_header(file, image);
  int32_t status =
      result == EXR_ERR_SUCCESS ? write_blocks(context, file, image) : fail_exr(context, image->path, result);
  result = exr_finish(&file);
  if (status == FUM_OK && result != EXR_ERR_SUCCESS) status = fail_exr(context, image->path, result);
  return status;
}

/* A short name beside the target: a rename works within a file system only, and the target's own name may already be
 * as long as names can be. */
static int32_t make_temporary_path(fum_context *context, const char *path, char **out_path) {
  static atomic_uint counter;
  const char *slash = strrchr(path, '/');
  const int folder_length = slash != NULL ? (int)(slash - path + 1) : 0;
  const int64_t size = folder_length + 64;
  const int32_t status = fum_alloc(context, size, 1, "path", out_path);
  if (status != FUM_OK) return status;
  snprintf(*out_path, (size_t)size, "%.*s.fumarole-%ld-%u.tmp", folder_length, path, (long)getpid(),
           atomic_fetch_add(&counter, 1));
  return FUM_OK;
}

int32_t fum_exr_write(fum_context *context, const char *path, int32_t width, int32_t height, int32_t layer_count,
                      const fum_image_layer *layers) {
  if (context == NULL) return FUM_ERROR_ARGUMENT;
  image image = {.path = path, .width = width, .height = height};
  char *temporary = NULL;
  int32_t status = check_image(context, path, width, height, layer_count, layers, &image.channel_count);
  if (status != FUM_OK) goto done;
  if ((status = fum_exr_check_library(context)) != FUM_OK) goto done;
  status = fum_alloc(context, image.channel_count, sizeof *image.channels, "channels", &image.channels);
  if (status != FUM_OK) goto done;
  if ((status = collect_channels(context, &image, layer_count, layers)) != FUM_OK) goto done;
  if ((status = make_temporary_path(context, path, &temporary)) != FUM_OK) goto done;
  status = write_file(context, temporary, &image);
  if (status == FUM_OK && rename(temporary, path) != 0) {
    status = fum_fail(context, FUM_ERROR_FILE, "\"%s\" can't be written: %s", path, strerror(errno));
  }
  if (status != FUM_OK) unlink(temporary);
done:
  fum_free(context, &temporary);
  fum_free(context, &image.channels);
  return status;
}
