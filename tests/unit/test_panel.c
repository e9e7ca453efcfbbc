/* SPDX-License-Identifier: GPL-3.0-or-later */
/* Area lights as a whole against a fine grid of patches in double precision. */
#include "support.h"

#include "lighting/panel.h"

enum { STEPS = 700 };

static const double SIZES[2] = {1.5, 1.0}, PI = 3.14159265358979;

/* A light around the origin that shines along +z, or wherever the matrix puts that. */
static fum_lamp make_lamp(int32_t shape, double spread, const double world_from_light[16]) {
  const double origin[3] = {0.0, 0.0, 0.0};
  const float bounds[6] = {0};
  fum_light_desc desc;
  fum_light_desc_init(&desc);
  desc.type = FUM_LIGHT_AREA;
  desc.area_shape = shape;
  desc.area_spread = (float)spread;
  for (int axis = 0; axis < 2; axis++)
    desc.area_size[axis] = (float)SIZES[axis];
  memcpy(desc.world_from_light, world_from_light, sizeof desc.world_from_light);
  fum_lamp lamp;
  fum_lamp_init(&desc, origin, bounds, 16, &lamp);
  return lamp;
}

/* What a square metre of the light at (x, y) sends to the point. */
static double patch(const double point[3], double spread, double x, double y) {
  const double across = hypot(point[0] - x, point[1] - y), distance = hypot(across, point[2]);
  const double half = 0.5 * spread, tangent = across / point[2];
  const double share = spread > 3.14 ? 1.0 : fmax(0.0, tan(half) - tangent) / (tan(half) - half);
  return share * point[2] / (distance * distance * distance);
}

/* Only the part of the light within `reach` of the point's foot sends anything, and the grid is laid over that. */
static double brute_rectangle(const double point[3], double spread) {
  const double reach = spread > 3.14 ? INFINITY : point[2] * tan(0.5 * spread);
  double low[2], step[2], sum = 0.0;
  for (int axis = 0; axis < 2; axis++) {
    low[axis] = fmax(-0.5 * SIZES[axis], point[axis] - reach);
    step[axis] = fmax(0.0, fmin(0.5 * SIZES[axis], point[axis] + reach) - low[axis]) / STEPS;
  }
  for (int j = 0; j < STEPS; j++) {
    for (int i = 0; i < STEPS; i++)
      sum += patch(point, spread, low[0] + (i + 0.5) * step[0], low[1] + (j + 0.5) * step[1]);
  }
  return sum * step[0] * step[1];
}

/* Chords of the ellipse. */
static double brute_ellipse(const double point[3], double spread) {
  const double reach = spread > 3.14 ? INFINITY : point[2] * tan(0.5 * spread);
  const double low = fmax(-0.5 * SIZES[1], point[1] - reach), high = fmin(0.5 * SIZES[1], point[1] + reach);
  double sum = 0.0;
  for (int j = 0; j < STEPS && low < high; j++) {
    const double y = low + (high - low) * (j + 0.5) / STEPS, v = 2.0 * y / SIZES[1];
    const double half_chord = 0.5 * SIZES[0] * sqrt(1.0 - v * v);
    const double left = fmax(-half_chord, point[0] - reach), right = fmin(half_chord, point[0] + reach);
    double row = 0.0;
    for (int i = 0; i < STEPS && left < right; i++)
      row += patch(point, spread, left + (right - left) * (i + 0.5) / STEPS, y);
    sum += left < right ? row * (right - left) / STEPS : 0.0;
  }
  return sum * (high - low) / STEPS;
}

static double brute(int32_t shape, const double point[3], double spread) {
  return shape == FUM_AREA_ELLIPSE ? brute_ellipse(point, spread) : brute_rectangle(point, spread);
}

/* Half a turn about y. */
static const double FORWARD[16] = {-1, 0, 0, 0, 0, 1, 0, 0, 0, 0, -1, 0, 0, 0, 0, 1};

static double panel(int32_t shape, const double point[3], double spread) {
  const fum_lamp lamp = make_lamp(shape, spread, FORWARD);
  return (double)fum_panel_irradiance(&lamp, (fum_vec3){(float)point[0], (float)point[1], (float)point[2]});
}

/* In sizes: across the light, where 0.5 is its edge, and in front of it. */
static void check_panel(int32_t shape, double spread, double x, double y, double z, double bound) {
  const double point[3] = {x * SIZES[0], y * SIZES[1], z * SIZES[0]};
  const double expected = brute(shape, point, spread), found = panel(shape, point, spread);
  if (fabs(found - expected) > bound * expected + 1e-12) {
    fail_msg("shape %d, spread %g, at %g %g %g: %.9g is not %.9g", (int)shape, spread, x, y, z, found, expected);
  }
}

static const double SPREADS[3] = {PI, 2.6, 1.0};

/* A rectangle keeps 1e-5. An ellipse is a polygon of 24 sides and keeps 6e-5... */
static void test_close_by(void **state) {
  (void)state;
  static const double points[][3] = {{0.0, 0.0, 0.05}, {0.3, 0.2, 0.05}, {0.8, 0.1, 0.05}, {0.1, 0.7, 0.2},
                                     {0.0, 0.0, 0.2},  {0.2, 0.3, 0.5},  {0.0, 0.0, 1.0},  {-0.5, -0.5, 1.0},
                                     {0.8, 0.1, 1.0},  {0.5, 0.0, 2.0}};
  for (size_t i = 0; i < sizeof points / sizeof *points; i++) {
    for (int k = 0; k < 3; k++) {
      check_panel(FUM_AREA_RECTANGLE, SPREADS[k], points[i][0], points[i][1], points[i][2], 1e-5);
      check_panel(FUM_AREA_ELLIPSE, SPREADS[k], points[i][0], points[i][1], points[i][2], 1e-4);
    }
  }
}

/* ...but not right in front of its edge, where the polygon's corners stand out. */
static void test_at_an_edge(void **state) {
  (void)state;
  for (int k = 0; k < 3; k++) {
    check_panel(FUM_AREA_RECTANGLE, SPREADS[k], 0.5, 0.0, 0.05, 1e-5);
    check_panel(FUM_AREA_RECTANGLE, SPREADS[k], 0.5, -0.5, 0.05, 1e-5);
    check_panel(FUM_AREA_ELLIPSE, SPREADS[k], 0.5, 0.0, 0.05, k == 2 ? 0.12 : 0.01);
    check_panel(FUM_AREA_ELLIPSE, SPREADS[k], 0.0, 0.5, 0.2, 2e-3);
  }
}

/* Its middle stands for a light that shines to all sides alike from 12 sizes on. */
static void test_far_away(void **state) {
  (void)state;
  for (int shape = FUM_AREA_RECTANGLE; shape <= FUM_AREA_ELLIPSE; shape++) {
    for (int k = 0; k < 3; k++) {
      for (double x = 0.0; x < 3.0; x += 1.3) {
        check_panel(shape, SPREADS[k], x, 0.4, 5.0, 1e-4);
        check_panel(shape, SPREADS[k], x, 0.4, sqrt(11.9 * 11.9 - x * x), 1.5e-3);
        check_panel(shape, SPREADS[k], x, 0.4, sqrt(12.1 * 12.1 - x * x), 1.5e-3);
        check_panel(shape, SPREADS[k], x, 0.4, 100.0, 1e-4);
      }
      const double near[3] = {1.0, 0.5, sqrt(18.0 * 18.0 - 1.25) - 1e-3}, far[3] = {1.0, 0.5, near[2] + 2e-3};
      assert_true(fabs(panel(shape, far, SPREADS[k]) / panel(shape, near, SPREADS[k]) - 1.0) < 2e-3);
    }
  }
}

static void test_behind(void **state) {
  (void)state;
  for (int shape = FUM_AREA_RECTANGLE; shape <= FUM_AREA_ELLIPSE; shape++) {
    for (int k = 0; k < 3; k++) {
      for (double z = 0.0; z > -100.0; z = 3.0 * z - 0.01) {
        const double inside[3] = {0.1, 0.2, z}, outside[3] = {3.0, 0.2, z};
        assert_true(panel(shape, inside, SPREADS[k]) == 0.0);
        assert_true(panel(shape, outside, SPREADS[k]) == 0.0);
      }
    }
  }
  const double beside_the_cone[3] = {3.0, 0.0, 2.0};
  assert_true(panel(FUM_AREA_RECTANGLE, beside_the_cone, 1.0) < 1e-9);
}

static void test_turned_and_moved(void **state) {
  (void)state;
  const double c = cos(0.7), s = sin(0.7);
  /* some turn */
  const double world_from_light[16] = {-c, s, 0, 2, c * s, c * c, s, -1, s * s, s * c, -c, 3, 0, 0, 0, 1};
  for (int shape = FUM_AREA_RECTANGLE; shape <= FUM_AREA_ELLIPSE; shape++) {
    for (int k = 0; k < 3; k++) {
      const fum_lamp plain = make_lamp(shape, SPREADS[k], FORWARD),
                     turned = make_lamp(shape, SPREADS[k], world_from_light);
      const double in_light[3] = {0.4, -0.3, -0.8};
      double world[3];
      fum_transform_point(world_from_light, in_light, world);
      const float expected = fum_panel_irradiance(&plain, (fum_vec3){-0.4F, -0.3F, 0.8F});
      const float found = fum_panel_irradiance(&turned, (fum_vec3){(float)world[0], (float)world[1], (float)world[2]});
      assert_true(expected > 0.1F && fabsf(found - expected) < 1e-5F * expected);
    }
  }
}

int main(void) {
  const struct CMUnitTest tests[] = {
      cmocka_unit_test(test_close_by), cmocka_unit_test(test_at_an_edge),       cmocka_unit_test(test_far_away),
      cmocka_unit_test(test_behind),   cmocka_unit_test(test_turned_and_moved),
  };
  return cmocka_run_group_tests(tests, NULL, NULL);
}
