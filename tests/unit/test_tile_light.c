/* SPDX-License-Identifier: GPL-3.0-or-later */
/* Light inside a particle, through fum_render: pictures of one thick Gaussian against integration in double precision.
 */
#include "support.h"

enum { SIDE = 24 };

static const double CAMERA_Z = 4.0, HALF_WINDOW = 0.35, SIGMA = 0.4, PI = 3.14159265358979;

static void draw(const puffs *p, const double to_sun[3], float *out_rgba) {
  stage s = stage_open();
  assert_int_equal(fum_context_set_threads(s.context, 1), FUM_OK);
  add_puffs(s.scene, p);
  fum_light_desc sun;
  fum_light_desc_init(&sun);
  sun.type = FUM_LIGHT_SUN; /* along local -z; the other axes don't matter to a sun without a size */
  for (int axis = 0; axis < 3; axis++)
    sun.world_from_light[4 * axis + 2] = to_sun[axis];
  assert_int_equal(fum_scene_add_light(s.scene, &sun), FUM_OK);
  fum_camera camera;
  fum_camera_init(&camera);
  camera.world_from_camera[11] = CAMERA_Z;
  memcpy(camera.window, (double[4]){-HALF_WINDOW, HALF_WINDOW, -HALF_WINDOW, HALF_WINDOW}, sizeof camera.window);
  camera.width = camera.height = SIDE;
  fum_settings settings;
  fum_settings_init(&settings);
  settings.device = FUM_DEVICE_TILES;
  const fum_pass_buffer pass = {.pass = FUM_PASS_COMBINED, .pixels = out_rgba, .pixels_size = 4 * SIDE * SIDE};
  assert_int_equal(fum_render(s.scene, &camera, &settings, 1, &pass, NULL), FUM_OK);
  stage_close(&s);
}

static double red_of_pixel(const puffs *p, const double to_sun[3], int x, int y) {
  const double far_away = 100.0, albedo = 0.8;
  const double start[3] = {0.0, 0.0, CAMERA_Z};
  double way[3] = {HALF_WINDOW * ((2.0 * x + 1.0) / SIDE - 1.0), HALF_WINDOW * ((2.0 * y + 1.0) / SIDE - 1.0), -1.0};
  const double length = sqrt(way[0] * way[0] + way[1] * way[1] + 1.0);
  const double begin = CAMERA_Z - 6.0 * SIGMA, step = 0.05 * SIGMA;
  double sum = 0.0;
  for (double range = begin; range < CAMERA_Z + 6.0 * SIGMA; range += step) {
    double point[3], sun[3], squared = 0.0;
    for (int axis = 0; axis < 3; axis++) {
      point[axis] = start[axis] + way[axis] / length * range;
      sun[axis] = point[axis] + far_away * to_sun[axis];
      squared += point[axis] * point[axis];
    }
    const double extinction = (double)p->densities[0] * exp(-0.5 * squared / (SIGMA * SIGMA));
    sum += extinction * exp(-brute_depth(p, start, point) - brute_depth(p, point, sun));
  }
  return albedo / (4.0 * PI) * sum * step;
}

static double relative_rms(double optical_depth, const double to_sun[3]) {
  static float rgba[4 * SIDE * SIDE];
  puffs p = puffs_random(1, 1, 0.0F, 1.0F, 1.0F);
  p.radii[0] = (float)(2.0 * SIGMA);
  p.densities[0] = (float)(optical_depth / (SIGMA * sqrt(2.0 * PI)));
  draw(&p, to_sun, rgba);
  double errors = 0.0, squares = 0.0;
  for (int i = 0; i < SIDE * SIDE; i++) {
    const double expected = red_of_pixel(&p, to_sun, i % SIDE, i / SIDE), error = (double)rgba[4 * i] - expected;
    errors += error * error;
    squares += expected * expected;
  }
  puffs_free(&p);
  return sqrt(errors / squares);
}

/* Light linear from face to face, in smoke that is even in each slab, is off by 0.5 to 1.7 % at depths 10 and 30, and
 * by up to 2.2 % at 3. */
static void test_one_thick_particle(void **state) {
  (void)state;
  static const double suns[][3] = {{1.0, 0.0, 0.0}, {0.0, 0.6, 0.8}, {-0.6, 0.0, -0.8}};
  static const double depths[] = {3.0, 10.0, 30.0}, bounds[] = {8e-3, 4e-3, 4e-3};
  for (int k = 0; k < 3; k++) {
    for (int d = 0; d < 3; d++) {
      const double error = relative_rms(depths[d], suns[k]);
      if (error > bounds[d]) fail_msg("sun %d, depth %g: off by %.3g %%", k, depths[d], 100.0 * error);
    }
  }
}

int main(void) {
  const struct CMUnitTest tests[] = {
      cmocka_unit_test(test_one_thick_particle),
  };
  return cmocka_run_group_tests(tests, NULL, NULL);
}
