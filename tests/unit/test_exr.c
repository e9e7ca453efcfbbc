/* SPDX-License-Identifier: GPL-3.0-or-later */
/* What fum_exr_write writes, read back with OpenEXRCore; and what it refuses. */
#include "fumarole.h"

#include <OpenEXR/openexr.h>

#include <dirent.h>
#include <math.h>
#include <setjmp.h>
#include <signal.h>
#include <stdarg.h>
#include <stdbool.h>
#include <stddef.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>
#include <sys/resource.h>
#include <sys/stat.h>
#include <unistd.h>

#include <cmocka.h>

typedef struct fixture {
  fum_context *context;
  char folder[64];
  char path[512];
} fixture;

static int set_up(void **state) {
  fixture *f = calloc(1, sizeof *f);
  assert_int_equal(fum_context_create(&f->context), FUM_OK);
  strcpy(f->folder, "/tmp/fumarole-exr-XXXXXX");
  assert_non_null(mkdtemp(f->folder));
  snprintf(f->path, sizeof f->path, "%s/picture.exr", f->folder);
  *state = f;
  return 0;
}

static int file_count(const char *folder) {
  int count = 0;
  DIR *directory = opendir(folder);
  assert_non_null(directory);
  for (struct dirent *entry; (entry = readdir(directory)) != NULL;)
    count += entry->d_name[0] != '.' || entry->d_name[1] == 'f';
  closedir(directory);
  return count;
}

static int tear_down(void **state) {
  fixture *f = *state;
  fum_context_destroy(f->context);
  unlink(f->path);
  assert_int_equal(rmdir(f->folder), 0); /* nothing else was left behind */
  free(f);
  return 0;
}

/* Reads one channel, first row at the top as in the file. */
static float *read_channel(const char *path, const char *name, int32_t width, int32_t height) {
  exr_context_t file = NULL;
  exr_context_initializer_t settings = EXR_DEFAULT_CONTEXT_INITIALIZER;
  float *pixels = calloc((size_t)width * (size_t)height, sizeof *pixels);
  assert_int_equal(exr_start_read(&file, path, &settings), EXR_ERR_SUCCESS);
  int32_t rows = 0;
  assert_int_equal(exr_get_scanlines_per_chunk(file, 0, &rows), EXR_ERR_SUCCESS);
  for (int32_t y = 0; y < height; y += rows) {
    exr_chunk_info_t block;
    exr_decode_pipeline_t decoder = EXR_DECODE_PIPELINE_INITIALIZER;
    bool found = false;
    assert_int_equal(exr_read_scanline_chunk_info(file, 0, y, &block), EXR_ERR_SUCCESS);
    assert_int_equal(exr_decoding_initialize(file, 0, &block, &decoder), EXR_ERR_SUCCESS);
    for (int16_t c = 0; c < decoder.channel_count; c++) {
      if (strcmp(decoder.channels[c].channel_name, name) != 0) continue;
      found = true;
      assert_int_equal(decoder.channels[c].data_type, EXR_PIXEL_FLOAT);
      decoder.channels[c].decode_to_ptr = (uint8_t *)(pixels + (size_t)y * (size_t)width);
      decoder.channels[c].user_pixel_stride = 4;
      decoder.channels[c].user_line_stride = 4 * width;
    }
    assert_true(found);
    assert_int_equal(exr_decoding_choose_default_routines(file, 0, &decoder), EXR_ERR_SUCCESS);
    assert_int_equal(exr_decoding_run(file, 0, &decoder), EXR_ERR_SUCCESS);
    exr_decoding_destroy(file, &decoder);
  }
  exr_finish(&file);
  return pixels;
}

static void assert_channel(const char *path, const char *name, int32_t width, int32_t height, const float *pixels,
                           int32_t stride, int32_t offset) {
  float *read = read_channel(path, name, width, height);
  for (int32_t y = 0; y < height; y++) {
    for (int32_t x = 0; x < width; x++) {
      const float *expected = &pixels[((size_t)y * (size_t)width + (size_t)x) * (size_t)stride + (size_t)offset];
      assert_memory_equal(&read[(size_t)(height - 1 - y) * (size_t)width + (size_t)x], expected, sizeof *expected);
    }
  }
  free(read);
}

/* A row count that is no multiple of the block's 16, values of all sizes and NaN. */
static void writes_layers_that_read_back(void **state) {
  fixture *f = *state;
  enum { WIDTH = 37, HEIGHT = 21 };
  float color[HEIGHT * WIDTH * 4], depth[HEIGHT * WIDTH];
  for (int i = 0; i < HEIGHT * WIDTH * 4; i++)
    color[i] = ldexpf((float)(i % 1001) - 500.0f, i % 60 - 30);
  for (int i = 0; i < HEIGHT * WIDTH; i++)
    depth[i] = i == 5 ? NAN : i == 6 ? INFINITY : 0.1f * (float)i;
  const fum_image_layer layers[] = {{"", "RGBA", color}, {"ViewLayer.Depth", "Z", depth}};
  assert_int_equal(fum_exr_write(f->context, f->path, WIDTH, HEIGHT, 2, layers), FUM_OK);
  for (int i = 0; i < 4; i++)
    assert_channel(f->path, (char[]){"RGBA"[i], 0}, WIDTH, HEIGHT, color, 4, i);
  assert_channel(f->path, "ViewLayer.Depth.Z", WIDTH, HEIGHT, depth, 1, 0);
}

static void file_is_zip_scanlines_with_ordered_channels(void **state) {
  fixture *f = *state;
  const float pixels[8] = {0};
  char long_name[200];
  memset(long_name, 'n', sizeof long_name);
  long_name[199] = '\0';
  const fum_image_layer layers[] = {{"", "RGBA", pixels}, {long_name, "X", pixels}};
  assert_int_equal(fum_exr_write(f->context, f->path, 2, 1, 2, layers), FUM_OK);
  exr_context_t file = NULL;
  exr_context_initializer_t settings = EXR_DEFAULT_CONTEXT_INITIALIZER;
  const exr_attr_chlist_t *channels;
  exr_compression_t compression;
  exr_storage_t storage;
  exr_attr_box2i_t window;
  assert_int_equal(exr_start_read(&file, f->path, &settings), EXR_ERR_SUCCESS);
  assert_int_equal(exr_get_channels(file, 0, &channels), EXR_ERR_SUCCESS);
  assert_int_equal(exr_get_compression(file, 0, &compression), EXR_ERR_SUCCESS);
  assert_int_equal(exr_get_storage(file, 0, &storage), EXR_ERR_SUCCESS);
  assert_int_equal(exr_get_data_window(file, 0, &window), EXR_ERR_SUCCESS);
  assert_int_equal(compression, EXR_COMPRESSION_ZIP);
  assert_int_equal(storage, EXR_STORAGE_SCANLINE);
  assert_int_equal(window.max.x, 1);
  assert_int_equal(window.max.y, 0);
  assert_int_equal(channels->num_channels, 5);
  for (int i = 0; i < 4; i++)
    assert_string_equal(channels->entries[i].name.str, ((char[]){"ABGR"[i], 0}));
  assert_memory_equal(channels->entries[4].name.str, long_name, 199);
  assert_string_equal(channels->entries[4].name.str + 199, ".X");
  exr_finish(&file);
}

static void unicode_path_and_long_name_are_written(void **state) {
  fixture *f = *state;
  const float pixel = 0.5f;
  const fum_image_layer layer = {"", "Z", &pixel};
  /* 255 bytes is the longest a name can be: the temporary file must not need more. */
  const size_t folder = (size_t)snprintf(f->path, sizeof f->path, "%s/", f->folder);
  for (size_t i = 0; i < 248; i += 4)
    memcpy(f->path + folder + i, "\xe7\x85\x99_", 5);
  strcat(f->path, "b\xc3\xbc.exr");
  assert_int_equal(strlen(f->path) - folder, 255);
  assert_int_equal(fum_exr_write(f->context, f->path, 1, 1, 1, &layer), FUM_OK);
  assert_channel(f->path, "Z", 1, 1, &pixel, 1, 0);
}

/* Files keep the permissions that the user's umask gives. */
static void file_can_be_read_by_others(void **state) {
  fixture *f = *state;
  const float pixel = 0.5f;
  const fum_image_layer layer = {"", "Z", &pixel};
  const mode_t mask = umask(022);
  assert_int_equal(fum_exr_write(f->context, f->path, 1, 1, 1, &layer), FUM_OK);
  umask(mask);
  struct stat status;
  assert_int_equal(stat(f->path, &status), 0);
  assert_int_equal(status.st_mode & 0777, 0644);
}

static void missing_folder_is_an_error_with_the_path(void **state) {
  fixture *f = *state;
  const float pixel = 0.5f;
  const fum_image_layer layer = {"", "Z", &pixel};
  char path[512];
  snprintf(path, sizeof path, "%s/missing/picture.exr", f->folder);
  assert_int_equal(fum_exr_write(f->context, path, 1, 1, 1, &layer), FUM_ERROR_FILE);
  assert_non_null(strstr(fum_last_error(f->context), path));
  assert_non_null(strstr(fum_last_error(f->context), "No such file"));
}

/* A folder stands where the file should go: the picture is written, but can't be moved there. */
static void failed_rename_leaves_no_temporary_file(void **state) {
  fixture *f = *state;
  const float pixel = 0.5f;
  const fum_image_layer layer = {"", "Z", &pixel};
  assert_int_equal(mkdir(f->path, 0755), 0);
  assert_int_equal(fum_exr_write(f->context, f->path, 1, 1, 1, &layer), FUM_ERROR_FILE);
  assert_non_null(strstr(fum_last_error(f->context), f->path));
  assert_int_equal(file_count(f->folder), 1);
  assert_int_equal(rmdir(f->path), 0);
}

static void replaces_a_file_and_keeps_it_when_refused(void **state) {
  fixture *f = *state;
  const float first = 0.25f, second[2] = {0.75f, 1.0f};
  assert_int_equal(fum_exr_write(f->context, f->path, 1, 1, 1, &(fum_image_layer){"", "Z", &first}), FUM_OK);
  assert_int_equal(fum_exr_write(f->context, f->path, 1, 1, 1, &(fum_image_layer){"", "", second}), FUM_ERROR_ARGUMENT);
  assert_channel(f->path, "Z", 1, 1, &first, 1, 0);
  assert_int_equal(fum_exr_write(f->context, f->path, 2, 1, 1, &(fum_image_layer){"", "Z", second}), FUM_OK);
  assert_channel(f->path, "Z", 2, 1, second, 1, 0);
  assert_int_equal(file_count(f->folder), 1);
}

static void bad_arguments_are_refused(void **state) {
  fixture *f = *state;
  fum_context *c = f->context;
  const float pixels[4] = {0};
  const fum_image_layer good = {"", "RGBA", pixels};
  char endless[300];
  memset(endless, 'n', sizeof endless);
  endless[299] = '\0';
  const fum_image_layer bad[] = {{NULL, "Z", pixels},      {"", NULL, pixels},    {"", "Z", NULL},
                                 {"", "", pixels},         {"", "RR", pixels},    {"", "R.", pixels},
                                 {"", "\xc3\xa9", pixels}, {endless, "Z", pixels}};
  const fum_image_layer twice[] = {{"a", "RG", pixels}, {"a", "G", pixels}};
  assert_int_equal(fum_exr_write(NULL, f->path, 1, 1, 1, &good), FUM_ERROR_ARGUMENT);
  assert_int_equal(fum_exr_write(c, NULL, 1, 1, 1, &good), FUM_ERROR_ARGUMENT);
  assert_int_equal(fum_exr_write(c, "", 1, 1, 1, &good), FUM_ERROR_ARGUMENT);
  assert_int_equal(fum_exr_write(c, f->path, 0, 1, 1, &good), FUM_ERROR_ARGUMENT);
  assert_non_null(strstr(fum_last_error(c), "0 x 1"));
  assert_int_equal(fum_exr_write(c, f->path, 1, -1, 1, &good), FUM_ERROR_ARGUMENT);
  assert_int_equal(fum_exr_write(c, f->path, 65537, 1, 1, &good), FUM_ERROR_ARGUMENT);
  assert_int_equal(fum_exr_write(c, f->path, 1, 1, 0, &good), FUM_ERROR_ARGUMENT);
  assert_int_equal(fum_exr_write(c, f->path, 1, 1, 1, NULL), FUM_ERROR_ARGUMENT);
  for (size_t i = 0; i < sizeof bad / sizeof *bad; i++) {
    assert_int_equal(fum_exr_write(c, f->path, 1, 1, 1, &bad[i]), FUM_ERROR_ARGUMENT);
  }
  assert_int_equal(fum_exr_write(c, f->path, 1, 1, 2, twice), FUM_ERROR_ARGUMENT);
  assert_non_null(strstr(fum_last_error(c), "\"a.G\""));
  assert_int_equal(file_count(f->folder), 0);
}

/* A limit on the size of files stands for a full disk: pixels that don't compress hit it half-way. */
static void full_disk_is_an_error_and_keeps_the_file(void **state) {
  fixture *f = *state;
  enum { SIDE = 256 };
  const float first = 0.25f;
  float *noise = malloc(SIDE * SIDE * sizeof *noise);
  for (int i = 0; i < SIDE * SIDE; i++)
    noise[i] = sinf(1e4f * (float)i);
  assert_int_equal(fum_exr_write(f->context, f->path, 1, 1, 1, &(fum_image_layer){"", "Z", &first}), FUM_OK);
  struct rlimit before;
  assert_int_equal(getrlimit(RLIMIT_FSIZE, &before), 0);
  signal(SIGXFSZ, SIG_IGN);
  setrlimit(RLIMIT_FSIZE, &(struct rlimit){65536, before.rlim_max});
  const int32_t status = fum_exr_write(f->context, f->path, SIDE, SIDE, 1, &(fum_image_layer){"", "Z", noise});
  setrlimit(RLIMIT_FSIZE, &before);
  signal(SIGXFSZ, SIG_DFL);
  free(noise);
  assert_int_equal(status, FUM_ERROR_FILE);
  assert_non_null(strstr(fum_last_error(f->context), f->path));
  assert_channel(f->path, "Z", 1, 1, &first, 1, 0);
  assert_int_equal(file_count(f->folder), 1);
}

static void wide_image_is_written(void **state) {
  fixture *f = *state;
  enum { WIDTH = 65536 };
  float *pixels = malloc(WIDTH * 3 * sizeof *pixels);
  for (int i = 0; i < WIDTH * 3; i++)
    pixels[i] = (float)i;
  assert_int_equal(fum_exr_write(f->context, f->path, WIDTH, 1, 1, &(fum_image_layer){"v", "XYZ", pixels}), FUM_OK);
  assert_channel(f->path, "v.Y", WIDTH, 1, pixels, 3, 1);
  free(pixels);
}

int main(void) {
#define TEST(name) cmocka_unit_test_setup_teardown(name, set_up, tear_down)
  const struct CMUnitTest tests[] = {TEST(writes_layers_that_read_back),
                                     TEST(file_is_zip_scanlines_with_ordered_channels),
                                     TEST(unicode_path_and_long_name_are_written),
                                     TEST(file_can_be_read_by_others),
                                     TEST(missing_folder_is_an_error_with_the_path),
                                     TEST(failed_rename_leaves_no_temporary_file),
                                     TEST(replaces_a_file_and_keeps_it_when_refused),
                                     TEST(bad_arguments_are_refused),
                                     TEST(full_disk_is_an_error_and_keeps_the_file),
                                     TEST(wide_image_is_written)};
  return cmocka_run_group_tests(tests, NULL, NULL);
}
