/* SPDX-License-Identifier: GPL-3.0-or-later */
/* The sweep against double-precision brute force, for lights of every kind and place. */
#include "support.h"

#include "base/cpu.h"
#include "lighting/sweep.h"

enum { POINTS = 600 };

/* A cloud, and receivers: particles' centres, points between them and points outside. */
typedef struct setup {
  stage s;
  puffs p;
  fum_octree *octree, *points;
  fum_medium medium;
  fum_receivers receivers;
  double positions[3 * POINTS];
  float depths[POINTS]; /* in the order of the points' octree */
} setup;

static setup *open_setup(puffs p) {
  setup *t = calloc(1, sizeof *t);
  assert_non_null(t);
  const fum_octree_options options = {64, 1.0F, NULL};
  float positions[3 * POINTS];
  t->s = stage_open();
  t->p = p;
  add_puffs(t->s.scene, &t->p);
  fum_scene_find_origin(t->s.scene);
  assert_int_equal(fum_octree_build(t->s.scene, &options, &t->octree), FUM_OK);
  t->medium = (fum_medium){.octree = t->octree, .sigma_scale = 1.0F, .depth_scale = 1.0F, .depth_limit = 20.0F};
  assert_int_equal(fum_medium_begin(t->s.context, 1e-4F, &t->medium), FUM_OK);
  for (int64_t i = 0; i < 3 * POINTS; i++) {
    const double world = i < POINTS && t->p.count > 0
                             ? (double)t->p.positions[t->p.count > 0 ? i % (3 * t->p.count) : 0]
                             : 1.3 * (double)uniform(fum_hash64((uint64_t)i), -1.0F, 1.0F);
    positions[i] = (float)(world - t->s.scene->origin[i % 3]);
    t->positions[i] = (double)positions[i] + t->s.scene->origin[i % 3];
  }
  assert_int_equal(
      fum_octree_build_points(t->s.context, t->s.scene->origin, POINTS, positions, FUM_GROUP_SIZE, &t->points), FUM_OK);
  t->receivers.octree = t->points;
  return t;
}

static void close_setup(setup *t) {
  fum_receivers_free(t->s.context, &t->receivers);
  fum_medium_end(t->s.context, &t->medium);
  fum_octree_destroy(t->s.context, t->points);
  fum_octree_destroy(t->s.context, t->octree);
  stage_close(&t->s);
  puffs_free(&t->p);
  free(t);
}

static fum_emitter point_light(const setup *t, const double at[3]) {
  const double *o = t->s.scene->origin;
  return (fum_emitter){.position = {(float)(at[0] - o[0]), (float)(at[1] - o[1]), (float)(at[2] - o[2])}};
}

static fum_emitter sun(fum_vec3 towards) {
  return (fum_emitter){.is_directional = true, .direction = fum_scaled(towards, 1.0F / fum_length(towards))};
}

static bool solve(setup *t, const fum_emitter *emitter) {
  uint8_t is_lit[POINTS];
  bool is_solved = false;
  memset(is_lit, 1, sizeof is_lit);
  const fum_sweep_task task = {&t->medium, &t->receivers, emitter, is_lit, INFINITY};
  assert_int_equal(fum_sweep_solve(t->s.context, &task, (float[2]){0.0F, 1.0F}, t->depths, &is_solved), FUM_OK);
  return is_solved;
}

/* RMS error of the transmittance; `out_worst` the largest one. */
static double measure(setup *t, const fum_emitter *emitter, double *out_worst) {
  double squares = 0.0;
  *out_worst = 0.0;
  assert_true(solve(t, emitter));
  for (int64_t n = 0; n < POINTS; n++) {
    const double *from = t->positions + 3 * (int64_t)t->points->indices[n];
    const fum_vec3 p = emitter->position, d = emitter->direction;
    const float way[3] = {emitter->is_directional ? d.x : p.x, emitter->is_directional ? d.y : p.y,
                          emitter->is_directional ? d.z : p.z};
    double to[3];
    for (int axis = 0; axis < 3; axis++)
      to[axis] = emitter->is_directional ? from[axis] + 100.0 * (double)way[axis]
                                         : (double)way[axis] + t->s.scene->origin[axis];
    const double error = exp(-(double)t->depths[n]) - exp(-brute_depth(&t->p, from, to));
    squares += error * error;
    *out_worst = fmax(*out_worst, fabs(error));
  }
  return sqrt(squares / POINTS);
}

static void check(setup *t, const char *what, const fum_emitter *emitter, double rms, double worst) {
  double found_worst;
  const double found = measure(t, emitter, &found_worst);
  if (found > rms || found_worst > worst) fail_msg("%s: RMS %.2g, worst %.2g", what, found, found_worst);
}

/* Depth of about 4 across the cloud, n sigma^3 = 0.5. */
static puffs cloud(int64_t count, uint64_t seed) {
  const float sigma = cbrtf(4.0F / (float)count);
  return puffs_random(count, seed, 1.0F, 2.0F * sigma, 0.25F);
}

static void test_lights_around_a_cloud(void **state) {
  (void)state;
  setup *t = open_setup(cloud(20000, 1));
  const double places[5][3] = {{4, 1, 0.5}, {0.3, -2.5, 0.2}, {1.7, 1.7, 1.7}, {-30, 5, 80}, {2e4, 3e5, -1e4}};
  for (int k = 0; k < 5; k++) {
    const fum_emitter light = point_light(t, places[k]);
    check(t, "point light", &light, 0.004, 0.03);
  }
  const fum_vec3 ways[3] = {{0, 0, 1}, {1, 0, 0}, {-0.3F, 0.5F, 0.8F}};
  for (int k = 0; k < 3; k++) {
    const fum_emitter light = sun(ways[k]);
    check(t, "sun", &light, 0.004, 0.03);
  }
  close_setup(t);
}

/* A light in the middle of a shell of smoke: all sides of the cube. */
/* Particles that are taken together by cells: a few times fewer casters, and errors that stay small. Gaussians that are
 * stretched as the particles lie do better than round ones, unless the particles differ in size. */
static void check_bunches(float smallest, float largest, double most_rms, double gain) {
  puffs p = cloud(40000, 7);
  for (int64_t i = 0; i < p.count; i++)
    p.radii[i] = smallest + (largest - smallest) * (float)(i % 8) / 7.0F;
  setup *t = open_setup(p);
  assert_int_equal(fum_medium_bunch(t->s.context, 1.9F, &t->medium), FUM_OK);
  assert_non_null(t->medium.bunched);
  fum_octree *of_each = t->medium.merged, *bunched = t->medium.bunched;
  const fum_emitter lights[] = {point_light(t, (const double[3]){4, 1, 0.5}),
                                point_light(t, (const double[3]){0.3, -1.9, 0.2}), sun((fum_vec3){0.3F, 0.4F, 0.8F})};
  for (size_t k = 0; k < sizeof lights / sizeof *lights; k++) {
    double worst;
    t->medium.merged = bunched;
    const double stretched = measure(t, &lights[k], &worst);
    float *stretches = bunched->stretches;
    bunched->stretches = NULL;
    const double round = measure(t, &lights[k], &worst);
    bunched->stretches = stretches;
    t->medium.merged = of_each;
    if (stretched > most_rms || round < gain * stretched)
      fail_msg("radii from %g on, light %d: RMS %.2g stretched, %.2g round", (double)smallest, (int)k, stretched,
               round);
  }
  close_setup(t);
}

static void test_bunched_casters(void **state) {
  (void)state;
  check_bunches(0.11F, 0.11F, 4e-3, 1.25); /* n sigma^3 = 0.8 */
  check_bunches(0.08F, 0.15F, 4e-3, 1.0);
}

static void test_light_amid_smoke(void **state) {
  (void)state;
  puffs p = cloud(20000, 2);
  for (int64_t i = 0; i < p.count; i++) {
    float *at = p.positions + 3 * i, length = sqrtf(at[0] * at[0] + at[1] * at[1] + at[2] * at[2]);
    const float stretch = (0.7F + 0.5F * length) / fmaxf(length, 1e-3F);
    p.radii[i] = 0.05F;
    for (int axis = 0; axis < 3; axis++)
      at[axis] *= stretch;
  }
  setup *t = open_setup(p);
  const fum_emitter light = point_light(t, (double[3]){0.02, -0.03, 0.01});
  check(t, "light amid smoke", &light, 0.002, 0.03);
  close_setup(t);
}

static void test_unlike_radii(void **state) {
  (void)state;
  puffs p = cloud(20000, 3);
  for (int64_t i = 0; i < p.count; i++) {
    const float factor = expf(uniform(fum_hash64((uint64_t)i), -2.5F, 1.0F));
    p.radii[i] *= factor;
    p.densities[i] /= factor;
  }
  setup *t = open_setup(p);
  const fum_emitter light = point_light(t, (double[3]){5, 1, 2}), above = sun((fum_vec3){0.1F, 0.2F, 1.0F});
  check(t, "radii 1 to 30, point", &light, 0.004, 0.04);
  check(t, "radii 1 to 30, sun", &above, 0.004, 0.04);
  close_setup(t);
}

/* Few particles are all near a light among them; and there may be no smoke. */
static void test_refuses_what_it_cannot_do(void **state) {
  (void)state;
  setup *t = open_setup(cloud(2000, 4));
  const fum_emitter inside = point_light(t, (double[3]){0.1, 0.2, 0.3});
  assert_false(solve(t, &inside));
  close_setup(t);
  t = open_setup((puffs){.count = 0});
  const fum_emitter light = point_light(t, (double[3]){5, 0, 0});
  assert_false(solve(t, &light));
  close_setup(t);
}

static void test_threads_change_no_bit(void **state) {
  (void)state;
  setup *t = open_setup(cloud(20000, 5));
  const fum_emitter light = point_light(t, (double[3]){3, 1, 1});
  float one[POINTS];
  assert_int_equal(fum_context_set_threads(t->s.context, 1), FUM_OK);
  assert_true(solve(t, &light));
  memcpy(one, t->depths, sizeof one);
  assert_int_equal(fum_context_set_threads(t->s.context, 3), FUM_OK);
  assert_true(solve(t, &light));
  assert_memory_equal(one, t->depths, sizeof one);
  close_setup(t);
}

static void test_instruction_sets_agree(void **state) {
  (void)state;
  setup *t = open_setup(cloud(20000, 6));
  const fum_emitter light = point_light(t, (double[3]){3, 1, 1});
  float plain[POINTS];
  fum_cpu_limit(FUM_CPU_PLAIN);
  assert_true(solve(t, &light));
  memcpy(plain, t->depths, sizeof plain);
  for (int level = 1; level <= (int)FUM_CPU_AVX512; level++) {
    fum_cpu_limit((fum_cpu_level)level);
    assert_true(solve(t, &light));
    for (int n = 0; n < POINTS; n++)
      assert_true(fabsf(t->depths[n] - plain[n]) < 2e-4F * plain[n] + 1e-5F);
  }
  fum_cpu_limit(FUM_CPU_AVX512);
  close_setup(t);
}

/* Receivers that aren't lit keep what they have. */
static void test_only_lit_receivers(void **state) {
  (void)state;
  setup *t = open_setup(cloud(2000, 7));
  const fum_emitter light = point_light(t, (double[3]){6, 1, 1});
  uint8_t is_lit[POINTS];
  bool is_solved;
  for (int n = 0; n < POINTS; n++) {
    is_lit[n] = n % 3 == 0;
    t->depths[n] = -1.0F;
  }
  const fum_sweep_task task = {&t->medium, &t->receivers, &light, is_lit, INFINITY};
  assert_int_equal(fum_sweep_solve(t->s.context, &task, (float[2]){0.0F, 1.0F}, t->depths, &is_solved), FUM_OK);
  assert_true(is_solved);
  for (int n = 0; n < POINTS; n++)
    assert_true(n % 3 == 0 ? t->depths[n] >= 0.0F : t->depths[n] == -1.0F);
  close_setup(t);
}

int main(void) {
  const struct CMUnitTest tests[] = {
      cmocka_unit_test(test_lights_around_a_cloud), cmocka_unit_test(test_light_amid_smoke),
      cmocka_unit_test(test_unlike_radii),          cmocka_unit_test(test_refuses_what_it_cannot_do),
      cmocka_unit_test(test_threads_change_no_bit), cmocka_unit_test(test_instruction_sets_agree),
      cmocka_unit_test(test_only_lit_receivers),    cmocka_unit_test(test_bunched_casters),
  };
  return cmocka_run_group_tests(tests, NULL, NULL);
}
