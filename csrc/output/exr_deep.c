/* SPDX-License-Identifier: GPL-3.0-or-later */
/* Writes deep OpenEXR files. OpenEXRCore 3.1 doesn't pack deep rows: they are packed here, as its documentation
 * "OpenEXR File Layout" says, and handed to it. */
#include "billboard/deep.h"
#include "output/exr_file.h"

#include <stddef.h>
#include <string.h>
#include <zlib.h>

/* Channels by name, the order of the file. */
typedef struct channel {
  const char *name;
  size_t offset; /* in a sample */
} channel;

#define COLOR(c) (offsetof(fum_deep_sample, rgba) + (c) * sizeof(float))
static const channel CHANNELS[] = {{"A", COLOR(3)},
                                   {"B", COLOR(2)},
                                   {"G", COLOR(1)},
                                   {"R", COLOR(0)},
                                   {"Z", offsetof(fum_deep_sample, depth)},
                                   {"ZBack", offsetof(fum_deep_sample, depth_back)}};
#undef COLOR

enum { CHANNEL_COUNT = sizeof CHANNELS / sizeof CHANNELS[0] };

/* Bytes on their way into the file. */
typedef struct packed {
  uint8_t *bytes;
  int64_t size;
} packed;

/* A row of the picture. */
typedef struct row {
  packed counts, samples;
} row;

/* Rows that are packed together, each by one thread. */
typedef struct batch {
  const fum_deep *deep;
  int64_t *firsts;       /* [height + 1] first sample of each row, from the bottom */
  int64_t counts_size;   /* bytes of a row's counts... */
  int64_t widest;        /* ...and of the row with the most, before packing */
  int32_t row_count;     /* in a batch */
  uint8_t *bytes, *room; /* [row_count][counts_size + widest], [threads][2 widest] */
  row *rows;             /* [row_count] */
} batch;

/* ---- Packing ----------------------------------------------------------------------------------------------------- */

/* ZIP of OpenEXR: bytes at even places, then those at odd ones, each as the difference to the one before. */
static void spread(const uint8_t *from, int64_t size, uint8_t *to) {
  uint8_t *even = to, *odd = to + (size + 1) / 2;
  for (int64_t i = 0; i < size; i++)
    *(i % 2 == 0 ? even++ : odd++) = from[i];
  for (int64_t i = size - 1; i > 0; i--)
    to[i] = (uint8_t)(to[i] - to[i - 1] + 128);
}

/* Packs `size` bytes; where that makes them no smaller they stay as they are. `room` has `size` bytes. */
static void pack(const uint8_t *from, int64_t size, uint8_t *room, packed *out) {
  const int level = 4;
  uLongf packed_size = (uLongf)size;
  out->size = size;
  if (size == 0) return;
  spread(from, size, room);
  if (compress2(out->bytes, &packed_size, room, (uLong)size, level) == Z_OK && (int64_t)packed_size < size) {
    out->size = (int64_t)packed_size;
  } else {
    memcpy(out->bytes, from, (size_t)size);
  }
}

static int64_t samples_size(const batch *b, int32_t y) {
  return (b->firsts[y + 1] - b->firsts[y]) * CHANNEL_COUNT * (int64_t)sizeof(float);
}

/* The file wants the sums of the counts. */
static void pack_counts(const batch *b, int32_t y, uint8_t *plain, packed *out) {
  const uint32_t *counts = b->deep->counts + (int64_t)y * b->deep->width;
  uint32_t sum = 0;
  for (int32_t x = 0; x < b->deep->width; x++) {
    sum += counts[x];
    memcpy(plain + (size_t)x * sizeof sum, &sum, sizeof sum);
  }
  pack(plain, b->counts_size, plain + b->widest, out);
}

static void pack_samples(const batch *b, int32_t y, uint8_t *plain, packed *out) {
  uint8_t *next = plain;
  for (int c = 0; c < CHANNEL_COUNT; c++) {
    for (int64_t i = b->firsts[y]; i < b->firsts[y + 1]; i++, next += sizeof(float))
      memcpy(next, (const uint8_t *)&b->deep->samples[i] + CHANNELS[c].offset, sizeof(float));
  }
  pack(plain, samples_size(b, y), plain + b->widest, out);
}

static void batch_free(fum_context *context, batch *b) {
  fum_free(context, &b->rows);
  fum_free(context, &b->room);
  fum_free(context, &b->bytes);
  fum_free(context, &b->firsts);
}

/* To be freed, whatever this returns. */
static int32_t batch_make(const fum_deep *deep, batch *b) {
  fum_context *context = deep->context;
  const int32_t threads = fum_thread_count(context);
  *b = (batch){.deep = deep, .counts_size = (int64_t)deep->width * (int64_t)sizeof(int32_t), .row_count = 4 * threads};
  int32_t status = fum_alloc(context, (int64_t)deep->height + 1, sizeof *b->firsts, "rows of the image", &b->firsts);
  if (status != FUM_OK) return status;
  b->widest = b->counts_size;
  fum_deep_find_rows(deep, b->firsts);
  for (int32_t y = 0; y < deep->height; y++) {
    if (samples_size(b, y) > b->widest) b->widest = samples_size(b, y);
  }
  status = fum_alloc(context, b->row_count, (size_t)(b->counts_size + b->widest), "rows of the image", &b->bytes);
  if (status == FUM_OK) status = fum_alloc(context, threads, (size_t)(2 * b->widest), "rows of the image", &b->room);
  if (status == FUM_OK) status = fum_alloc(context, b->row_count, sizeof *b->rows, "rows of the image", &b->rows);
  for (int32_t k = 0; k < b->row_count && status == FUM_OK; k++) {
    b->rows[k].counts.bytes = b->bytes + k * (b->counts_size + b->widest);
    b->rows[k].samples.bytes = b->rows[k].counts.bytes + b->counts_size;
  }
  return status;
}

/* ---- Writing ----------------------------------------------------------------------------------------------------- */

static exr_result_t write_header(exr_context_t exr, const fum_deep *deep, const fum_frame_part *part, int32_t top) {
  int index = 0;
  uint32_t most = 0;
  for (int64_t i = 0; i < (int64_t)deep->width * deep->height; i++)
    most = deep->counts[i] > most ? deep->counts[i] : most;
  const exr_attr_box2i_t data = {
      .min.x = part->left, .min.y = top, .max.x = part->left + deep->width - 1, .max.y = top + deep->height - 1};
  const exr_attr_box2i_t display = {.max.x = part->frame_width - 1, .max.y = part->frame_height - 1};
  const exr_attr_v2f_t center = {.x = 0.0F};
  exr_result_t result = exr_add_part(exr, NULL, EXR_STORAGE_DEEP_SCANLINE, &index);
  if (result == EXR_ERR_SUCCESS) {
    result = exr_initialize_required_attr(exr, index, &display, &data, 1.0F, &center, 1.0F, EXR_LINEORDER_INCREASING_Y,
                                          EXR_COMPRESSION_ZIPS);
  }
  for (int c = 0; c < CHANNEL_COUNT && result == EXR_ERR_SUCCESS; c++)
    result = exr_add_channel(exr, index, CHANNELS[c].name, EXR_PIXEL_FLOAT, EXR_PERCEPTUALLY_LOGARITHMIC, 1, 1);
  if (result == EXR_ERR_SUCCESS) result = exr_set_version(exr, index, 1);
  if (result == EXR_ERR_SUCCESS) result = exr_attr_set_int(exr, index, "maxSamplesPerPixel", (int32_t)most);
  return result == EXR_ERR_SUCCESS ? exr_write_header(exr) : result;
}

/* Writes `count` rows, from the one that is `first` rows below the top on. */
static exr_result_t write_batch(exr_context_t exr, const batch *b, int32_t top, int32_t first, int32_t count) {
  const int32_t highest = b->deep->height - 1 - first;
#pragma omp parallel for num_threads(fum_thread_count(b->deep->context)) schedule(dynamic)
  for (int32_t k = 0; k < count; k++) {
    uint8_t *plain = b->room + omp_get_thread_num() * 2 * b->widest;
    pack_counts(b, highest - k, plain, &b->rows[k].counts);
    pack_samples(b, highest - k, plain, &b->rows[k].samples);
  }
  exr_result_t result = EXR_ERR_SUCCESS;
  for (int32_t k = 0; k < count && result == EXR_ERR_SUCCESS; k++) {
    const packed *counts = &b->rows[k].counts, *samples = &b->rows[k].samples;
    result =
        exr_write_deep_scanline_chunk(exr, 0, top + first + k, samples->bytes, (uint64_t)samples->size,
                                      (uint64_t)samples_size(b, highest - k), counts->bytes, (uint64_t)counts->size);
  }
  return result;
}

static int32_t write_file(const fum_exr_file *file, const batch *b, const fum_frame_part *part) {
  const int32_t height = b->deep->height, top = part->frame_height - part->bottom - height;
  exr_result_t result = write_header(file->exr, b->deep, part, top);
  for (int32_t first = 0; first < height && result == EXR_ERR_SUCCESS; first += b->row_count) {
    const int32_t left = height - first;
    result = write_batch(file->exr, b, top, first, left < b->row_count ? left : b->row_count);
  }
  return fum_exr_status(file, result);
}

static int32_t check_part(const fum_deep *deep, const char *path, const fum_frame_part *part) {
  fum_context *context = deep->context;
  const int32_t status = fum_exr_check(context, path, part->frame_width, part->frame_height);
  if (status != FUM_OK) return status;
  if (part->left < 0 || part->bottom < 0 || part->left > part->frame_width - deep->width ||
      part->bottom > part->frame_height - deep->height) {
    return fum_fail(context, FUM_ERROR_ARGUMENT,
                    "\"%s\": the picture of %d x %d pixels at %d, %d isn't within the frame of %d x %d", path,
                    (int)deep->width, (int)deep->height, (int)part->left, (int)part->bottom, (int)part->frame_width,
                    (int)part->frame_height);
  }
  return FUM_OK;
}

int32_t fum_deep_write(const fum_deep *deep, const char *path, const fum_frame_part *part) {
  if (deep == NULL) return FUM_ERROR_ARGUMENT;
  const fum_frame_part all = {.frame_width = deep->width, .frame_height = deep->height};
  fum_exr_file file;
  batch b;
  if (part == NULL) part = &all;
  int32_t status = check_part(deep, path, part);
  if (status != FUM_OK) return status;
  status = batch_make(deep, &b);
  if (status == FUM_OK) {
    status = fum_exr_begin(deep->context, path, &file);
    if (status == FUM_OK) status = write_file(&file, &b, part);
    status = fum_exr_end(&file, status);
  }
  batch_free(deep->context, &b);
  return status;
}
