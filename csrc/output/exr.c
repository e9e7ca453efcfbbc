/* SPDX-License-Identifier: GPL-3.0-or-later */
/* Writes OpenEXR files through OpenEXRCore's C API. */
#include "output/exr_file.h"

#include <stdio.h>
#include <stdlib.h>
#include <string.h>

enum { MOST_CHANNELS = 1024, SHORT_NAME = 31, LONG_NAME = 255 };

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
  const int32_t checked = fum_exr_check(context, path, width, height);
  if (checked != FUM_OK) return checked;
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

static int32_t write_blocks(const fum_exr_file *file, const image *image) {
  exr_encode_pipeline_t encoder = EXR_ENCODE_PIPELINE_INITIALIZER;
  float *planes = NULL;
  int32_t block_rows = 0;
  exr_result_t result = exr_get_scanlines_per_chunk(file->exr, 0, &block_rows);
  if (result != EXR_ERR_SUCCESS) return fum_exr_status(file, result);
  const int32_t status = fum_alloc(file->context, (int64_t)image->channel_count * image->width * block_rows,
                                   sizeof *planes, "rows of the image", &planes);
  if (status != FUM_OK) return status;
  for (int32_t first = 0; first < image->height && result == EXR_ERR_SUCCESS; first += block_rows) {
    const int32_t left = image->height - first;
    result = write_block(file->exr, &encoder, image, first, left < block_rows ? left : block_rows, planes);
  }
  exr_encoding_destroy(file->exr, &encoder);
  fum_free(file->context, &planes);
  return fum_exr_status(file, result);
}

int32_t fum_exr_write(fum_context *context, const char *path, int32_t width, int32_t height, int32_t layer_count,
                      const fum_image_layer *layers) {
  if (context == NULL) return FUM_ERROR_ARGUMENT;
  image image = {.path = path, .width = width, .height = height};
  fum_exr_file file;
  int32_t status = check_image(context, path, width, height, layer_count, layers, &image.channel_count);
  if (status != FUM_OK) return status;
  status = fum_alloc(context, image.channel_count, sizeof *image.channels, "channels", &image.channels);
  if (status != FUM_OK) return status;
  status = collect_channels(context, &image, layer_count, layers);
  if (status == FUM_OK) {
    status = fum_exr_begin(context, path, &file);
    if (status == FUM_OK) status = fum_exr_status(&file, write_header(file.exr, &image));
    if (status == FUM_OK) status = write_blocks(&file, &image);
    status = fum_exr_end(&file, status);
  }
  fum_free(context, &image.channels);
  return status;
}
