/* SPDX-License-Identifier: GPL-3.0-or-later */
/* The reference's lights against solid angles and form factors. */
#include "support.h"

#include "reference/lamp.h"

static const double PI = 3.14159265358979323846;

/* Sums over a lamp's samples. */
typedef struct received {
  double normal[3];          /* of a surface; 0: none */
  double facing, irradiance; /* without the cosine, and of the surface */
  int64_t count;
  double nearest;
} received;

static void add(void *user, const fum_shine *shine) {
  received *r = user;
  double cosine = 0.0, squared = 0.0;
  for (int axis = 0; axis < 3; axis++) {
    cosine += shine->direction[axis] * r->normal[axis];
    squared += shine->direction[axis] * shine->direction[axis];
  }
  assert_true(fabs(squared - 1.0) < 1e-9);
  r->facing += shine->strength;
  r->irradiance += shine->strength * fmax(cosine, 0.0);
  r->nearest = fmin(r->nearest, shine->distance);
  r->count++;
}

/* What a point of a surface that looks up receives from a light. */
static received receive(const fum_light_desc *desc, double x, double y, double z, int32_t samples) {
  const double origin[3] = {0.0, 0.0, 0.0}, point[3] = {x, y, z};
  const fum_reference_lamp lamp = fum_reference_lamp_make(desc, origin, samples);
  received r = {.normal = {0.0, 0.0, 1.0}, .nearest = INFINITY};
  fum_reference_lamp_visit(&lamp, point, add, &r);
  return r;
}

/* A light that shines down from z = 1. */
static fum_light_desc make_light(int32_t type) {
  fum_light_desc desc;
  fum_light_desc_init(&desc);
  desc.type = type;
  desc.world_from_light[11] = 1.0;
  return desc;
}

static void assert_close(double value, double expected, double relative) {
  if (!(fabs(value - expected) <= relative * fabs(expected))) fail_msg("%.9g is not %.9g", value, expected);
}

static void test_point(void **state) {
  (void)state;
  fum_light_desc desc = make_light(FUM_LIGHT_POINT);
  received r = receive(&desc, 2.0, 0.0, 0.0, 256);
  assert_int_equal(r.count, 1);
  assert_close(r.facing, 0.2, 1e-12);
  assert_close(r.irradiance, 0.2 / sqrt(5.0), 1e-12);
  assert_close(r.nearest, sqrt(5.0), 1e-12);
  desc.radius = 0.5F; /* a disc of radiance I / (pi r^2) that faces the point */
  for (double z = 0.9; z > -20.0; z = 1.0 - 2.0 * (1.0 - z)) {
    const double d = 1.0 - z, cosine = d / hypot(d, 0.5);
    r = receive(&desc, 0.0, 0.0, z, 256);
    assert_int_equal(r.count, 256);
    assert_close(r.facing, 2.0 * PI * (1.0 - cosine) / (PI * 0.25), 1e-9);
    assert_close(r.irradiance, 1.0 / (d * d + 0.25), 1e-3);
    assert_close(r.nearest, d, 0.01);
  }
  r = receive(&desc, 0.0, 0.0, 1.0, 4); /* at the light's centre: half of the sphere */
  assert_close(r.facing, 2.0 * PI / (PI * 0.25), 1e-9);
}

static void test_sun(void **state) {
  (void)state;
  fum_light_desc desc = make_light(FUM_LIGHT_SUN);
  const double angles[] = {0.0, 0.01, 0.6, 1.5};
  for (int i = 0; i < 4; i++) {
    desc.sun_angle = (float)angles[i];
    const received r = receive(&desc, 3.0, 2.0, 1.0, 1024);
    assert_close(r.irradiance, 1.0, 1e-3);
    assert_true(r.nearest == INFINITY);
    assert_int_equal(r.count, i == 0 ? 1 : 1024);
  }
}

static void test_spot(void **state) {
  (void)state;
  fum_light_desc desc = make_light(FUM_LIGHT_SPOT);
  desc.spot_angle = 1.0F;
  desc.spot_blend = 0.5F;
  const double edge = cos(0.5);
  for (double x = 0.05; x < 1.0; x += 0.05) {
    const double cosine = 1.0 / sqrt(1.0 + x * x), t = fmin(1.0, fmax(0.0, (cosine - edge) / ((1.0 - edge) * 0.5)));
    const double expected = t * t * (3.0 - 2.0 * t) * cosine * cosine;
    desc.spot_cosine = 0;
    assert_true(fabs(receive(&desc, x, 0.0, 0.0, 4).facing - expected) < 1e-9);
    desc.spot_cosine = 1;
    assert_true(fabs(receive(&desc, x, 0.0, 0.0, 4).facing - expected * cosine) < 1e-9);
  }
  /* twice as wide along x: lights as far out as the plain one at half the way */
  desc.spot_cosine = 0;
  const double plain = receive(&desc, 0.3, 0.0, 0.0, 4).facing * 1.09;
  desc.world_from_light[0] = 2.0;
  assert_close(receive(&desc, 0.6, 0.0, 0.0, 4).facing * 1.36, plain, 1e-9);
  desc.spot_blend = 0.0F;
  desc.world_from_light[0] = 1.0;
  assert_close(receive(&desc, 0.5, 0.0, 0.0, 4).facing * 1.25, 1.0, 1e-9);
  assert_true(receive(&desc, 0.6, 0.0, 0.0, 4).facing == 0.0);
}

/* Solid angle and form factor of the rectangle 1 x 2 at z = 1 seen from z on its axis. */
static void test_rectangle(void **state) {
  (void)state;
  fum_light_desc desc = make_light(FUM_LIGHT_AREA);
  desc.area_size[1] = 2.0F;
  const double heights[] = {-3.0, 0.0, 0.8, 0.97};
  for (int i = 0; i < 4; i++) {
    const double d = 1.0 - heights[i], a = 0.5 / d, b = 1.0 / d, p = sqrt(1.0 + a * a), q = sqrt(1.0 + b * b);
    const received r = receive(&desc, 0.0, 0.0, heights[i], 256);
    assert_close(r.facing, 4.0 * asin(a * b / (p * q)), 2e-3);
    assert_close(r.irradiance, 2.0 * (a / p * atan(b / p) + b / q * atan(a / q)), 2e-3);
    assert_true(r.count >= 256);
  }
  assert_int_equal(receive(&desc, 0.0, 0.0, 1.5, 256).count, 0); /* shines to one side */
  assert_int_equal(receive(&desc, 0.0, 0.0, 1.0, 256).count, 0);
  desc.area_size[0] = 0.0F;
  assert_int_equal(receive(&desc, 0.0, 0.0, 0.0, 256).count, 0);
}

static void test_disc_and_spread(void **state) {
  (void)state;
  fum_light_desc desc = make_light(FUM_LIGHT_AREA);
  desc.area_shape = FUM_AREA_ELLIPSE;
  for (double z = 0.95; z > -5.0; z = 1.0 - 2.0 * (1.0 - z)) {
    const double d = 1.0 - z;
    const received r = receive(&desc, 0.0, 0.0, z, 256);
    assert_close(r.irradiance, PI * 0.25 / (d * d + 0.25), 3e-3);
    assert_close(r.facing, 2.0 * PI * (1.0 - d / hypot(d, 0.5)), 3e-3);
  }
  desc.area_size[1] = 0.5F; /* an ellipse far away */
  assert_close(receive(&desc, 0.0, 0.0, -99.0, 16).facing, PI / 8.0 / 1e4, 1e-4);
  /* tan(s / 2) / (tan(s / 2) - s / 2) straight ahead, nothing beyond s / 2 */
  desc.area_size[0] = desc.area_size[1] = 1e-3F;
  desc.area_spread = 1.0F;
  assert_close(receive(&desc, 0.0, 0.0, 0.0, 16).facing, tan(0.5) / (tan(0.5) - 0.5) * PI * 0.25e-6, 1e-3);
  assert_int_equal(receive(&desc, 0.6, 0.0, 0.0, 16).count, 0);
}

static void test_breaks(void **state) {
  (void)state;
  fum_light_desc desc = make_light(FUM_LIGHT_SPOT);
  desc.spot_angle = (float)(PI / 2.0); /* x^2 + y^2 = (1 - z)^2 */
  const double origin[3] = {0.0, 0.0, 0.0}, start[3] = {-3.0, 0.5, 0.0}, along[3] = {0.8, 0.0, 0.6};
  const fum_reference_lamp lamp = fum_reference_lamp_make(&desc, origin, 1);
  double breaks[FUM_LAMP_BREAKS];
  assert_int_equal(fum_reference_lamp_breaks(&lamp, start, along, breaks), 5);
  assert_close(breaks[0], 3.0 * 0.8 + 0.6, 1e-12); /* nearest to the light */
  for (int i = 1; i < 3; i++) {
    const double x = start[0] + breaks[i] * along[0], z = breaks[i] * along[2];
    assert_close(x * x + 0.25, (1.0 - z) * (1.0 - z), 1e-6);
  }
  assert_true(fabs(breaks[1] - breaks[2]) > 0.1);
  assert_close(breaks[3], 3.0 / 0.8, 1e-12); /* nearest to its axis x = 0, y = 0 */
  assert_close(breaks[4], 1.0 / 0.6, 1e-12); /* in its plane z = 1 */
}

int main(void) {
  const struct CMUnitTest tests[] = {
      cmocka_unit_test(test_point),
      cmocka_unit_test(test_sun),
      cmocka_unit_test(test_spot),
      cmocka_unit_test(test_rectangle),
      cmocka_unit_test(test_disc_and_spread),
      cmocka_unit_test(test_breaks),
  };
  return cmocka_run_group_tests(tests, NULL, NULL);
}
