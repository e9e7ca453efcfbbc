/* SPDX-License-Identifier: GPL-3.0-or-later */
/* Pictures of many particles, frames of all sizes, cancelling, and the life of the drawing thread. */
#include "gl_fixture.h"

/* ---- Many particles ---------------------------------------------------------------------------------------------- */

static void later_particles_lie_over_earlier_ones(void **state) {
  (void)state;
  const fum_frame frame = make_narrow_frame(1, 1);
  fum_billboard billboards[2] = {make_billboard(0, 0, -6, 0.5f, 0.7f), make_billboard(0, 0, -4, 0.5f, 1.3f)};
  billboards[1].source[0] = 5.0f;
  const double back = -expm1(-0.7), front = -expm1(-1.3);
  float *pixels = draw(&frame, 2, billboards);
  assert_close(pixels[0], 5 * front + 1 * back * (1 - front), 1e-5);
  assert_close(pixels[1], 2 * front + 2 * back * (1 - front), 1e-5);
  assert_close(pixels[3], -expm1(-2.0), 1e-6);
  free(pixels);
}

static void faint_particles_add_up(void **state) {
  (void)state;
  enum { COUNT = 2000 };
  const fum_frame frame = make_narrow_frame(3, 3);
  fum_billboard billboards[COUNT];
  for (int i = 0; i < COUNT; i++)
    billboards[i] = make_billboard(0, 0, -10, 1.0f, (float)-log1p(-1e-4));
  float *pixels = draw(&frame, COUNT, billboards);
  assert_close(alpha_at(&frame, pixels, 1, 1), 1.0 - pow(1.0 - 1e-4, COUNT), 2e-6);
  free(pixels);
}

/* More than a vertex buffer holds, in many batches: one particle a pixel, drawn in that pixel alone, so that one left
 * out or drawn twice shows. */
static void every_particle_is_drawn_once(void **state) {
  (void)state;
  enum { WIDTH = 600, HEIGHT = 500 };
  fum_frame frame = make_frame(WIDTH, HEIGHT);
  const float window[4] = {0, WIDTH, 0, HEIGHT};
  memcpy(frame.window, window, sizeof window);
  frame.type = FUM_CAMERA_ORTHOGRAPHIC;
  frame.footprint_sigmas = 0.5f;
  fum_billboard *billboards = malloc(WIDTH * HEIGHT * sizeof *billboards);
  assert_non_null(billboards);
  for (int i = 0; i < WIDTH * HEIGHT; i++) {
    billboards[i] = make_billboard((float)(i % WIDTH) + 0.5f, (float)(i / WIDTH) + 0.5f, -10, 0.7f, 0.5f);
  }
  float *pixels = draw(&frame, WIDTH * HEIGHT, billboards);
  for (int i = 0; i < WIDTH * HEIGHT; i++)
    assert_close(pixels[4 * i + 3], -expm1(-0.5), 1e-6);
  free(pixels);
  free(billboards);
}

static void nothing_to_draw_needs_no_device(void **state) {
  (void)state;
  fum_context *kept = context;
  assert_int_equal(fum_context_create(&context), FUM_OK);
  const fum_frame frame = make_frame(7, 5);
  float *pixels = draw(&frame, 0, NULL);
  for (int i = 0; i < 7 * 5 * 4; i++)
    assert_true(pixels[i] == 0.0f);
  assert_null(context->gl);
  free(pixels);
  fum_context_destroy(context);
  context = kept;
}

/* ---- Frames of all sizes ----------------------------------------------------------------------------------------- */

static void odd_frames(void **state) {
  (void)state;
  const int32_t sizes[][2] = {{1, 1}, {8192, 2}, {2, 8192}, {1, 3}, {65536, 1}};
  for (size_t i = 0; i < sizeof sizes / sizeof *sizes; i++) {
    const fum_frame frame = make_frame(sizes[i][0], sizes[i][1]);
    const fum_billboard billboard = make_billboard(0.1f, 0, -4, 3.0f, 1.0f);
    assert_exact(&frame, &billboard);
    assert_visible(&frame, &billboard, true);
  }
}

/* A new device counts as slow, so a large particle is cut into bands of rows. */
static void large_particle_has_no_seams(void **state) {
  (void)state;
  fum_context *kept = context;
  assert_int_equal(fum_context_create(&context), FUM_OK);
  const fum_frame frame = make_frame(1500, 1000);
  const fum_billboard billboard = make_billboard(0.1f, 0.2f, -4, 1.0f, 1.0f);
  assert_exact(&frame, &billboard);
  fum_context_destroy(context);
  context = kept;
}

static fum_billboard *random_billboards(int count, float sigma_px, const fum_frame *frame) {
  fum_billboard *billboards = malloc((size_t)count * sizeof *billboards);
  assert_non_null(billboards);
  uint32_t random = 1;
  for (int i = 0; i < count; i++) {
    const float depth = 20.0f - 10.0f * (float)i / (float)count;
    float uv[2];
    for (int k = 0; k < 2; k++)
      uv[k] = (float)((random = random * 1664525u + 1013904223u) >> 8) / 16777216.0f;
    billboards[i] =
        make_billboard(depth * (frame->window[0] + (frame->window[1] - frame->window[0]) * uv[0]),
                       depth * (frame->window[2] + (frame->window[3] - frame->window[2]) * uv[1]), -depth,
                       sigma_px * depth * (frame->window[1] - frame->window[0]) / (float)frame->width, 0.05f);
  }
  return billboards;
}

/* Tiles give the picture that one target gives. */
static void tiles_make_no_difference(void **state) {
  (void)state;
  enum { WIDTH = 100, HEIGHT = 70, COUNT = 500 };
  fum_frame frame = make_frame(WIDTH, HEIGHT);
  float depths[WIDTH * HEIGHT];
  for (int i = 0; i < WIDTH * HEIGHT; i++)
    depths[i] = 10.0f + 0.01f * (float)(i % 1000);
  frame.solid_depths = depths;
  fum_billboard *billboards = random_billboards(COUNT, 6.0f, &frame);
  float *whole = draw(&frame, COUNT, billboards);
  const int32_t limits[] = {32, 99, 7};
  for (size_t i = 0; i < sizeof limits / sizeof *limits; i++) {
    float *tiled = draw_tiled(&frame, COUNT, billboards, limits[i]);
    for (int k = 0; k < WIDTH * HEIGHT * 4; k++)
      assert_close(tiled[k], whole[k], 2e-6);
    free(tiled);
  }
  free(whole);
  free(billboards);
}

/* The second picture is drawn in other batches than the first, as the device's speed is known by then. */
static void same_input_gives_the_same_bits(void **state) {
  (void)state;
  enum { WIDTH = 320, HEIGHT = 180, COUNT = 20000 };
  const fum_frame frame = make_frame(WIDTH, HEIGHT);
  fum_billboard *billboards = random_billboards(COUNT, 5.0f, &frame);
  fum_context *kept = context;
  assert_int_equal(fum_context_create(&context), FUM_OK);
  float *first = draw(&frame, COUNT, billboards);
  float *second = draw(&frame, COUNT, billboards);
  assert_memory_equal(first, second, WIDTH * HEIGHT * 4 * sizeof *first);
  fum_context_destroy(context);
  context = kept;
  free(first);
  free(second);
  free(billboards);
}

/* ---- Cancel and life cycle --------------------------------------------------------------------------------------- */

typedef struct progress_log {
  int calls, cancel_at; /* the call that cancels; 0: none */
  float last;
  bool goes_back;
} progress_log;

static int32_t log_progress(void *user, int32_t stage, float fraction, const char *message) {
  progress_log *log = user;
  if (stage != FUM_STAGE_DRAWING || message == NULL || fraction < log->last || fraction > 1.0f) log->goes_back = true;
  log->last = fraction;
  return ++log->calls == log->cancel_at;
}

/* Full-screen particles, so that a batch must be cut into bands; nothing but the cancel ends this within minutes. */
static void cancel_stops_the_drawing(void **state) {
  (void)state;
  enum { SIDE = 2048, COUNT = 20000 };
  const fum_frame frame = make_frame(SIDE, SIDE);
  fum_billboard *billboards = malloc(COUNT * sizeof *billboards);
  float *pixels = calloc((size_t)SIDE * SIDE * 4, sizeof *pixels);
  char device[128] = "untouched";
  assert_non_null(billboards);
  assert_non_null(pixels);
  for (int i = 0; i < COUNT; i++)
    billboards[i] = make_billboard(0, 0, -1, 1.0f, 1e-3f);
  progress_log log = {.cancel_at = 5};
  fum_context_set_progress(context, log_progress, &log);
  fum_progress_begin(context);
  assert_int_equal(fum_gl_draw(context, &frame, COUNT, billboards, pixels, device), FUM_ERROR_CANCELLED);
  fum_context_set_progress(context, NULL, NULL);
  assert_int_equal(log.calls, 5);
  assert_false(log.goes_back);
  assert_string_equal(device, "untouched");
  for (size_t i = 0; i < (size_t)SIDE * SIDE * 4; i++)
    assert_true(pixels[i] == 0.0f);
  fum_progress_begin(context);
  const fum_frame small = make_frame(4, 4);
  assert_exact(&small, billboards); /* the device is fit for the next picture */
  free(pixels);
  free(billboards);
}

/* A cancel while the device opens leaves a context that can be destroyed or drawn with. */
static void cancel_while_the_device_opens(void **state) {
  (void)state;
  const fum_frame frame = make_frame(4, 4);
  const fum_billboard billboard = make_billboard(0, 0, -4, 1.0f, 1.0f);
  for (int draws = 0; draws < 2; draws++) {
    fum_context *kept = context;
    float pixels[64];
    char device[128];
    progress_log log = {.cancel_at = 1};
    assert_int_equal(fum_context_create(&context), FUM_OK);
    fum_context_set_progress(context, log_progress, &log);
    fum_progress_begin(context);
    assert_int_equal(fum_gl_draw(context, &frame, 1, &billboard, pixels, device), FUM_ERROR_CANCELLED);
    fum_context_set_progress(context, NULL, NULL);
    fum_progress_begin(context);
    if (draws) assert_exact(&frame, &billboard);
    fum_context_destroy(context);
    context = kept;
  }
}

static void progress_reaches_the_end(void **state) {
  (void)state;
  const fum_frame frame = make_frame(64, 64);
  fum_billboard *billboards = random_billboards(1000, 5.0f, &frame);
  progress_log log = {0};
  fum_context_set_progress(context, log_progress, &log);
  fum_progress_begin(context);
  free(draw_tiled(&frame, 1000, billboards, 16));
  fum_context_set_progress(context, NULL, NULL);
  assert_true(log.calls >= 1);
  assert_false(log.goes_back);
  free(billboards);
}

static void destroy_without_a_draw(void **state) {
  (void)state;
  fum_context *unused;
  assert_int_equal(fum_context_create(&unused), FUM_OK);
  fum_context_destroy(unused);
  fum_gl_destroy(NULL);
}

int main(void) {
  const struct CMUnitTest tests[] = {cmocka_unit_test(later_particles_lie_over_earlier_ones),
                                     cmocka_unit_test(faint_particles_add_up),
                                     cmocka_unit_test(every_particle_is_drawn_once),
                                     cmocka_unit_test(nothing_to_draw_needs_no_device),
                                     cmocka_unit_test(odd_frames),
                                     cmocka_unit_test(large_particle_has_no_seams),
                                     cmocka_unit_test(tiles_make_no_difference),
                                     cmocka_unit_test(same_input_gives_the_same_bits),
                                     cmocka_unit_test(cancel_stops_the_drawing),
                                     cmocka_unit_test(cancel_while_the_device_opens),
                                     cmocka_unit_test(progress_reaches_the_end),
                                     cmocka_unit_test(destroy_without_a_draw)};
  return cmocka_run_group_tests(tests, open_context, close_context);
}
