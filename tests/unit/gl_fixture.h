/* SPDX-License-Identifier: GPL-3.0-or-later */
/* What the tests of drawing share: frames, billboards, and the closed form of one Gaussian particle in double
 * precision. */
#ifndef FUM_TESTS_GL_FIXTURE_H
#define FUM_TESTS_GL_FIXTURE_H

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

static inline int open_context(void **state) {
  (void)state;
  return fum_context_create(&context) == FUM_OK ? 0 : -1;
}

static inline int close_context(void **state) {
  (void)state;
  fum_context_destroy(context);
  return 0;
}

static inline fum_frame make_frame(int32_t width, int32_t height) {
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
static inline fum_frame make_narrow_frame(int32_t width, int32_t height) {
  fum_frame frame = make_frame(width, height);
  for (int i = 0; i < 4; i++)
    frame.window[i] *= 0.01f;
  return frame;
}

static inline void assert_close(double value, double expected, double tolerance) {
  if (!(fabs(value - expected) <= tolerance)) fail_msg("%.9g instead of %.9g", value, expected);
}

static inline fum_billboard make_billboard(float x, float y, float z, float sigma, float optical_depth) {
  return (fum_billboard){.center = {x, y, z}, .sigma = sigma, .optical_depth = optical_depth, .source = {1, 2, 0.5f}};
}

static inline float *draw_tiled(const fum_frame *frame, int64_t count, const fum_billboard *billboards,
                                int32_t tile_limit) {
  char device[128] = "untouched";
  float *pixels = malloc((size_t)frame->width * (size_t)frame->height * 4 * sizeof *pixels);
  assert_non_null(pixels);
  const int32_t status = fum_gl_draw_tiled(context, frame, count, billboards, tile_limit, pixels, device);
  if (status != FUM_OK) fail_msg("%s", fum_last_error(context));
  assert_true((device[0] != '\0') == (count > 0));
  assert_string_not_equal(device, "untouched");
  return pixels;
}

static inline float *draw(const fum_frame *frame, int64_t count, const fum_billboard *billboards) {
  return draw_tiled(frame, count, billboards, INT32_MAX);
}

static inline float alpha_at(const fum_frame *frame, const float *pixels, int32_t x, int32_t y) {
  return pixels[4 * ((size_t)y * (size_t)frame->width + (size_t)x) + 3];
}

/* ---- The closed form --------------------------------------------------------------------------------------------- */

static inline double phi(double x) {
  return 0.5 * erfc(-x / sqrt(2.0));
}

static inline double exact_alpha(const fum_frame *frame, const fum_billboard *b, int32_t x, int32_t y) {
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
static inline void assert_exact(const fum_frame *frame, const fum_billboard *billboard) {
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
static inline void assert_visible(const fum_frame *frame, const fum_billboard *billboard, bool visible) {
  float *pixels = draw(frame, 1, billboard);
  double sum = 0.0;
  for (int64_t i = 0; i < (int64_t)frame->width * frame->height; i++)
    sum += (double)pixels[4 * i + 3];
  assert_true((sum > 0.0) == visible);
  free(pixels);
}

#endif
