/* SPDX-License-Identifier: GPL-3.0-or-later */
/* One particle drawn by OpenGL against its closed form. */
#include "gl_fixture.h"

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

/* The rectangle must hold the whole footprint, and that of a dense particle as much as that of a thin one. */
static void footprint_is_bounded_and_not_cut(void **state) {
  (void)state;
  fum_frame frame = make_frame(200, 200);
  const float window[4] = {-2, 2, -2, 2}, depths[] = {1, 3, 20, 1e4f};
  memcpy(frame.window, window, sizeof window);
  for (int i = 0; i < 8; i++) {
    const float angle = 0.7f * (float)i;
    const fum_billboard billboard = make_billboard(1.3f * cosf(angle), 1.3f * sinf(angle), -1, 0.08f, depths[i % 4]);
    frame.footprint_sigmas = 3;
    float *cut = draw(&frame, 1, &billboard);
    for (int32_t y = 0; y < 200; y++) {
      for (int32_t x = 0; x < 200; x++) {
        if (alpha_at(&frame, cut, x, y) == 0.0f) {
          assert_true(exact_alpha(&frame, &billboard, x, y) < 1.001 * -expm1(-exp(-4.5)));
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
    const fum_billboard billboard = make_billboard(places[i][0], places[i][1], places[i][2], 0.2f, 1);
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
        if (!(fabs(error) < (depths[d] <= 0.2 ? 0.005 : 0.05)))
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

int main(void) {
  const struct CMUnitTest tests[] = {
      cmocka_unit_test(particle_in_the_middle),     cmocka_unit_test(particle_off_the_axis_of_a_wide_angle),
      cmocka_unit_test(pixel_aspect_and_shift),     cmocka_unit_test(footprint_is_bounded_and_not_cut),
      cmocka_unit_test(camera_inside_a_particle),   cmocka_unit_test(particle_across_the_near_plane),
      cmocka_unit_test(particle_beside_the_camera), cmocka_unit_test(particle_behind_the_camera_or_out_of_the_picture),
      cmocka_unit_test(orthographic_particle),      cmocka_unit_test(solid_cuts_smoothly),
      cmocka_unit_test(solid_in_front_hides),       cmocka_unit_test(small_particle_keeps_its_area),
      cmocka_unit_test(small_particle_orthographic)};
  return cmocka_run_group_tests(tests, open_context, close_context);
}
