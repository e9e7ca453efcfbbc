/* SPDX-License-Identifier: GPL-3.0-or-later */
/* What OpenGL draws against the closed form of one Gaussian particle, computed here in double precision. */
#include "billboard/gl.h"

#include <math.h>
#include <setjmp.h>
#include <stdarg.h>
#include <stddef.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>

#include <cmocka.h>

static fum_context *context; /* one for all tests but a few: opening the device takes longer than drawing */

static int open_context(void **state) {
  (void)state;
  return fum_context_create(&context) == FUM_OK ? 0 : -1;
}

static int close_context(void **state) {
  (void)state;
  fum_context_destroy(context);
  return 0;
}

static fum_frame make_frame(int32_t width, int32_t height) {
  const float aspect = (float)height / (float)width;
  return (fum_frame){.type = FUM_CAMERA_PERSPECTIVE,
                     .width = width,
                     .height = height,
                     .window = {-0.5f, 0.5f, -0.5f * aspect, 0.5f * aspect},
                     .clip_start = 0.1f,
                     .clip_end = 100.0f,
                     .footprint_sigmas = 5.0f};
}

/* Pixels so small that no particle of a test is smaller. */
static fum_frame make_narrow_frame(int32_t width, int32_t height) {
  fum_frame frame = make_frame(width, height);
  for (int i = 0; i < 4; i++)
    frame.window[i] *= 0.01f;
  return frame;
}

static void assert_close(double value, double expected, double tolerance) {
  if (!(fabs(value - expected) <= tolerance)) fail_msg("%.9g instead of %.9g", value, expected);
}

static fum_billboard make_billboard(float x, float y, float z, float sigma, float optical_depth) {
  return (fum_billboard){.center = {x, y, z}, .sigma = sigma, .optical_depth = optical_depth, .source = {1, 2, 0.5f}};
}

static float *draw_tiled(const fum_frame *frame, int64_t count, const fum_billboard *billboards, int32_t tile_limit) {
  char device[128] = "untouched";
  float *pixels = malloc((size_t)frame->width * (size_t)frame->height * 4 * sizeof *pixels);
  assert_non_null(pixels);
  const int32_t status = fum_gl_draw_tiled(context, frame, count, billboards, tile_limit, pixels, device);
  if (status != FUM_OK) fail_msg("%s", fum_last_error(context));
  assert_true((device[0] != '\0') == (count > 0));
  assert_string_not_equal(device, "untouched");
  return pixels;
}

static float *draw(const fum_frame *frame, int64_t count, const fum_billboard *billboards) {
  return draw_tiled(frame, count, billboards, INT32_MAX);
}

static float alpha_at(const fum_frame *frame, const float *pixels, int32_t x, int32_t y) {
  return pixels[4 * ((size_t)y * (size_t)frame->width + (size_t)x) + 3];
}

/* ---- The closed form --------------------------------------------------------------------------------------------- */

static double phi(double x) {
  return 0.5 * erfc(-x / sqrt(2.0));
}

static double exact_alpha(const fum_frame *frame, const fum_billboard *b, int32_t x, int32_t y) {
  const double left = frame->window[0], right = frame->window[1], bottom = frame->window[2], top = frame->window[3];
  const double wx = left + (right - left) * (x + 0.5) / frame->width;
  const double wy = bottom + (top - bottom) * (y + 0.5) / frame->height;
  const bool perspective = frame->type == FUM_CAMERA_PERSPECTIVE;
  const double origin[3] = {perspective ? 0 : wx, perspective ? 0 : wy, 0};
  const double length = perspective ? sqrt(wx * wx + wy * wy + 1) : 1;
  const double ray[3] = {perspective ? wx / length : 0, perspective ? wy / length : 0, -1 / length};
  double nearest = 0, distance2 = 0, end = frame->clip_end;
  for (int i = 0; i < 3; i++)
    nearest += ((double)b->center[i] - origin[i]) * ray[i];
  for (int i = 0; i < 3; i++)
    distance2 += pow((double)b->center[i] - origin[i] - nearest * ray[i], 2);
  if (frame->solid_depths != NULL) end = fmin(end, (double)frame->solid_depths[(int64_t)y * frame->width + x]);
  const double sigma = b->sigma, t0 = frame->clip_start * length - nearest, t1 = end * length - nearest;
  const double share = t1 > t0 ? phi(t1 / sigma) - phi(t0 / sigma) : 0;
  return -expm1(-b->optical_depth * exp(-distance2 / (2 * sigma * sigma)) * share);
}

/* Every pixel agrees with the closed form: within 1e-5 of the largest alpha plus what the footprint cuts off. */
static void assert_exact(const fum_frame *frame, const fum_billboard *billboard) {
  float *pixels = draw(frame, 1, billboard);
  const double cut = billboard->optical_depth * exp(-0.5 * pow(frame->footprint_sigmas, 2));
  for (int32_t y = 0; y < frame->height; y++) {
    for (int32_t x = 0; x < frame->width; x++) {
      const float *pixel = &pixels[4 * ((size_t)y * (size_t)frame->width + (size_t)x)];
      const double expected = exact_alpha(frame, billboard, x, y);
      const double tolerance = 1e-5 * fmin(1.0, billboard->optical_depth) + (pixel[3] == 0.0f ? cut : 0.0);
      if (!(fabs(pixel[3] - expected) <= tolerance)) {
        fail_msg("pixel %d, %d: alpha %.8g, expected %.8g", x, y, pixel[3], expected);
      }
      for (int i = 0; i < 3; i++)
        assert_close(pixel[i], billboard->source[i] * pixel[3], 1e-6);
    }
  }
  free(pixels);
}

/* Pixels that the closed form says are visible were drawn, and there are some. */
static void assert_visible(const fum_frame *frame, const fum_billboard *billboard, bool visible) {
  float *pixels = draw(frame, 1, billboard);
  double sum = 0.0;
  for (int64_t i = 0; i < (int64_t)frame->width * frame->height; i++)
    sum += (double)pixels[4 * i + 3];
  assert_true((sum > 0.0) == visible);
  free(pixels);
}

/* ---- One particle ------------------------------------------------------------------------------------------------ */

static void particle_in_the_middle(void **state) {
  (void)state;
  const fum_frame frame = make_frame(33, 33);
  const float depths[] = {1e-6f, 1e-3f, 0.05f, 0.099f, 0.101f, 1.0f, 5.0f, 80.0f};
  for (size_t i = 0; i < sizeof depths / sizeof *depths; i++) {
    const fum_billboard billboard = make_billboard(0, 0, -4, 0.2f, depths[i]);
    assert_exact(&frame, &billboard);
  }
}

static void particle_off_the_axis_of_a_wide_angle(void **state) {
  (void)state;
  fum_frame frame = make_frame(160, 90);
  const float window[4] = {-3, 3, -1.7f, 1.7f};
  memcpy(frame.window, window, sizeof window);
  const float places[][3] = {{2.4f, 1.2f, -1}, {-2.9f, 0, -1}, {0, -1.6f, -1}, {7, 4, -2.5f}, {3.2f, 0, -1}};
  for (size_t i = 0; i < sizeof places / sizeof *places; i++) {
    const fum_billboard billboard = make_billboard(places[i][0], places[i][1], places[i][2], 0.15f, 1.5f);
    assert_exact(&frame, &billboard);
    assert_visible(&frame, &billboard, true);
  }
}

/* The window is shifted and its pixels are not square. */
static void pixel_aspect_and_shift(void **state) {
  (void)state;
  fum_frame frame = make_frame(64, 64);
  const float window[4] = {-0.1f, 0.7f, -0.6f, -0.2f};
  memcpy(frame.window, window, sizeof window);
  const fum_billboard billboard = make_billboard(1.5f, -2.0f, -5, 0.3f, 2);
  assert_exact(&frame, &billboard);
  assert_visible(&frame, &billboard, true);
}

/* The rectangle must hold the whole footprint: with a wide footprint nothing is cut above rounding. */
static void footprint_is_bounded_and_not_cut(void **state) {
  (void)state;
  fum_frame frame = make_frame(200, 200);
  const float window[4] = {-2, 2, -2, 2};
  memcpy(frame.window, window, sizeof window);
  for (int i = 0; i < 8; i++) {
    const float angle = 0.7f * (float)i;
    const fum_billboard billboard = make_billboard(1.3f * cosf(angle), 1.3f * sinf(angle), -1, 0.08f, 3);
    frame.footprint_sigmas = 3;
    float *cut = draw(&frame, 1, &billboard);
    for (int32_t y = 0; y < 200; y++) {
      for (int32_t x = 0; x < 200; x++) {
        if (alpha_at(&frame, cut, x, y) == 0.0f) {
          assert_true(exact_alpha(&frame, &billboard, x, y) < 1.001 * -expm1(-3 * exp(-4.5)));
        }
      }
    }
    free(cut);
  }
}

static void camera_inside_a_particle(void **state) {
  (void)state;
  fum_frame frame = make_frame(48, 27);
  frame.clip_start = 0.0f;
  const float places[][3] = {{0, 0, 0}, {0.2f, -0.1f, -0.3f}, {0, 0.3f, 0.4f}, {1.2f, 0, 0.1f}};
  for (size_t i = 0; i < sizeof places / sizeof *places; i++) {
    const fum_billboard billboard = make_billboard(places[i][0], places[i][1], places[i][2], 0.5f, 2);
    assert_exact(&frame, &billboard);
    assert_visible(&frame, &billboard, true);
  }
}

static void particle_across_the_near_plane(void **state) {
  (void)state;
  fum_frame frame = make_frame(48, 48);
  frame.clip_start = 2.0f;
  for (int i = 0; i < 9; i++) {
    const fum_billboard billboard = make_billboard(0.2f, 0.1f, -1.0f - 0.25f * (float)i, 0.25f, 2);
    assert_exact(&frame, &billboard);
  }
}

/* Footprints that cross the plane of the camera without holding it, seen at the edge of a very wide picture. */
static void particle_beside_the_camera(void **state) {
  (void)state;
  fum_frame frame = make_frame(101, 101);
  const float window[4] = {-20, 20, -20, 20};
  memcpy(frame.window, window, sizeof window);
  frame.clip_start = 0.001f;
  const float places[][3] = {{1, 0, -0.05f}, {-1, 0.3f, 0.1f}, {0.1f, -1, -0.1f}, {0.8f, 0.8f, 0}};
  for (size_t i = 0; i < sizeof places / sizeof *places; i++) {
    const fum_billboard billboard = make_billboard(places[i][0], places[i][1], places[i][2], 0.15f, 2);
    assert_exact(&frame, &billboard);
    assert_visible(&frame, &billboard, true);
  }
}

static void particle_behind_the_camera_or_out_of_the_picture(void **state) {
  (void)state;
  const fum_frame frame = make_narrow_frame(32, 32);
  const float places[][3] = {{0, 0, 2}, {0, 0, 0.95f}, {0, 0, -102}, {4, 0, -2}, {-4, 0, -2}, {0, 4, -2}, {3, 0, 0.5f}};
  for (size_t i = 0; i < sizeof places / sizeof *places; i++) {
    const fum_billboard billboard = make_billboard(places[i][0], places[i][1], places[i][2], 0.2f, 5);
    assert_visible(&frame, &billboard, false);
  }
}

static void orthographic_particle(void **state) {
  (void)state;
  fum_frame frame = make_frame(60, 40);
  const float window[4] = {-3, 3, -1, 3};
  memcpy(frame.window, window, sizeof window);
  frame.type = FUM_CAMERA_ORTHOGRAPHIC;
  frame.clip_start = 0.0f;
  const float places[][3] = {{0, 0, -4}, {2.5f, 2.5f, -50}, {-3.2f, 0.3f, -1}, {0.5f, 0.5f, 0.1f}, {0, 1, -100.1f}};
  for (size_t i = 0; i < sizeof places / sizeof *places; i++) {
    const fum_billboard billboard = make_billboard(places[i][0], places[i][1], places[i][2], 0.4f, 1.2f);
    assert_exact(&frame, &billboard);
    assert_visible(&frame, &billboard, true);
  }
}

/* ---- Solids ------------------------------------------------------------------------------------------------------ */

static void solid_cuts_smoothly(void **state) {
  (void)state;
  enum { WIDTH = 61, HEIGHT = 5 };
  fum_frame frame = make_frame(WIDTH, HEIGHT);
  float depths[WIDTH * HEIGHT];
  for (int i = 0; i < WIDTH * HEIGHT; i++)
    depths[i] = 3.0f + 2.0f * (float)(i % WIDTH) / (WIDTH - 1);
  frame.solid_depths = depths;
  const fum_billboard billboard = make_billboard(0, 0, -4, 0.3f, 1.0f);
  assert_exact(&frame, &billboard);
  frame = make_frame(WIDTH, HEIGHT);
  for (int i = 0; i < WIDTH * HEIGHT; i++)
    depths[i] = 4.0f;
  frame.solid_depths = depths;
  float *pixels = draw(&frame, 1, &billboard);
  assert_close(alpha_at(&frame, pixels, WIDTH / 2, HEIGHT / 2), -expm1(-0.5), 1e-6);
  free(pixels);
}

static void solid_in_front_hides(void **state) {
  (void)state;
  fum_frame frame = make_frame(8, 8);
  float depths[64];
  for (int i = 0; i < 64; i++)
    depths[i] = i % 2 ? 0.05f : 100.0f; /* nearer than the near plane, or none */
  frame.solid_depths = depths;
  const fum_billboard billboard = make_billboard(0, 0, -4, 1.0f, 1.0f);
  assert_exact(&frame, &billboard);
  float *pixels = draw(&frame, 1, &billboard);
  for (int i = 0; i < 64; i++)
    assert_true((pixels[4 * i + 3] == 0.0f) == (i % 2 == 1));
  free(pixels);
}

/* ---- Particles smaller than pixels ------------------------------------------------------------------------------- */

/* Integral of 1 - exp(-tau exp(-r^2 / (2 sigma^2))) over the plane, over 2 pi sigma^2, by the midpoint rule. */
static double exact_coverage(double tau) {
  const int steps = 200000;
  const double most = 0.5 * 12 * 12;
  double sum = 0.0;
  for (int i = 0; i < steps; i++)
    sum += -expm1(-tau * exp(-most * (i + 0.5) / steps));
  return sum * most / steps;
}

static double alpha_sum(const fum_frame *frame, const fum_billboard *billboard) {
  float *pixels = draw(frame, 1, billboard);
  double sum = 0.0;
  for (int64_t i = 0; i < (int64_t)frame->width * frame->height; i++)
    sum += (double)pixels[4 * i + 3];
  free(pixels);
  return sum;
}

/* The covered area is that of the particle, wherever it lies in the pixel and however thick it is. Opaque particles
 * have steeper edges, which the pixels' centres sample less well. */
static void small_particle_keeps_its_area(void **state) {
  (void)state;
  fum_frame frame = make_narrow_frame(16, 16);
  const double pixel = 0.01 / 16 * 10; /* at depth 10 */
  const double sigmas_px[] = {1e-3, 0.05, 0.3, 0.55, 0.599, 0.65};
  const double depths[] = {1e-3, 0.2, 1, 3, 20, 400};
  for (size_t s = 0; s < sizeof sigmas_px / sizeof *sigmas_px; s++) {
    for (size_t d = 0; d < sizeof depths / sizeof *depths; d++) {
      const double area = 2 * acos(-1.0) * pow(sigmas_px[s], 2) * exact_coverage(depths[d]);
      for (int i = 0; i < 16; i++) {
        const double x = (0.25 * (i % 4) + 0.1) * pixel, y = (0.25 * (i / 4) + 0.1) * pixel;
        const fum_billboard billboard =
            make_billboard((float)x, (float)y, -10, (float)(sigmas_px[s] * pixel), (float)depths[d]);
        const double error = alpha_sum(&frame, &billboard) / area - 1.0;
        if (!(fabs(error) < (depths[d] <= 0.2 ? 0.005 : 0.03)))
          fail_msg("sigma %g px, depth %g: %g", sigmas_px[s], depths[d], error);
      }
    }
  }
}

/* A row of far, thin particles moving by less than a pixel doesn't flicker. */
static void small_particle_orthographic(void **state) {
  (void)state;
  fum_frame frame = make_frame(16, 16);
  frame.type = FUM_CAMERA_ORTHOGRAPHIC;
  for (int i = 0; i < 8; i++) {
    const fum_billboard billboard = make_billboard((float)i / 8 / 16, 0.01f, -10, 1e-4f, 2.0f);
    const double area = 2 * acos(-1.0) * pow(1e-4 * 16, 2) * exact_coverage(2.0);
    assert_close(alpha_sum(&frame, &billboard) / area, 1.0, 0.005);
  }
}

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

/* More than a vertex buffer holds: those at the seams count, the others are behind the camera. */
static void many_particles_fill_several_buffers(void **state) {
  (void)state;
  enum { COUNT = 600000 };
  const int seen[] = {0, 1, 262143, 262144, 262145, 524287, 524288, COUNT - 1};
  const int seen_count = sizeof seen / sizeof *seen;
  const fum_frame frame = make_narrow_frame(1, 1);
  fum_billboard *billboards = malloc(COUNT * sizeof *billboards);
  assert_non_null(billboards);
  for (int i = 0; i < COUNT; i++)
    billboards[i] = make_billboard(0, 0, 10, 1.0f, 1.0f);
  double expected = 0.0;
  for (int i = 0; i < seen_count; i++) {
    billboards[seen[i]] = make_billboard(0, 0, -10, 1.0f, 0.5f);
    billboards[seen[i]].source[0] = (float)i;
    expected = i * -expm1(-0.5) + expected * exp(-0.5);
  }
  float *pixels = draw(&frame, COUNT, billboards);
  assert_close(pixels[0], expected, 1e-5);
  assert_close(pixels[3], -expm1(-0.5 * seen_count), 1e-6);
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
  const struct CMUnitTest tests[] = {cmocka_unit_test(particle_in_the_middle),
                                     cmocka_unit_test(particle_off_the_axis_of_a_wide_angle),
                                     cmocka_unit_test(pixel_aspect_and_shift),
                                     cmocka_unit_test(footprint_is_bounded_and_not_cut),
                                     cmocka_unit_test(camera_inside_a_particle),
                                     cmocka_unit_test(particle_across_the_near_plane),
                                     cmocka_unit_test(particle_beside_the_camera),
                                     cmocka_unit_test(particle_behind_the_camera_or_out_of_the_picture),
                                     cmocka_unit_test(orthographic_particle),
                                     cmocka_unit_test(solid_cuts_smoothly),
                                     cmocka_unit_test(solid_in_front_hides),
                                     cmocka_unit_test(small_particle_keeps_its_area),
                                     cmocka_unit_test(small_particle_orthographic),
                                     cmocka_unit_test(later_particles_lie_over_earlier_ones),
                                     cmocka_unit_test(faint_particles_add_up),
                                     cmocka_unit_test(many_particles_fill_several_buffers),
                                     cmocka_unit_test(nothing_to_draw_needs_no_device),
                                     cmocka_unit_test(odd_frames),
                                     cmocka_unit_test(tiles_make_no_difference),
                                     cmocka_unit_test(same_input_gives_the_same_bits),
                                     cmocka_unit_test(cancel_stops_the_drawing),
                                     cmocka_unit_test(cancel_while_the_device_opens),
                                     cmocka_unit_test(progress_reaches_the_end),
                                     cmocka_unit_test(destroy_without_a_draw)};
  return cmocka_run_group_tests(tests, open_context, close_context);
}
