/* SPDX-License-Identifier: GPL-3.0-or-later */
#include "support.h"

#include "lighting/emitter.h"
#include "lighting/phase.h"

static const double ORIGIN[3] = {0.0, 0.0, 0.0};

/* Irradiance at a point of a surface with the given normal: the sum over the light's samples. */
static double irradiance(const fum_light_desc *desc, fum_vec3 point, const fum_vec3 *normal, int32_t samples) {
  const float bounds[6] = {point.x, point.y, point.z, point.x, point.y, point.z};
  fum_lamp lamp;
  fum_lamp_init(desc, ORIGIN, bounds, samples, &lamp);
  double sum = 0.0;
  for (int32_t i = 0; i < lamp.sample_count; i++) {
    const fum_emitter e = fum_lamp_sample(&lamp, i);
    fum_vec3 to_light = e.direction;
    if (!e.is_directional) {
      to_light = fum_sub(e.position, point);
      to_light = fum_scaled(to_light, 1.0F / fum_length(to_light));
    }
    const float cosine = normal != NULL ? fmaxf(0.0F, fum_dot(*normal, to_light)) : 1.0F;
    sum += (double)(fum_emitter_irradiance(&lamp, &e, point) * cosine);
  }
  return sum;
}

static fum_light_desc light_at_height(int32_t type, double height) {
  fum_light_desc desc;
  fum_light_desc_init(&desc);
  desc.type = type;
  desc.world_from_light[11] = height; /* shines down on the plane z = 0 */
  return desc;
}

static void assert_close(double value, double expected, double relative) {
  if (fabs(value - expected) > relative * fabs(expected) + 1e-12) fail_msg("%.9g is not %.9g", value, expected);
}

static void test_point_light(void **state) {
  (void)state;
  const fum_vec3 up = {0.0F, 0.0F, 1.0F};
  fum_light_desc desc = light_at_height(FUM_LIGHT_POINT, 2.0);
  assert_close(irradiance(&desc, (fum_vec3){0}, &up, 16), 0.25, 1e-6);
  const double distance = sqrt(5.0);
  assert_close(irradiance(&desc, (fum_vec3){1.0F, 0.0F, 0.0F}, &up, 16), 2.0 / distance / 5.0, 1e-6);
  desc.radius = 1.0F; /* I / (d^2 + r^2) on the axis */
  assert_close(irradiance(&desc, (fum_vec3){0}, &up, 1024), 0.2, 0.02);
  /* without a cosine: radiance I / (pi r^2) times the disc's solid angle */
  assert_close(irradiance(&desc, (fum_vec3){0}, NULL, 16), 2.0 * (1.0 - 2.0 / sqrt(5.0)), 1e-5);
}

static void test_sun(void **state) {
  (void)state;
  const fum_vec3 up = {0.0F, 0.0F, 1.0F};
  fum_light_desc desc = light_at_height(FUM_LIGHT_SUN, 0.0);
  assert_close(irradiance(&desc, (fum_vec3){3.0F, 0.0F, 0.0F}, &up, 16), 1.0, 1e-6);
  desc.sun_angle = 0.3F;
  assert_close(irradiance(&desc, (fum_vec3){3.0F, 0.0F, 0.0F}, &up, 64), 1.0, 1e-4);
  desc.sun_angle = 1.2F;
  assert_close(irradiance(&desc, (fum_vec3){3.0F, 0.0F, 0.0F}, &up, 64), 1.0, 2e-3);
}

static void test_spot(void **state) {
  (void)state;
  fum_light_desc desc = light_at_height(FUM_LIGHT_SPOT, 1.0);
  desc.spot_angle = 1.0F;
  desc.spot_blend = 0.5F;
  assert_close(irradiance(&desc, (fum_vec3){0}, NULL, 16), 1.0, 1e-6);
  const double edge = cos(0.5);
  for (double x = 0.05; x < 1.0; x += 0.05) {
    const double cosine = 1.0 / sqrt(1.0 + x * x);
    const double t = fmin(1.0, fmax(0.0, (cosine - edge) / ((1.0 - edge) * 0.5)));
    const double expected = t * t * (3.0 - 2.0 * t) / (1.0 + x * x);
    desc.spot_cosine = 0;
    assert_true(fabs(irradiance(&desc, (fum_vec3){(float)x, 0.0F, 0.0F}, NULL, 16) - expected) < 1e-5);
    desc.spot_cosine = 1;
    assert_true(fabs(irradiance(&desc, (fum_vec3){(float)x, 0.0F, 0.0F}, NULL, 16) - expected * cosine) < 1e-5);
  }
  /* a cone scaled by 2 along x lights as far out along x as the plain one at half the way */
  desc.spot_cosine = 0;
  const double plain = irradiance(&desc, (fum_vec3){0.3F, 0.0F, 0.0F}, NULL, 16) * 1.09;
  desc.world_from_light[0] = 2.0;
  assert_close(irradiance(&desc, (fum_vec3){0.6F, 0.0F, 0.0F}, NULL, 16) * 1.36, plain, 1e-4);
  /* hard edge */
  desc.world_from_light[0] = 1.0;
  desc.spot_blend = 0.0F;
  assert_close(irradiance(&desc, (fum_vec3){0.5F, 0.0F, 0.0F}, NULL, 16) * 1.25, 1.0, 1e-5);
  assert_true(irradiance(&desc, (fum_vec3){0.6F, 0.0F, 0.0F}, NULL, 16) == 0.0);
}

static void test_area(void **state) {
  (void)state;
  const fum_vec3 up = {0.0F, 0.0F, 1.0F};
  fum_light_desc desc = light_at_height(FUM_LIGHT_AREA, 1.0);
  desc.area_size[0] = 1.0F;
  desc.area_size[1] = 2.0F;
  /* form factor of a rectangle over a point below its middle: four times that of a quarter below its corner */
  const double a = 0.5, b = 1.0, p = sqrt(1.0 + a * a), q = sqrt(1.0 + b * b);
  const double factor = 4.0 * 0.5 * (a / p * atan(b / p) + b / q * atan(a / q));
  assert_close(irradiance(&desc, (fum_vec3){0}, &up, 1024), factor, 2e-3);
  /* solid angle of the same */
  const double omega = 4.0 * asin(a * b / (p * q));
  assert_close(irradiance(&desc, (fum_vec3){0}, NULL, 1024), omega, 2e-3);
  assert_close(irradiance(&desc, (fum_vec3){0}, &up, 16), factor,
               0.015); /* 65 degrees wide: the worst of near fields */
  /* one-sided */
  assert_true(irradiance(&desc, (fum_vec3){0.0F, 0.0F, 2.0F}, NULL, 16) == 0.0);
  /* disc of radius R seen from its axis: pi R^2 / (d^2 + R^2) */
  desc.area_shape = FUM_AREA_ELLIPSE;
  desc.area_size[1] = 1.0F;
  assert_close(irradiance(&desc, (fum_vec3){0}, &up, 1024), 3.14159265 * 0.25 / 1.25, 2e-3);
  /* spread keeps the power near the axis up: tan(s/2) / (tan(s/2) - s/2) straight ahead */
  desc.area_size[0] = desc.area_size[1] = 1e-3F;
  desc.area_spread = 1.0F;
  const double straight = tan(0.5) / (tan(0.5) - 0.5) * 3.14159265 * 0.25e-6;
  assert_close(irradiance(&desc, (fum_vec3){0}, &up, 16), straight, 1e-3);
  assert_true(irradiance(&desc, (fum_vec3){0.6F, 0.0F, 0.0F}, &up, 16) == 0.0);
}

static void test_small_lights_take_one_sample(void **state) {
  (void)state;
  fum_light_desc desc = light_at_height(FUM_LIGHT_POINT, 10.0);
  fum_lamp lamp;
  const float far_away[6] = {-0.1F, -0.1F, -0.1F, 0.1F, 0.1F, 0.1F}, around[6] = {-20, -20, -20, 20, 20, 20};
  desc.radius = 0.1F;
  fum_lamp_init(&desc, ORIGIN, far_away, 16, &lamp);
  assert_int_equal(lamp.sample_count, 1);
  fum_lamp_init(&desc, ORIGIN, around, 16, &lamp);
  assert_int_equal(lamp.sample_count, 16);
  for (int32_t i = 0; i < 16; i++) { /* the same samples every time, inside the light */
    const fum_emitter a = fum_lamp_sample(&lamp, i), b = fum_lamp_sample(&lamp, i);
    assert_memory_equal(&a.position, &b.position, sizeof a.position);
    assert_true(fum_length(fum_sub(a.position, lamp.position)) <= 0.1F * 1.0001F);
  }
  desc.radius = 0.0F;
  fum_lamp_init(&desc, ORIGIN, around, 16, &lamp);
  assert_true(lamp.sample_count >= 1);
}

static void test_phase_function_integrates_to_one(void **state) {
  (void)state;
  const float anisotropies[] = {-0.95F, -0.5F, 0.0F, 0.3F, 0.8F, 0.99F};
  for (int k = 0; k < 6; k++) {
    double sum = 0.0, mean = 0.0;
    const int steps = 400000;
    for (int i = 0; i < steps; i++) {
      const double cosine = -1.0 + 2.0 * (i + 0.5) / steps;
      const double p = (double)fum_phase(anisotropies[k], (float)cosine) * 2.0 * 3.14159265358979 * 2.0 / steps;
      sum += p;
      mean += p * cosine;
    }
    assert_close(sum, 1.0, 2e-3);
    assert_true(fabs(mean - (double)anisotropies[k]) < 2e-3); /* g is the mean cosine */
  }
}

int main(void) {
  const struct CMUnitTest tests[] = {
      cmocka_unit_test(test_point_light),
      cmocka_unit_test(test_sun),
      cmocka_unit_test(test_spot),
      cmocka_unit_test(test_area),
      cmocka_unit_test(test_small_lights_take_one_sample),
      cmocka_unit_test(test_phase_function_integrates_to_one),
  };
  return cmocka_run_group_tests(tests, NULL, NULL);
}
