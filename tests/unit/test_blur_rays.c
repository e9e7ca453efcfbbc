/* SPDX-License-Identifier: GPL-3.0-or-later */
/* Rays of the meter of blur: sums against libm at each instruction set, instants that share the aperture evenly. */
#include "support.h"

#include "base/cpu.h"
#include "billboard/blur_rays.h"

enum { COUNT = 101, ARRAYS = 8 };

/* Around the camera's axis; what is behind the last has no optical depth. */
static fum_blur_particles make_particles(float arrays[ARRAYS][COUNT + FUM_BLUR_PAD]) {
  memset(arrays, 0, ARRAYS * sizeof *arrays);
  for (int i = 0; i < COUNT; i++) {
    const uint64_t seed = 100 * (uint64_t)i;
    for (int axis = 0; axis < 3; axis++) {
      arrays[axis][i] = uniform(seed + (uint64_t)axis, -1.0F, 1.0F) - (axis == 2 ? 3.0F : 0.0F);
      arrays[3 + axis][i] = uniform(seed + 3 + (uint64_t)axis, -0.5F, 0.5F);
    }
    arrays[6][i] = 1.0F / uniform(seed + 6, 0.05F, 0.5F);
    arrays[7][i] = uniform(seed + 7, 0.0F, 2.0F);
  }
  return (fum_blur_particles){COUNT,     arrays[0], arrays[1], arrays[2], arrays[3],
                              arrays[4], arrays[5], arrays[6], arrays[7]};
}

static double brute_sum(const fum_blur_particles *p, const fum_blur_ray *r) {
  double length = 0.0, sum = 0.0;
  for (int axis = 0; axis < 3; axis++)
    length = hypot(length, (double)r->direction[axis]);
  for (int64_t i = 0; i < p->count; i++) {
    const double time = (double)r->time, inverse = (double)p->inverse_sigmas[i];
    const double q[3] = {(double)p->x[i] + time * (double)p->move_x[i] - (double)r->start[0],
                         (double)p->y[i] + time * (double)p->move_y[i] - (double)r->start[1],
                         (double)p->z[i] + time * (double)p->move_z[i] - (double)r->start[2]};
    double along = 0.0, squared = 0.0;
    for (int axis = 0; axis < 3; axis++)
      along += q[axis] * (double)r->direction[axis] / length;
    for (int axis = 0; axis < 3; axis++)
      squared += pow((q[axis] - along * (double)r->direction[axis] / length) * inverse, 2.0);
    const double a = ((double)r->near * length - along) * inverse * sqrt(0.5);
    const double b = ((double)r->far * length - along) * inverse * sqrt(0.5);
    const double share = 0.5 * (a > 0.0 ? erfc(a) - erfc(b) : b < 0.0 ? erfc(-b) - erfc(-a) : erf(b) - erf(a));
    sum += (double)p->optical_depths[i] * exp(-0.5 * squared) * share;
  }
  return sum;
}

static void test_sums_are_those_of_the_closed_form(void **state) {
  static float arrays[ARRAYS][COUNT + FUM_BLUR_PAD];
  const fum_blur_particles particles = make_particles(arrays);
  (void)state;
  for (int level = 0; level <= 2; level++) {
    fum_cpu_limit(FUM_CPU_AVX512);
    if (level > (int)fum_cpu()) break;
    fum_cpu_limit((fum_cpu_level)level);
    for (uint64_t n = 0; n < 200; n++) {
      const uint64_t seed = 9000 + 10 * n;
      const fum_blur_ray ray = {.time = uniform(seed, 0.0F, 1.0F),
                                .start = {uniform(seed + 1, -0.3F, 0.3F), uniform(seed + 2, -0.3F, 0.3F), 0.0F},
                                .direction = {uniform(seed + 3, -0.3F, 0.3F), uniform(seed + 4, -0.3F, 0.3F), -1.0F},
                                .near = n % 3 == 0 ? 2.5F : 0.1F,
                                .far = n % 4 == 0 ? 3.0F : 1000.0F};
      const double expected = brute_sum(&particles, &ray);
      assert_true(fabs((double)fum_blur_sum_get()(&particles, &ray) - expected) < 2e-5 * (1.0 + expected));
    }
  }
  fum_cpu_limit(FUM_CPU_AVX512);
}

/* The pictures' middles have the disc's centroid and second moments, and each has a part of the shutter. */
static void test_instants_share_shutter_and_aperture(void **state) {
  (void)state;
  for (int32_t pictures = 1; pictures <= 16; pictures *= 4) {
    double mean[2] = {0.0, 0.0}, squared = 0.0;
    const int32_t steps = 64;
    for (int32_t picture = 0; picture < pictures; picture++) {
      for (int32_t k = 0; k < steps * steps; k++) {
        const double within[3] = {0.5, (k % steps + 0.5) / steps, (k / steps + 0.5) / steps};
        const fum_blur_instant i = fum_blur_find_instant(pictures, picture, within);
        assert_true(fabs(i.time - (picture + 0.5) / pictures) < 1e-12);
        for (int axis = 0; axis < 2; axis++) {
          mean[axis] += i.lens[axis] / (pictures * steps * steps);
          squared += i.lens[axis] * i.lens[axis] / (pictures * steps * steps);
        }
      }
    }
    assert_true(fabs(mean[0]) < 1e-9);
    assert_true(fabs(mean[1]) < 1e-9);
    assert_true(fabs(squared - 0.5) < 1e-3);
  }
}

int main(void) {
  const struct CMUnitTest tests[] = {
      cmocka_unit_test(test_sums_are_those_of_the_closed_form),
      cmocka_unit_test(test_instants_share_shutter_and_aperture),
  };
  return cmocka_run_group_tests(tests, NULL, NULL);
}
