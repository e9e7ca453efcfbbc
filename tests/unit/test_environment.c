/* SPDX-License-Identifier: GPL-3.0-or-later */
/* Directions that stand for light from all around: energy is conserved, points stay points, and phase functions keep
 * their integral. */
#include "support.h"

#include "lighting/environment.h"
#include "lighting/phase.h"

enum { WIDTH = 24, HEIGHT = 12 };

static double solid_angle(int row) {
  return 2.0 * FUM_PI / WIDTH *
         (sin(FUM_PI * ((row + 1.0) / HEIGHT - 0.5)) - sin(FUM_PI * ((double)row / HEIGHT - 0.5)));
}

static fum_light_desc picture_of(const float *pixels) {
  fum_light_desc desc;
  fum_light_desc_init(&desc);
  desc.type = FUM_LIGHT_ENVIRONMENT;
  desc.environment_pixels = pixels;
  desc.environment_width = WIDTH;
  desc.environment_height = HEIGHT;
  return desc;
}

static void assert_near(double found, double expected, double allowed) {
  if (!(fabs(found - expected) <= allowed)) fail_msg("%.9g instead of %.9g", found, expected);
}

static void test_energy_is_conserved_for_any_number_of_parts(void **state) {
  (void)state;
  stage s = stage_open();
  float pixels[HEIGHT][WIDTH][3];
  double expected[3] = {0.0};
  for (int y = 0; y < HEIGHT; y++) {
    for (int x = 0; x < WIDTH; x++) {
      for (int c = 0; c < 3; c++) {
        const float value = uniform((uint64_t)(3 * (y * WIDTH + x) + c), 0.0F, 1.0F);
        pixels[y][x][c] = value * value * value * (x == 5 && y == 7 ? 100.0F : 1.0F);
        expected[c] += 2.0 * (double)pixels[y][x][c] * solid_angle(y);
      }
    }
  }
  fum_light_desc desc = picture_of(&pixels[0][0][0]);
  for (int c = 0; c < 3; c++)
    desc.intensity[c] = 2.0F;
  const int32_t counts[] = {1, 2, 17, 64, 1000};
  for (size_t k = 0; k < sizeof counts / sizeof counts[0]; k++) {
    fum_environment e;
    assert_int_equal(fum_environment_choose(s.context, &desc, counts[k], counts[k], &e), FUM_OK);
    assert_int_equal(e.count, counts[k] < WIDTH * HEIGHT ? counts[k] : WIDTH * HEIGHT);
    for (int c = 0; c < 3; c++)
      assert_near((double)e.total[c], expected[c], 1e-5 * expected[c]);
    for (int32_t i = 0; i < e.count; i++) {
      assert_near((double)fum_length(e.parts[i].direction), 1.0, 1e-6);
      assert_true(e.parts[i].closeness >= 0.0F && e.parts[i].closeness <= 1.0F);
    }
    fum_environment_free(s.context, &e);
  }
  stage_close(&s);
}

static void test_one_bright_pixel_is_one_point(void **state) {
  (void)state;
  stage s = stage_open();
  float pixels[HEIGHT][WIDTH][3] = {{{0}}};
  pixels[8][3][1] = 7.0F;
  const fum_light_desc desc = picture_of(&pixels[0][0][0]);
  fum_environment e;
  assert_int_equal(fum_environment_choose(s.context, &desc, 64, 64, &e), FUM_OK);
  assert_int_equal(e.count, 1);
  const double up = FUM_PI * (8.5 / HEIGHT - 0.5), around = FUM_PI * (1.0 - 2.0 * 3.5 / WIDTH);
  assert_near((double)e.parts[0].direction.x, cos(up) * cos(around), 1e-6);
  assert_near((double)e.parts[0].direction.y, cos(up) * sin(around), 1e-6);
  assert_near((double)e.parts[0].direction.z, sin(up), 1e-6);
  assert_near((double)e.parts[0].irradiance[1], 7.0 * solid_angle(8), 1e-5);
  assert_near((double)e.parts[0].closeness, 1.0, 1e-6);
  fum_environment_free(s.context, &e);
  stage_close(&s);
}

/* A single bright pixel gets a part of its own however bright the rest is. */
static void test_a_sun_in_the_sky_is_parted_from_it(void **state) {
  (void)state;
  stage s = stage_open();
  float pixels[HEIGHT][WIDTH][3];
  for (int i = 0; i < HEIGHT * WIDTH * 3; i++)
    (&pixels[0][0][0])[i] = 0.1F;
  for (int c = 0; c < 3; c++)
    pixels[9][14][c] = 500.0F;
  const fum_light_desc desc = picture_of(&pixels[0][0][0]);
  fum_environment e;
  assert_int_equal(fum_environment_choose(s.context, &desc, 32, 32, &e), FUM_OK);
  float brightest = 0.0F;
  for (int32_t i = 0; i < e.count; i++)
    brightest = fmaxf(brightest, e.parts[i].irradiance[0]);
  assert_near((double)brightest, 500.0 * solid_angle(9), 0.02); /* perhaps with a neighbour */
  fum_environment_free(s.context, &e);
  stage_close(&s);
}

/* An even sky scatters its radiance, whatever the phase function and wherever the viewer: the integral of that is 1. */
static void test_even_light_scatters_its_radiance(void **state) {
  (void)state;
  stage s = stage_open();
  fum_light_desc desc;
  fum_light_desc_init(&desc);
  desc.type = FUM_LIGHT_ENVIRONMENT;
  fum_environment e;
  assert_int_equal(fum_environment_choose(s.context, &desc, 64, 64, &e), FUM_OK);
  assert_int_equal(e.count, 64);
  assert_near((double)e.total[0], 4.0 * FUM_PI, 1e-4);
  const float anisotropies[] = {0.0F, 0.3F, -0.6F, 0.6F};
  for (int k = 0; k < 4; k++) {
    for (uint64_t n = 0; n < 50; n++) {
      const float z = uniform(2 * n, -0.9F, 0.9F), angle = uniform(2 * n + 1, 0.0F, 6.28F),
                  across = sqrtf(1.0F - z * z);
      const fum_vec3 viewer = {across * cosf(angle), across * sinf(angle), z};
      const fum_sky_peak peak = fum_environment_peak(&e, 0, anisotropies[k], viewer);
      double wide = 0.0, weights = 0.0;
      for (int32_t i = 0; i < e.count; i++) {
        wide += (double)fum_sky_scatter_wide(&e.parts[i], 0, anisotropies[k], viewer);
        weights += (double)fum_sky_weight(&e, i, 0, anisotropies[k], viewer, &peak);
      }
      assert_near(wide, 1.0, 0.02);
      assert_near(weights, wide, 1e-5);
    }
  }
  fum_environment_free(s.context, &e);
  stage_close(&s);
}

int main(void) {
  const struct CMUnitTest tests[] = {
      cmocka_unit_test(test_energy_is_conserved_for_any_number_of_parts),
      cmocka_unit_test(test_one_bright_pixel_is_one_point),
      cmocka_unit_test(test_a_sun_in_the_sky_is_parted_from_it),
      cmocka_unit_test(test_even_light_scatters_its_radiance),
  };
  return cmocka_run_group_tests(tests, NULL, NULL);
}
