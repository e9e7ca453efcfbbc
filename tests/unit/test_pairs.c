/* SPDX-License-Identifier: GPL-3.0-or-later */
#include "support.h"

#include "base/cpu.h"
#include "lighting/pairs.h"

enum { COUNT = 64 };

typedef struct arrays {
  float x[COUNT], y[COUNT], z[COUNT], inverse_sigmas[COUNT], optical_depths[COUNT];
} arrays;

/* The levels that this machine runs, each selected in turn. */
static int select_level(int index) {
  fum_cpu_limit(FUM_CPU_AVX512);
  const fum_cpu_level best = fum_cpu();
  if (index > (int)best) return 0;
  fum_cpu_limit((fum_cpu_level)index);
  assert_int_equal(fum_cpu(), index);
  return 1;
}

static double exact(const arrays *a, const fum_segment *s, int i, bool whole_line) {
  const double d[3] = {(double)a->x[i] - (double)s->origin[0], (double)a->y[i] - (double)s->origin[1],
                       (double)a->z[i] - (double)s->origin[2]};
  double t = 0.0, d2 = 0.0;
  for (int axis = 0; axis < 3; axis++)
    t += d[axis] * (double)s->direction[axis];
  for (int axis = 0; axis < 3; axis++)
    d2 += pow(d[axis] - t * (double)s->direction[axis], 2.0);
  const double inverse = (double)a->inverse_sigmas[i], gauss = exp(-0.5 * d2 * inverse * inverse);
  const double e0 = -t * inverse / sqrt(2.0), e1 = ((double)s->length - t) * inverse / sqrt(2.0);
  const double interval = e0 > 0.0 ? erfc(e0) - erfc(e1) : e1 < 0.0 ? erfc(-e1) - erfc(-e0) : erf(e1) - erf(e0);
  return (double)a->optical_depths[i] * gauss * (whole_line ? 1.0 : 0.5 * interval);
}

static void test_loops_agree_with_double_precision(void **state) {
  (void)state;
  for (int level = 0; select_level(level); level++) {
    const fum_pairs *pairs = fum_pairs_get();
    for (uint64_t trial = 0; trial < 300; trial++) {
      arrays a;
      double line = 0.0, segment = 0.0;
      fum_segment s = {{uniform(trial, -1.0F, 1.0F), uniform(trial + 1, -1.0F, 1.0F), uniform(trial + 2, -1.0F, 1.0F)},
                       {0.36F, 0.48F, 0.8F},
                       trial % 5 == 0 ? INFINITY : uniform(trial + 3, 0.0F, 3.0F)};
      for (int i = 0; i < COUNT; i++) {
        const uint64_t seed = fum_hash64(trial * COUNT + (uint64_t)i);
        a.x[i] = uniform(seed, -2.0F, 2.0F);
        a.y[i] = uniform(seed + 1, -2.0F, 2.0F);
        a.z[i] = uniform(seed + 2, -2.0F, 2.0F);
        a.inverse_sigmas[i] = expf(uniform(seed + 3, -2.0F, 3.0F));
        a.optical_depths[i] = expf(uniform(seed + 4, -5.0F, 3.0F));
        line += exact(&a, &s, i, true);
        segment += exact(&a, &s, i, false);
      }
      const fum_sources sources = {COUNT, a.x, a.y, a.z, a.inverse_sigmas, a.optical_depths};
      assert_true(fabs((double)pairs->line(&sources, &s) - line) < 1e-5 * (line + 1e-3));
      assert_true(fabs((double)pairs->segment(&sources, &s) - segment) < 2e-5 * (segment + 1e-3));
    }
  }
  fum_cpu_limit(FUM_CPU_AVX512);
}

/* Tails must not cancel: a thick particle six sigmas behind the end of a segment. */
static void test_tails_keep_their_relative_precision(void **state) {
  (void)state;
  for (int level = 0; select_level(level); level++) {
    arrays a = {0};
    for (int i = 0; i < COUNT; i++)
      a.inverse_sigmas[i] = 1.0F;
    a.x[0] = 7.0F;
    a.optical_depths[0] = 1e6F;
    const fum_sources sources = {FUM_PAIRS_PAD, a.x, a.y, a.z, a.inverse_sigmas, a.optical_depths};
    const fum_segment before = {{0}, {1.0F, 0.0F, 0.0F}, 1.0F}, behind = {{0}, {-1.0F, 0.0F, 0.0F}, 1.0F};
    const double expected = 1e6 * 0.5 * (erfc(6.0 / sqrt(2.0)) - erfc(7.0 / sqrt(2.0)));
    assert_true(fabs((double)fum_pairs_get()->segment(&sources, &before) / expected - 1.0) < 1e-5);
    const double further = 1e6 * 0.5 * (erfc(7.0 / sqrt(2.0)) - erfc(8.0 / sqrt(2.0)));
    assert_true(fabs((double)fum_pairs_get()->segment(&sources, &behind) / further - 1.0) < 1e-4);
  }
  fum_cpu_limit(FUM_CPU_AVX512);
}

int main(void) {
  const struct CMUnitTest tests[] = {
      cmocka_unit_test(test_loops_agree_with_double_precision),
      cmocka_unit_test(test_tails_keep_their_relative_precision),
  };
  return cmocka_run_group_tests(tests, NULL, NULL);
}
