/* SPDX-License-Identifier: GPL-3.0-or-later */
/* Curves and the samples that stand for them; deep files read back with OpenEXRCore and flattened by OpenEXR. */
#include "support.h"

#include "billboard/deep_curve.h"

#include <OpenEXR/ImfCRgbaFile.h>
#include <OpenEXR/openexr.h>

#include <dirent.h>
#include <signal.h>
#include <stdbool.h>
#include <stdio.h>
#include <string.h>
#include <sys/resource.h>
#include <sys/stat.h>
#include <unistd.h>

/* ---- Curves ------------------------------------------------------------------------------------------------------ */

enum { MOST = 640 };

static float memory[3][8 * (MOST + 32)];

static fum_deep_curve curve_in(int place) {
  fum_deep_curve curve;
  assert_true(fum_deep_curve_size(MOST) <= (int64_t)(sizeof memory[0] / sizeof *memory[0]));
  fum_deep_curve_place(memory[place], MOST, &curve);
  return curve;
}

/* Two Gaussians of smoke of one extinction, with what they scatter: closed forms up to a depth. */
static const double MIDDLES[2] = {4.0, 7.0}, WIDTHS[2] = {0.5, 0.25}, DEPTHS[2] = {1.5, 2.0};

static double optical_depth_at(double depth) {
  double sum = 0.0;
  for (int i = 0; i < 2; i++)
    sum += DEPTHS[i] * 0.5 * erfc(-(depth - MIDDLES[i]) / (WIDTHS[i] * sqrt(2.0)));
  return sum;
}

static void sums_at(double depth, float out[4]) {
  const double tau = optical_depth_at(depth);
  const float opacity = (float)-expm1(-tau);
  out[0] = (float)tau;
  out[1] = 2.0F * opacity;
  out[2] = opacity * opacity;
  out[3] = 0.0F;
}

static fum_deep_curve smoke_curve(int place, double step) {
  fum_deep_curve curve = curve_in(place);
  for (double depth = 1.0; depth < 9.0 + 0.5 * step; depth += step) {
    float sums[4];
    sums_at(depth, sums);
    fum_deep_curve_add(&curve, (float)depth, sums);
  }
  return curve;
}

static void bent_curves_follow_gaussians(void **state) {
  (void)state;
  const fum_deep_curve knots = smoke_curve(0, 0.25);
  fum_deep_curve bent = curve_in(1);
  fum_deep_bend(&knots, &bent);
  assert_true(bent.count > FUM_DEEP_STEPS * (knots.count - 8)); /* none where the tails are 0 */
  double worst = 0.0, straight = 0.0;
  for (int32_t i = 0; i < bent.count; i++) {
    const double depth = (double)bent.depth[i], truth = optical_depth_at(depth);
    worst = fmax(worst, fabs((double)bent.sums[0][i] - truth));
    if (i == 0) continue;
    assert_true(bent.depth[i] > bent.depth[i - 1]);
    for (int k = 0; k < 4; k++)
      assert_true(bent.sums[k][i] >= bent.sums[k][i - 1]);
    straight = fmax(straight, fabs(0.5 * (optical_depth_at(depth - 0.125) + optical_depth_at(depth + 0.125)) - truth));
  }
  /* knots are as far apart as the narrower Gaussian is wide: straight lines between them would be this far off */
  assert_true(straight > 0.05);
  assert_true(worst < 0.02);
}

/* What is in front of a depth: samples over one another, the one that holds the depth cut as the header says. */
static void flatten(const fum_deep_sample *samples, int32_t count, double depth, double out[4]) {
  double transmittance = 1.0;
  memset(out, 0, 4 * sizeof *out);
  for (int32_t i = 0; i < count; i++) {
    const fum_deep_sample *s = &samples[i];
    const double length = (double)s->depth_back - (double)s->depth;
    const double share = fmin(1.0, fmax(0.0, (depth - (double)s->depth) / length));
    const double whole = (double)s->rgba[3], part = -expm1(share * log1p(-whole));
    for (int c = 0; c < 3; c++)
      out[c] += transmittance * (double)s->rgba[c] * (whole > 0.0 ? part / whole : share);
    out[3] += transmittance * part;
    transmittance *= 1.0 - part;
  }
}

static void samples_keep_their_limits(void **state) {
  (void)state;
  static fum_deep_sample samples[MOST];
  const fum_deep_curve curve = smoke_curve(0, 1.0 / 64.0);
  int32_t before = MOST;
  for (float error = 0.002F; error < 0.3F; error *= 4.0F) {
    const fum_deep_limits limits = {error, false};
    const int32_t count = fum_deep_divide(&curve, &limits, samples);
    assert_true(count >= 1 && count < before); /* coarser, so fewer */
    before = count;
    float last[4];
    sums_at(9.0, last);
    double all[4];
    flatten(samples, count, INFINITY, all);
    for (int c = 0; c < 3; c++)
      assert_true(fabs(all[c] - (double)last[1 + c]) < 1e-5);
    assert_true(fabs(all[3] + expm1(-(double)last[0])) < 1e-5);
    for (double depth = 1.0; depth < 9.0; depth += 0.01) {
      float sums[4];
      double seen[4];
      sums_at(depth, sums);
      flatten(samples, count, depth, seen);
      /* between points both are off by a little more */
      assert_true(fabs(seen[3] + expm1(-(double)sums[0])) < 1.05 * (double)error + 1e-3);
      for (int c = 0; c < 3; c++)
        assert_true(fabs(seen[c] - (double)sums[1 + c]) < 1.05 * (double)error * (double)last[1] + 2e-3);
    }
    for (int32_t i = 0; i < count; i++) {
      assert_true(samples[i].depth < samples[i].depth_back);
      assert_true(i == 0 || samples[i].depth >= samples[i - 1].depth_back);
    }
  }
}

/* However much may be wrong, nothing is where there is no smoke. */
static void gaps_are_not_bridged(void **state) {
  (void)state;
  fum_deep_curve curve = curve_in(0);
  const float points[][2] = {{1.0F, 0.0F}, {2.0F, 0.01F}, {5.0F, 0.01F}, {6.0F, 0.02F}, {9.0F, 0.02F}};
  fum_deep_sample samples[8];
  for (int i = 0; i < 5; i++)
    fum_deep_curve_add(&curve, points[i][0], (float[4]){points[i][1], points[i][1], 0.0F, 0.0F});
  assert_int_equal(fum_deep_divide(&curve, &(fum_deep_limits){0.5F, true}, samples), 2);
  assert_true(samples[0].depth == 1.0F && samples[0].depth_back == 2.0F);
  assert_true(samples[1].depth == 5.0F && samples[1].depth_back == 6.0F);
  assert_true(fabsf(samples[1].rgba[0] - 0.01F * expf(0.01F)) < 1e-6F);
}

/* Light without smoke: no opacity, and all of the light. */
static void what_glows_alone_is_kept(void **state) {
  (void)state;
  fum_deep_curve curve = curve_in(0);
  fum_deep_sample samples[8];
  for (int i = 0; i <= 8; i++)
    fum_deep_curve_add(&curve, 1.0F + (float)i, (float[4]){0.0F, 3.0F * (float)i, 0.0F, (float)(i * i)});
  const int32_t count = fum_deep_divide(&curve, &(fum_deep_limits){0.01F, false}, samples);
  double sum[3] = {0.0};
  for (int32_t i = 0; i < count; i++) {
    for (int c = 0; c < 3; c++)
      sum[c] += (double)samples[i].rgba[c];
    assert_true(samples[i].rgba[3] == 0.0F);
  }
  assert_true(fabs(sum[0] - 24.0) < 1e-5 && fabs(sum[2] - 64.0) < 1e-5);
}

static void mixtures_are_means_of_pictures(void **state) {
  (void)state;
  const fum_deep_curve all = smoke_curve(0, 0.05), empty = {0};
  fum_deep_curve front = curve_in(1), mixed = curve_in(2);
  for (int32_t i = 0; i < all.count && all.depth[i] < 4.1F; i++)
    fum_deep_curve_add(&front, all.depth[i], (float[4]){all.sums[0][i], all.sums[1][i], all.sums[2][i], 0.0F});
  const int32_t last = front.count - 1;
  const fum_deep_share shares[2] = {{0.25F, {0.25F, 0.25F, 0.25F}}, {0.75F, {0.75F, 0.75F, 0.75F}}};
  fum_deep_mix(2, (const fum_deep_curve[2]){front, all}, shares, &mixed);
  assert_int_equal(mixed.count, all.count);
  for (int32_t i = 0; i < all.count; i++) {
    const int32_t of_front = i < last ? i : last;
    const float opacity = -0.25F * expm1f(-front.sums[0][of_front]) - 0.75F * expm1f(-all.sums[0][i]);
    assert_true(fabsf(-expm1f(-mixed.sums[0][i]) - opacity) < 1e-6F);
    assert_true(fabsf(mixed.sums[1][i] - 0.25F * front.sums[1][of_front] - 0.75F * all.sums[1][i]) < 1e-6F);
  }
  mixed.count = 0;
  fum_deep_mix(2, (const fum_deep_curve[2]){empty, all}, shares, &mixed);
  assert_int_equal(mixed.count, all.count);
  assert_true(fabsf(mixed.sums[2][all.count - 1] - 0.75F * all.sums[2][all.count - 1]) < 1e-6F);
}

/* Samples become the curve that they stand for. */
static void unfolded_samples_are_the_curve(void **state) {
  (void)state;
  static fum_deep_sample samples[MOST];
  const fum_deep_curve curve = smoke_curve(0, 1.0 / 64.0);
  fum_deep_curve unfolded = curve_in(1);
  const int32_t count = fum_deep_divide(&curve, &(fum_deep_limits){0.02F, false}, samples);
  fum_deep_unfold(samples, count, &unfolded);
  assert_true(unfolded.count > 2 * count && unfolded.count <= (1 + FUM_DEEP_STEPS) * count);
  for (int32_t i = 0; i < unfolded.count; i++) {
    double seen[4];
    flatten(samples, count, (double)unfolded.depth[i], seen);
    assert_true(fabs(seen[3] + expm1(-(double)unfolded.sums[0][i])) < 1e-5);
    for (int c = 0; c < 3; c++)
      assert_true(fabs(seen[c] - (double)unfolded.sums[1 + c][i]) < 1e-5);
  }
}

/* ---- Files ------------------------------------------------------------------------------------------------------- */

enum { WIDTH = 50, HEIGHT = 41 };

typedef struct fixture {
  stage s;
  fum_deep *deep;
  char folder[64], path[128];
  float combined[4 * WIDTH * HEIGHT];
} fixture;

static int32_t draw(const stage *s, float *out_combined, fum_deep **out_deep) {
  fum_camera camera;
  fum_camera_init(&camera);
  camera.width = WIDTH;
  camera.height = HEIGHT;
  camera.world_from_camera[11] = 4.0;
  memcpy(camera.window, (double[4]){-0.35, 0.25, -0.25, 0.25}, sizeof camera.window);
  const fum_pass_buffer pass = {.pass = FUM_PASS_COMBINED, .pixels = out_combined, .pixels_size = 4 * WIDTH * HEIGHT};
  return fum_render_deep(s->scene, &camera, NULL, 1, &pass, out_deep, NULL);
}

static void furnish(const stage *s) {
  const double light[3] = {3.0, 2.0, 1.0};
  const float corners[9] = {-3.0F, -0.4F, 0.1F, 0.4F, -0.3F, 0.1F, 0.0F, 3.0F, 0.1F};
  puffs p = puffs_random(300, 5, 0.6F, 0.3F, 3.0F);
  fum_mesh_desc mesh;
  fum_mesh_desc_init(&mesh);
  mesh.vertex_count = 3;
  mesh.triangle_count = 1;
  mesh.vertices = corners;
  mesh.triangles = (const uint32_t[3]){0, 1, 2};
  add_puffs(s->scene, &p);
  add_point_light(s->scene, light);
  assert_int_equal(fum_scene_add_mesh(s->scene, &mesh), FUM_OK);
  puffs_free(&p);
}

static int set_up(void **state) {
  fixture *f = calloc(1, sizeof *f);
  f->s = stage_open();
  strcpy(f->folder, "/tmp/fumarole-deep-XXXXXX");
  assert_non_null(mkdtemp(f->folder));
  snprintf(f->path, sizeof f->path, "%s/deep.exr", f->folder);
  furnish(&f->s);
  assert_int_equal(draw(&f->s, f->combined, &f->deep), FUM_OK);
  *state = f;
  return 0;
}

static int tear_down(void **state) {
  fixture *f = *state;
  unlink(f->path);
  assert_int_equal(rmdir(f->folder), 0); /* nothing else was left behind */
  fum_deep_destroy(f->deep);
  stage_close(&f->s);
  free(f);
  return 0;
}

static int file_count(const char *folder) {
  int count = 0;
  DIR *directory = opendir(folder);
  assert_non_null(directory);
  for (struct dirent *entry; (entry = readdir(directory)) != NULL;)
    count += strcmp(entry->d_name, ".") != 0 && strcmp(entry->d_name, "..") != 0;
  closedir(directory);
  return count;
}

/* One row of a file by OpenEXRCore: numbers of samples, and those of each channel one after the other. */
static void check_row(exr_context_t file, int32_t y, const uint32_t *counts, const fum_deep_sample *samples) {
  static const struct {
    const char *name;
    size_t offset;
  } channels[] = {{"A", 12}, {"B", 8}, {"G", 4}, {"R", 0}, {"Z", 16}, {"ZBack", 20}};
  exr_chunk_info_t chunk;
  exr_decode_pipeline_t decoder = EXR_DECODE_PIPELINE_INITIALIZER;
  assert_int_equal(exr_read_scanline_chunk_info(file, 0, y, &chunk), EXR_ERR_SUCCESS);
  assert_int_equal(exr_decoding_initialize(file, 0, &chunk, &decoder), EXR_ERR_SUCCESS);
  assert_int_equal(decoder.channel_count, 6);
  int64_t total = 0;
  for (int32_t x = 0; x < WIDTH; x++)
    total += counts[x];
  float *values = calloc((size_t)(6 * total + 1), sizeof *values);

  for (int c = 0; c < 6; c++) {
    assert_string_equal(decoder.channels[c].channel_name, channels[c].name);
    assert_int_equal(decoder.channels[c].data_type, EXR_PIXEL_FLOAT);
    decoder.channels[c].decode_to_ptr = (uint8_t *)(values + c * total);
    decoder.channels[c].user_bytes_per_element = 4;
    decoder.channels[c].user_data_type = EXR_PIXEL_FLOAT;
    decoder.channels[c].user_pixel_stride = 4;
    decoder.channels[c].user_line_stride = 4;
  }
  assert_int_equal(exr_decoding_choose_default_routines(file, 0, &decoder), EXR_ERR_SUCCESS);
  assert_int_equal(exr_decoding_run(file, 0, &decoder), EXR_ERR_SUCCESS);
  uint32_t sum = 0;
  for (int32_t x = 0; x < WIDTH; x++) {
    sum += counts[x];
    assert_int_equal(decoder.sample_count_table[x], sum);
  }
  for (int c = 0; c < 6; c++) {
    for (int64_t i = 0; i < total; i++)
      assert_memory_equal(values + c * total + i, (const char *)(samples + i) + channels[c].offset, sizeof(float));
  }
  exr_decoding_destroy(file, &decoder);
  free(values);
}

static void file_is_read_back_by_openexr_core(void **state) {
  fixture *f = *state;
  const uint32_t *counts;
  const fum_deep_sample *samples;
  const int64_t count = fum_deep_samples(f->deep, &counts, &samples);
  exr_context_t file = NULL;
  exr_context_initializer_t settings = EXR_DEFAULT_CONTEXT_INITIALIZER;
  exr_storage_t storage;
  int32_t most = 0, version = 0;
  assert_true(count > 1000);
  assert_int_equal(fum_deep_write(f->deep, f->path, NULL), FUM_OK);
  assert_int_equal(exr_start_read(&file, f->path, &settings), EXR_ERR_SUCCESS);
  assert_int_equal(exr_get_storage(file, 0, &storage), EXR_ERR_SUCCESS);
  assert_int_equal(storage, EXR_STORAGE_DEEP_SCANLINE);
  assert_int_equal(exr_get_version(file, 0, &version), EXR_ERR_SUCCESS);
  assert_int_equal(version, 1);
  assert_int_equal(exr_attr_get_int(file, 0, "maxSamplesPerPixel", &most), EXR_ERR_SUCCESS);
  int64_t first = 0;
  uint32_t true_most = 0;
  for (int32_t y = 0; y < HEIGHT; y++) {
    check_row(file, HEIGHT - 1 - y, counts + y * WIDTH, samples + first);
    for (int32_t x = 0; x < WIDTH; x++) {
      true_most = counts[y * WIDTH + x] > true_most ? counts[y * WIDTH + x] : true_most;
      first += counts[y * WIDTH + x];
    }
  }
  assert_int_equal(first, count);
  assert_int_equal(most, true_most);
  exr_finish(&file);
}

/* OpenEXR's own compositing of deep files, which its half floats round by 2^-11. Pixels with the solid's edge too. */
static void file_flattens_to_combined(void **state) {
  fixture *f = *state;
  static ImfRgba pixels[WIDTH * HEIGHT];
  assert_int_equal(fum_deep_write(f->deep, f->path, NULL), FUM_OK);
  ImfInputFile *file = ImfOpenInputFile(f->path);
  assert_non_null(file);
  assert_int_equal(ImfInputSetFrameBuffer(file, pixels, 1, WIDTH), 1);
  assert_int_equal(ImfInputReadPixels(file, 0, HEIGHT - 1), 1);
  assert_int_equal(ImfCloseInputFile(file), 1);
  float brightest = 0.0F;
  for (int i = 0; i < WIDTH * HEIGHT; i++) {
    const ImfRgba *p = &pixels[(HEIGHT - 1 - i / WIDTH) * WIDTH + i % WIDTH];
    const ImfHalf halves[4] = {p->r, p->g, p->b, p->a};
    for (int c = 0; c < 4; c++) {
      const float value = ImfHalfToFloat(halves[c]), truth = f->combined[4 * i + c];
      if (fabsf(value - truth) > 1e-3F * fmaxf(truth, 0.01F)) {
        fail_msg("pixel %d %d: %g is not %g", i % WIDTH, i / WIDTH, (double)value, (double)truth);
      }
      brightest = fmaxf(brightest, truth);
    }
  }
  assert_true(brightest > 0.5F);
}

static void part_of_a_frame_has_its_place(void **state) {
  fixture *f = *state;
  exr_context_t file = NULL;
  exr_context_initializer_t settings = EXR_DEFAULT_CONTEXT_INITIALIZER;
  exr_attr_box2i_t data, display;
  const uint32_t *counts;
  const fum_deep_sample *samples;
  (void)fum_deep_samples(f->deep, &counts, &samples);
  const fum_frame_part part = {.frame_width = 200, .frame_height = 100, .left = 30, .bottom = 20};
  assert_int_equal(fum_deep_write(f->deep, f->path, &part), FUM_OK);
  assert_int_equal(exr_start_read(&file, f->path, &settings), EXR_ERR_SUCCESS);
  assert_int_equal(exr_get_data_window(file, 0, &data), EXR_ERR_SUCCESS);
  assert_int_equal(exr_get_display_window(file, 0, &display), EXR_ERR_SUCCESS);
  assert_int_equal(data.min.x, 30);
  assert_int_equal(data.max.x, 30 + WIDTH - 1);
  assert_int_equal(data.min.y, 100 - 20 - HEIGHT);
  assert_int_equal(data.max.y, 79);
  assert_int_equal(display.min.x, 0);
  assert_int_equal(display.max.x, 199);
  assert_int_equal(display.max.y, 99);
  check_row(file, 79, counts, samples);
  exr_finish(&file);
  const fum_frame_part outside = {.frame_width = 200, .frame_height = 100, .left = 151, .bottom = 20};
  assert_int_equal(fum_deep_write(f->deep, f->path, &outside), FUM_ERROR_ARGUMENT);
  assert_non_null(strstr(fum_last_error(f->s.context), "151"));
}

static void what_fails_leaves_the_file_that_was_there(void **state) {
  fixture *f = *state;
  char missing[160];
  snprintf(missing, sizeof missing, "%s/missing/deep.exr", f->folder);
  assert_int_equal(fum_deep_write(f->deep, missing, NULL), FUM_ERROR_FILE);
  assert_non_null(strstr(fum_last_error(f->s.context), missing));
  assert_non_null(strstr(fum_last_error(f->s.context), "No such file"));
  assert_int_equal(fum_deep_write(f->deep, "", NULL), FUM_ERROR_ARGUMENT);
  assert_int_equal(fum_deep_write(NULL, f->path, NULL), FUM_ERROR_ARGUMENT);
  assert_int_equal(fum_deep_write(f->deep, f->path, NULL), FUM_OK);
  struct stat whole, kept;
  assert_int_equal(stat(f->path, &whole), 0);
  /* A limit on the size of files stands for a full disk. */
  struct rlimit before;
  assert_int_equal(getrlimit(RLIMIT_FSIZE, &before), 0);
  signal(SIGXFSZ, SIG_IGN);
  setrlimit(RLIMIT_FSIZE, &(struct rlimit){(rlim_t)(whole.st_size / 2), before.rlim_max});
  const int32_t status = fum_deep_write(f->deep, f->path, NULL);
  setrlimit(RLIMIT_FSIZE, &before);
  signal(SIGXFSZ, SIG_DFL);
  assert_int_equal(status, FUM_ERROR_FILE);
  assert_non_null(strstr(fum_last_error(f->s.context), f->path));
  assert_int_equal(stat(f->path, &kept), 0);
  assert_int_equal(kept.st_size, whole.st_size);
  assert_int_equal(kept.st_ino, whole.st_ino);
  assert_int_equal(file_count(f->folder), 1);
}

static void threads_change_no_bit(void **state) {
  fixture *f = *state;
  const uint32_t *counts;
  const fum_deep_sample *samples;
  const int64_t count = fum_deep_samples(f->deep, &counts, &samples);
  for (int threads = 1; threads <= 3; threads++) {
    static float combined[4 * WIDTH * HEIGHT];
    const uint32_t *other_counts;
    const fum_deep_sample *other;
    stage s = stage_open();
    fum_deep *deep = NULL;
    assert_int_equal(fum_context_set_threads(s.context, threads), FUM_OK);
    furnish(&s);
    assert_int_equal(draw(&s, combined, &deep), FUM_OK);
    assert_int_equal(fum_deep_samples(deep, &other_counts, &other), count);
    assert_memory_equal(other_counts, counts, WIDTH * HEIGHT * sizeof *counts);
    assert_memory_equal(other, samples, (size_t)count * sizeof *samples);
    fum_deep_destroy(deep);
    stage_close(&s);
  }
}

/* No smoke, no samples; the file is there. */
static void empty_scenes_have_no_samples(void **state) {
  fixture *f = *state;
  static float combined[4 * WIDTH * HEIGHT];
  const uint32_t *counts;
  const fum_deep_sample *samples;
  stage s = stage_open();
  fum_deep *deep = NULL;
  assert_int_equal(draw(&s, combined, &deep), FUM_OK);
  assert_int_equal(fum_deep_samples(deep, &counts, &samples), 0);
  assert_int_equal(fum_deep_write(deep, f->path, NULL), FUM_OK);
  static ImfRgba pixels[WIDTH * HEIGHT];
  ImfInputFile *file = ImfOpenInputFile(f->path);
  assert_non_null(file);
  assert_int_equal(ImfInputSetFrameBuffer(file, pixels, 1, WIDTH), 1);
  assert_int_equal(ImfInputReadPixels(file, 0, HEIGHT - 1), 1);
  assert_int_equal(ImfCloseInputFile(file), 1);
  for (int i = 0; i < WIDTH * HEIGHT; i++)
    assert_int_equal(pixels[i].a, 0);
  fum_deep_destroy(deep);
  stage_close(&s);
}

int main(void) {
#define FILE_TEST(name) cmocka_unit_test_setup_teardown(name, set_up, tear_down)
  const struct CMUnitTest tests[] = {
      cmocka_unit_test(bent_curves_follow_gaussians),
      cmocka_unit_test(samples_keep_their_limits),
      cmocka_unit_test(gaps_are_not_bridged),
      cmocka_unit_test(what_glows_alone_is_kept),
      cmocka_unit_test(mixtures_are_means_of_pictures),
      cmocka_unit_test(unfolded_samples_are_the_curve),
      FILE_TEST(file_is_read_back_by_openexr_core),
      FILE_TEST(file_flattens_to_combined),
      FILE_TEST(part_of_a_frame_has_its_place),
      FILE_TEST(what_fails_leaves_the_file_that_was_there),
      FILE_TEST(threads_change_no_bit),
      FILE_TEST(empty_scenes_have_no_samples),
  };
  return cmocka_run_group_tests(tests, NULL, NULL);
}
