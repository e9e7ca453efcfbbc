/* SPDX-License-Identifier: GPL-3.0-or-later */
/* Particles thinner than a pixel: their shade and their area against quadrature over the Gaussian. */
#include "support.h"

#include "billboard/dust.h"

/* Sigmas; the sum over even steps is exact to rounding for what falls off like a Gaussian. */
static const double STEP = 0.125, END = 6.0;

/* Integral of 1 - exp(-tau(r)) over the plane, over 2 pi sigma^2, with s^4 = tau(r) / tau. */
static double brute_coverage(double tau) {
  const int steps = 4000;
  double sum = 0.0;
  for (int i = 0; i < steps; i++) {
    const double s = (i + 0.5) / steps;
    sum += -4.0 * expm1(-tau * s * s * s * s) / s;
  }
  return sum / steps;
}

/* Light that a particle of sigma 1 scatters to a camera at +z: lit from a direction at the given cosine to that or,
 * with `is_shaded` false, by light that nothing stops. */
static double brute_light(double tau, double cosine, bool is_shaded) {
  const double sine = sqrt(fmax(0.0, 1.0 - cosine * cosine));
  double sum = 0.0;
  for (double x = -END; x <= END; x += STEP) {
    for (double z = -END; z <= END; z += STEP) {
      const double along = x * sine + z * cosine, beside = x * cosine - z * sine;
      const double to_camera = tau * exp(-0.5 * x * x) * 0.5 * erfc(z * sqrt(0.5));
      const double to_light = tau * exp(-0.5 * beside * beside) * 0.5 * erfc(along * sqrt(0.5));
      const double stops = to_camera + (is_shaded ? to_light : 0.0), extinction = exp(-0.5 * (x * x + z * z));
      for (double y = 0.0; y <= END; y += STEP) {
        const double gauss = exp(-0.5 * y * y);
        sum += (y > 0.0 ? 2.0 : 1.0) * extinction * gauss * exp(-stops * gauss);
      }
    }
  }
  return sum;
}

/* It keeps 0.013; at optical depths up to 3 it keeps 0.004. */
static void test_shade_is_quadrature(void **state) {
  (void)state;
  static const double depths[] = {0.01, 0.1, 0.3, 1.0, 3.0, 10.0, 30.0};
  static const double cosines[] = {-1.0, -0.75, -0.5, 0.0, 0.5, 0.75, 1.0};
  for (int i = 0; i < 7; i++) {
    const double unshaded = brute_light(depths[i], 0.0, false), bound = depths[i] > 3.0 ? 0.015 : 0.005;
    for (int k = 0; k < 7; k++) {
      const double expected = brute_light(depths[i], cosines[k], true) / unshaded;
      const double found = fum_dust_shade(depths[i], cosines[k]);
      if (fabs(found - expected) > bound) {
        fail_msg("depth %g, cosine %g: %.6g is not %.6g", depths[i], cosines[k], found, expected);
      }
    }
  }
}

/* The two ends are closed forms: the table of the exponential integral is good to 1e-4. */
static void test_shade_at_the_ends(void **state) {
  (void)state;
  for (double depth = 0.01; depth < 50.0; depth *= 1.7) {
    const double area = brute_coverage(depth);
    assert_true(fabs(fum_dust_shade(depth, 1.0) - 0.5 * brute_coverage(2.0 * depth) / area) < 1e-4);
    assert_true(fabs(fum_dust_shade(depth, -1.0) + expm1(-depth) / area) < 1e-4);
  }
}

static void test_thin_particles_shade_nothing(void **state) {
  (void)state;
  for (double cosine = -1.0; cosine <= 1.0; cosine += 0.5) {
    assert_true(fum_dust_shade(0.0, cosine) == 1.0);
    assert_true(fabs(fum_dust_shade(1.01e-4, cosine) - 1.0) < 1e-4);
  }
}

static void test_widened_covers_the_same_area(void **state) {
  (void)state;
  for (double depth = 1e-3; depth < 1e4; depth *= 2.5) {
    for (double ratio = 0.02; ratio < 1.0; ratio *= 1.5) {
      const double widened = fum_dust_widened(depth, ratio);
      const double expected = brute_coverage(depth) * ratio * ratio, found = brute_coverage(widened);
      if (fabs(found - expected) > 1e-4 * expected) {
        fail_msg("depth %g, ratio %g: area %.9g is not %.9g", depth, ratio, found, expected);
      }
      assert_true(widened > 0.0 && widened < depth);
    }
  }
}

static void test_widened_at_its_limits(void **state) {
  (void)state;
  assert_true(fum_dust_widened(0.0, 0.5) == 0.0);
  for (double depth = 1e-3; depth < 1e4; depth *= 2.5)
    assert_true(fabs(fum_dust_widened(depth, 1.0) / depth - 1.0) < 1e-5);
}

int main(void) {
  const struct CMUnitTest tests[] = {
      cmocka_unit_test(test_shade_is_quadrature),          cmocka_unit_test(test_shade_at_the_ends),
      cmocka_unit_test(test_thin_particles_shade_nothing), cmocka_unit_test(test_widened_covers_the_same_area),
      cmocka_unit_test(test_widened_at_its_limits),
  };
  return cmocka_run_group_tests(tests, NULL, NULL);
}
