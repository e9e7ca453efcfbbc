/* SPDX-License-Identifier: GPL-3.0-or-later */
/* The truth that the meter compares with: its functions against libm, its depths against brute force, at each
 * instruction set. */
#include "support.h"

#include "base/cpu.h"
#include "base/simd.h"
#include "lighting/truth.h"

static void test_functions_are_those_of_libm(void **state) {
  (void)state;
  for (int i = 0; i <= 70000; i++) {
    const double x = -0.01 * i, z = 0.0005 * i;
    const double power = fum_vd_exp(fum_vd_set(x))[0], tail = fum_vd_normal_tail(fum_vd_set(z))[0];
    const double expected_power = x < -708.0 ? 0.0 : exp(x), expected_tail = 0.5 * erfc(z * sqrt(0.5));
    if (x < -708.0 ? power != 0.0 : fabs(power - expected_power) > 1e-13 * expected_power)
      fail_msg("exp(%g) is not %.17g", x, power);
    if (fabs(tail - expected_tail) > 1e-12 * expected_tail) fail_msg("tail of %g is not %.17g", z, tail);
  }
  assert_true(fum_vd_exp(fum_vd_set(-INFINITY))[0] == 0.0 && fum_vd_normal_tail(fum_vd_set(INFINITY))[0] == 0.0);
}

/* The levels that this machine runs, each selected in turn. */
static bool select_level(int level) {
  fum_cpu_limit(FUM_CPU_AVX512);
  if (level > (int)fum_cpu()) return false;
  fum_cpu_limit((fum_cpu_level)level);
  return true;
}

typedef struct ray {
  double start[3], direction[3], length;
} ray;

/* Of the particles as the octree holds them: rounded to float. */
static double brute_sum(const fum_octree *o, const ray *r) {
  double sum = 0.0;
  for (int64_t i = 0; i < o->count; i++) {
    const double d[3] = {(double)o->x[i] - r->start[0], (double)o->y[i] - r->start[1], (double)o->z[i] - r->start[2]};
    const double *u = r->direction, inverse = (double)o->inverse_sigmas[i];
    const double t = d[0] * u[0] + d[1] * u[1] + d[2] * u[2];
    double squared = 0.0;
    for (int axis = 0; axis < 3; axis++)
      squared += pow((d[axis] - t * u[axis]) * inverse, 2.0);
    const double a = -t * inverse * sqrt(0.5), b = (r->length - t) * inverse * sqrt(0.5);
    const double share = a > 0.0 ? erfc(a) - erfc(b) : b < 0.0 ? erfc(-b) - erfc(-a) : erf(b) - erf(a);
    sum += (double)o->optical_depths[i] * exp(-0.5 * squared) * 0.5 * share;
  }
  return sum;
}

/* Towards points in and out of the cloud and, every third, a sun. */
static fum_emitter emitter_of(uint64_t seed) {
  const float reach = seed % 2 == 0 ? 1.0F : 5.0F;
  return (fum_emitter){.is_directional = seed % 3 == 0,
                       .position = {uniform(seed, -reach, reach), uniform(seed + 1, -reach, reach), reach},
                       .direction = {0.0F, seed % 6 == 0 ? 0.6F : -0.6F, 0.8F}};
}

static ray ray_to(const fum_emitter *e, const double from[3]) {
  const fum_vec3 d = e->direction, p = e->position;
  ray r = {.length = 0.0};
  const double to[3] = {(double)p.x - from[0], (double)p.y - from[1], (double)p.z - from[2]};
  const double along[3] = {(double)d.x, (double)d.y, (double)d.z}, *v = e->is_directional ? along : to;
  const double length = sqrt(v[0] * v[0] + v[1] * v[1] + v[2] * v[2]);
  for (int axis = 0; axis < 3; axis++) {
    r.start[axis] = from[axis];
    r.direction[axis] = v[axis] / length;
  }
  r.length = e->is_directional ? INFINITY : length;
  return r;
}

static fum_octree *build(const stage *s, const puffs *p, int32_t leaf_size) {
  fum_octree *octree = NULL;
  add_puffs(s->scene, p);
  const fum_octree_options options = {leaf_size, 1.0F, NULL};
  assert_int_equal(fum_octree_build(s->scene, &options, &octree), FUM_OK);
  return octree;
}

/* What is left out is small against `error` of the transmittance; without a cutoff rounding is all that differs. */
static void compare_with_brute_force(const puffs *p, int32_t leaf_size) {
  const double error = 1e-5;
  stage s = stage_open();
  fum_octree *octree = build(&s, p, leaf_size);
  const fum_medium medium = {.octree = octree, .sigma_scale = 1.0F, .depth_scale = 1.0F};
  for (int k = 0; k < 2; k++) {
    fum_truth truth;
    const double cutoff = k == 0 ? 700.0 : fum_truth_cutoff(&medium, error);
    assert_int_equal(fum_truth_begin(s.context, &medium, cutoff, &truth), FUM_OK);
    for (uint64_t trial = 0; trial < 60; trial++) {
      double from[3];
      for (uint64_t axis = 0; axis < 3; axis++)
        from[axis] = trial % 4 == 0 ? (double)p->positions[3 * trial + axis]
                                    : (double)uniform(fum_hash64(trial) + axis, -1.2F, 1.2F);
      const fum_emitter emitter = emitter_of(trial);
      const ray r = ray_to(&emitter, from);
      const double expected = brute_sum(octree, &r);
      for (int level = 0; select_level(level); level++) {
        const double found = fum_truth_depth(&truth, from, &emitter, INFINITY);
        const double allowed = k == 0 ? 1e-12 + 1e-11 * expected : error;
        if (fabs(found - expected) > allowed) fail_msg("level %d: %.15g is not %.15g", level, found, expected);
        const double limit = 0.5 * expected;
        assert_true(fum_truth_depth(&truth, from, &emitter, limit) > limit - allowed);
      }
    }
    fum_truth_end(s.context, &truth);
  }
  fum_octree_destroy(s.context, octree);
  stage_close(&s);
}

static void test_depths_are_brute_force(void **state) {
  (void)state;
  puffs clouds[] = {puffs_random(61, 1, 1.0F, 0.8F, 1.0F), puffs_random(999, 2, 1.0F, 0.05F, 400.0F),
                    puffs_random(5000, 3, 1.0F, 0.2F, 4.0F)};
  for (int i = 0; i < 3; i++) {
    /* Sizes over three orders of magnitude. */
    for (int64_t n = 0; i == 1 && n < clouds[i].count; n += 10)
      clouds[i].radii[n] *= 100.0F;
    compare_with_brute_force(&clouds[i], i == 0 ? 1 : 64);
    compare_with_brute_force(&clouds[i], i == 2 ? 7 : 4096);
    puffs_free(&clouds[i]);
  }
}

int main(void) {
  const struct CMUnitTest tests[] = {
      cmocka_unit_test(test_functions_are_those_of_libm),
      cmocka_unit_test(test_depths_are_brute_force),
  };
  return cmocka_run_group_tests(tests, NULL, NULL);
}
