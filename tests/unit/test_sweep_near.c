/* SPDX-License-Identifier: GPL-3.0-or-later */
/* The sweep for lights amid smoke and close to it, against double-precision brute force. */
#include "support.h"

#include "base/cpu.h"
#include "lighting/solver.h"
#include "lighting/sweep_near.h"
#include "octree/pick.h"

enum { CHECKED = 100 };

/* A cloud, and receivers of which the first CHECKED are compared. */
typedef struct setup {
  stage s;
  puffs p;
  fum_octree *octree, *points;
  fum_medium medium;
  fum_receivers receivers;
  int64_t count;
  float *positions; /* [3 count] local */
  uint8_t *is_lit;  /* [count] */
  float *depths;    /* [count] in the order of the points' octree */
} setup;

/* Receivers fill a box a bit larger than the cloud; every fourth is close to `light`, the first one is there. */
static void place_receivers(setup *t, const double light[3]) {
  for (int64_t i = 0; i < t->count; i++) {
    const float box = i % 4 == 0 ? 0.2F : 1.2F;
    for (int axis = 0; axis < 3; axis++) {
      const double middle = i % 4 == 0 ? light[axis] : 0.0;
      const float offset = i == 0 ? 0.0F : uniform(fum_hash64((uint64_t)(3 * i + axis)), -box, box);
      t->positions[3 * i + axis] = (float)(middle + (double)offset - t->s.scene->origin[axis]);
    }
  }
}

static setup *open_setup(puffs p, int64_t count, const double light[3]) {
  setup *t = calloc(1, sizeof *t);
  assert_non_null(t);
  const fum_octree_options options = {64, 1.0F, NULL};
  t->s = stage_open();
  t->p = p;
  t->count = count;
  add_puffs(t->s.scene, &t->p);
  fum_scene_find_origin(t->s.scene);
  assert_int_equal(fum_octree_build(t->s.scene, &options, &t->octree), FUM_OK);
  t->medium = (fum_medium){.octree = t->octree, .sigma_scale = 1.0F, .depth_scale = 1.0F, .depth_limit = 20.0F};
  assert_int_equal(fum_medium_begin(t->s.context, 1e-4F, &t->medium), FUM_OK);
  t->positions = malloc((size_t)count * 3 * sizeof(float));
  t->is_lit = malloc((size_t)count);
  t->depths = malloc((size_t)count * sizeof(float));
  assert_true(t->positions != NULL && t->is_lit != NULL && t->depths != NULL);
  memset(t->is_lit, 1, (size_t)count);
  place_receivers(t, light);
  assert_int_equal(
      fum_octree_build_points(t->s.context, t->s.scene->origin, count, t->positions, FUM_GROUP_SIZE, &t->points),
      FUM_OK);
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
  free(t->positions);
  free(t->is_lit);
  free(t->depths);
  free(t);
}

static fum_emitter point_light(const setup *t, const double at[3]) {
  const double *o = t->s.scene->origin;
  return (fum_emitter){.position = {(float)(at[0] - o[0]), (float)(at[1] - o[1]), (float)(at[2] - o[2])}};
}

static bool solve(setup *t, const fum_emitter *light, double affordable_us) {
  const fum_sweep_task task = {&t->medium, &t->receivers, light, t->is_lit, affordable_us};
  bool is_solved = false;
  assert_int_equal(fum_sweep_solve(t->s.context, &task, (float[2]){0.0F, 1.0F}, t->depths, &is_solved), FUM_OK);
  return is_solved;
}

/* Are there receivers that need directions, and others that are found one by one? */
static void plan(setup *t, const fum_emitter *light, bool *out_has_directions, bool *out_has_exact) {
  const fum_sweep_task task = {&t->medium, &t->receivers, light, t->is_lit, INFINITY};
  fum_sweep_view view = {0};
  fum_sweep_near near = {0};
  bool is_clear;
  assert_int_equal(fum_sweep_view_find(t->s.context, &t->medium, light, &view, &is_clear), FUM_OK);
  assert_int_equal(fum_sweep_near_plan(t->s.context, &task, &view, &near), FUM_OK);
  assert_true(is_clear && view.vicinity.count > 0);
  *out_has_directions = near.side > 0;
  *out_has_exact = false;
  for (int64_t i = 0; i < t->count; i++)
    *out_has_exact = *out_has_exact || near.is_exact[i] != 0;
  fum_sweep_near_free(t->s.context, &near);
  fum_sweep_view_free(t->s.context, &view);
}

/* Compares the light at the first receivers. */
static void compare(setup *t, const char *what, const fum_emitter *light, double rms, double worst) {
  double squares = 0.0, found_worst = 0.0, from[3], to[3];
  const float at[3] = {light->position.x, light->position.y, light->position.z};
  for (int64_t n = 0; n < t->count; n++) {
    const int64_t i = (int64_t)t->points->indices[n];
    if (i >= CHECKED) continue;
    for (int axis = 0; axis < 3; axis++) {
      from[axis] = (double)t->positions[3 * i + axis] + t->s.scene->origin[axis];
      to[axis] = (double)at[axis] + t->s.scene->origin[axis];
    }
    const double error = exp(-(double)t->depths[n]) - exp(-brute_depth(&t->p, from, to));
    squares += error * error;
    found_worst = fmax(found_worst, fabs(error));
  }
  const double found = sqrt(squares / CHECKED);
  if (!(found <= rms && found_worst <= worst)) fail_msg("%s: RMS %.2g, worst %.2g", what, found, found_worst);
}

/* Depth of about 4 across the cloud, n sigma^3 = 0.5. */
static puffs cloud(int64_t count, uint64_t seed) {
  const float sigma = cbrtf(4.0F / (float)count);
  return puffs_random(count, seed, 1.0F, 2.0F * sigma, 0.25F);
}

static const double PLACES[4][3] = {{0.02, -0.01, 0.03}, {1.0, 0.1, -0.2}, {1.0, 1.0, 1.0}, {0.3, -1.05, 0.2}};
static const char *const NAMES[4] = {"in the middle", "at the rim", "at a corner", "a hair outside"};

/* Fewer receivers than directions: all see the vicinity exactly. */
static void test_few_receivers(void **state) {
  (void)state;
  for (int k = 0; k < 4; k++) {
    setup *t = open_setup(cloud(20000, 1), 1000, PLACES[k]);
    const fum_emitter light = point_light(t, PLACES[k]);
    bool has_directions, has_exact;
    plan(t, &light, &has_directions, &has_exact);
    assert_true(!has_directions && has_exact);
    assert_true(solve(t, &light, INFINITY));
    compare(t, NAMES[k], &light, 1.5e-3, 0.01);
    close_setup(t);
  }
}

/* Those behind the vicinity see it by directions, those in it exactly. */
static void test_many_receivers(void **state) {
  (void)state;
  for (int k = 0; k < 4; k++) {
    setup *t = open_setup(cloud(60000, 2), 120000, PLACES[k]);
    const fum_emitter light = point_light(t, PLACES[k]);
    bool has_directions, has_exact;
    plan(t, &light, &has_directions, &has_exact);
    assert_true(has_directions && has_exact);
    assert_true(solve(t, &light, INFINITY));
    compare(t, NAMES[k], &light, 1.5e-3, 0.01);
    close_setup(t);
  }
}

/* A light in the middle of a particle, of the cloud or so large that most receivers are in it. */
static void test_light_inside_a_particle(void **state) {
  (void)state;
  for (int k = 0; k < 3; k++) {
    puffs p = cloud(50000, 3);
    double at[3];
    for (int axis = 0; axis < 3; axis++)
      at[axis] = (double)p.positions[axis] + (k == 1 ? 0.05 : 0.0);
    if (k > 0) {
      p.radii[0] = 0.6F;
      p.densities[0] = 3.0F;
    }
    setup *t = open_setup(p, 120000, at);
    const fum_emitter light = point_light(t, at);
    assert_true(solve(t, &light, INFINITY));
    compare(t,
            k == 0   ? "at a centre"
            : k == 1 ? "inside a large one"
                     : "at a large one's centre",
            &light, 1.5e-3, 0.01);
    close_setup(t);
  }
}

/* The light is where the middle of the casters is, so that none of its views has an axis. */
static void test_light_in_the_very_middle(void **state) {
  (void)state;
  puffs p = cloud(20000, 4);
  for (int64_t i = 0; i < p.count; i += 2) { /* in pairs around it */
    for (int axis = 0; axis < 3; axis++)
      p.positions[3 * (i + 1) + axis] = -p.positions[3 * i + axis];
  }
  const double middle[3] = {0.0, 0.0, 0.0};
  setup *t = open_setup(p, 1000, middle);
  const fum_emitter light = point_light(t, middle);
  assert_true(solve(t, &light, INFINITY));
  compare(t, "in the very middle", &light, 1.5e-3, 0.01);
  close_setup(t);
}

/* A small dense cluster near the light, in a wide one: it is near as distances go, but small. */
static void test_small_casters_near_by(void **state) {
  (void)state;
  puffs p = cloud(30000, 5);
  const double at[3] = {0.1, 0.2, -0.1};
  for (int64_t i = 0; i < 3000; i++) {
    for (int axis = 0; axis < 3; axis++)
      p.positions[3 * i + axis] = (float)at[axis] + 0.004F * p.positions[3 * i + axis] + (axis == 0 ? 0.01F : 0.0F);
    p.radii[i] *= 0.005F;
    p.densities[i] *= 30.0F;
  }
  setup *t = open_setup(p, 60000, at);
  const fum_emitter light = point_light(t, at);
  assert_true(solve(t, &light, INFINITY));
  compare(t, "cluster near by", &light, 2e-3, 0.015);
  close_setup(t);
}

/* A medium's bunches take its particles' place, and stay its own: there may be another light. */
static void test_bunched_casters(void **state) {
  (void)state;
  setup *t = open_setup(cloud(60000, 9), 1000, PLACES[0]);
  const fum_emitter light = point_light(t, PLACES[0]);
  fum_solver solver = {.wanted = FUM_SOLVER_SWEEP, .tolerance = 0.03F};
  for (int k = 0; k < 2; k++) {
    assert_int_equal(fum_solver_solve(t->s.context, &solver, &t->medium, &t->receivers, &light, t->is_lit,
                                      (float[2]){0.0F, 1.0F}, t->depths),
                     FUM_OK);
    assert_true(solver.has_bunched && solver.sweep_count == k + 1);
    compare(t, "bunched", &light, 7.5e-3, 0.03);
  }
  close_setup(t);
}

/* Few particles are near the light all of them; and what may take no time isn't begun. */
static void test_refuses_what_takes_longer(void **state) {
  (void)state;
  const double *at = PLACES[0];
  setup *t = open_setup(cloud(2000, 6), 1000, at);
  fum_emitter light = point_light(t, at);
  assert_false(solve(t, &light, INFINITY));
  close_setup(t);
  t = open_setup(cloud(20000, 6), 1000, at);
  light = point_light(t, at);
  t->depths[0] = -1.0F;
  assert_false(solve(t, &light, 1.0));
  assert_true(t->depths[0] == -1.0F);
  assert_true(solve(t, &light, 1e9));
  close_setup(t);
}

/* Fine grids for the smallest of particles that are very unlike take longer than an exact solution. */
static void test_refuses_grids_for_small_casters(void **state) {
  (void)state;
  const double at[3] = {5.0, 1.0, 2.0};
  for (int k = 0; k < 2; k++) {
    puffs p = cloud(100000, 10);
    for (int64_t i = 0; i < p.count && k == 1; i++)
      p.radii[i] *= powf(64.0F, -uniform(fum_hash64((uint64_t)i), 0.0F, 1.0F));
    setup *t = open_setup(p, 400000, at);
    const fum_emitter light = point_light(t, at);
    assert_true(solve(t, &light, fum_exact_predict_us(p.count, t->count)) == (k == 0));
    close_setup(t);
  }
}

/* Receivers that aren't lit keep what they have. */
static void test_only_lit_receivers(void **state) {
  (void)state;
  setup *t = open_setup(cloud(100000, 7), 200000, PLACES[0]);
  const fum_emitter light = point_light(t, PLACES[0]);
  for (int64_t i = 0; i < t->count; i++) {
    t->is_lit[i] = i % 3 != 0;
    t->depths[i] = -1.0F;
  }
  assert_true(solve(t, &light, INFINITY));
  for (int64_t i = 0; i < t->count; i++)
    assert_true(t->is_lit[i] ? t->depths[i] > -1e-6F : t->depths[i] == -1.0F);
  close_setup(t);
}

static void test_threads_change_no_bit(void **state) {
  (void)state;
  setup *t = open_setup(cloud(60000, 8), 120000, PLACES[0]);
  const fum_emitter light = point_light(t, PLACES[0]);
  const size_t bytes = (size_t)t->count * sizeof(float);
  float *one = malloc(bytes);
  assert_non_null(one);
  assert_int_equal(fum_context_set_threads(t->s.context, 1), FUM_OK);
  assert_true(solve(t, &light, INFINITY));
  memcpy(one, t->depths, bytes);
  for (int32_t threads = 2; threads <= 3; threads++) {
    assert_int_equal(fum_context_set_threads(t->s.context, threads), FUM_OK);
    assert_true(solve(t, &light, INFINITY));
    assert_memory_equal(one, t->depths, bytes);
  }
  free(one);
  close_setup(t);
}

static void test_instruction_sets_agree(void **state) {
  (void)state;
  setup *t = open_setup(cloud(60000, 9), 120000, PLACES[0]);
  const fum_emitter light = point_light(t, PLACES[0]);
  float *plain = malloc((size_t)t->count * sizeof *plain);
  assert_non_null(plain);
  fum_cpu_limit(FUM_CPU_PLAIN);
  assert_true(solve(t, &light, INFINITY));
  memcpy(plain, t->depths, (size_t)t->count * sizeof *plain);
  for (int level = 1; level <= (int)FUM_CPU_AVX512; level++) {
    fum_cpu_limit((fum_cpu_level)level);
    assert_true(solve(t, &light, INFINITY));
    for (int64_t n = 0; n < t->count; n++)
      assert_true(fabsf(t->depths[n] - plain[n]) < 3e-4F * plain[n] + 2e-5F);
  }
  fum_cpu_limit(FUM_CPU_AVX512);
  free(plain);
  close_setup(t);
}

/* A third of the particles: their values, and nodes that hold them and have their boxes. */
static void test_picking(void **state) {
  (void)state;
  setup *t = open_setup(cloud(5000, 10), 1, PLACES[0]);
  uint8_t is_picked[5000];
  fum_octree *picked = NULL;
  for (int64_t i = 0; i < t->octree->count; i++)
    is_picked[i] = t->octree->x[i] < -0.3F;
  assert_int_equal(fum_octree_pick(t->s.context, t->octree, is_picked, &picked), FUM_OK);
  int64_t n = 0;
  for (int64_t i = 0; i < t->octree->count; i++) {
    if (!is_picked[i]) continue;
    assert_true(picked->x[n] == t->octree->x[i] && picked->inverse_sigmas[n] == t->octree->inverse_sigmas[i]);
    n++;
  }
  assert_true(picked->count == n && picked->nodes[0].count == n && picked->node_count < t->octree->node_count);
  int64_t in_leaves = 0;
  for (int64_t k = 0; k < picked->node_count; k++) {
    const fum_octree_node *node = &picked->nodes[k];
    assert_true(node->count > 0 && (node->octants == 0) == (node->children == 0));
    if (node->children == 0) in_leaves += node->count;
    for (uint32_t i = node->begin; i < node->begin + node->count; i++)
      assert_true(picked->x[i] >= node->lower[0] && picked->x[i] <= node->upper[0]);
    const int children = __builtin_popcount(node->octants);
    uint32_t begin = node->begin;
    for (int c = 0; c < children; c++) {
      assert_true(picked->nodes[node->children + (uint32_t)c].begin == begin);
      begin += picked->nodes[node->children + (uint32_t)c].count;
    }
    assert_true(children == 0 || begin == node->begin + node->count);
  }
  assert_true(in_leaves == n);
  fum_octree_destroy(t->s.context, picked);
  memset(is_picked, 0, sizeof is_picked);
  assert_int_equal(fum_octree_pick(t->s.context, t->octree, is_picked, &picked), FUM_OK);
  assert_true(picked->count == 0 && picked->node_count == 0);
  fum_octree_destroy(t->s.context, picked);
  close_setup(t);
}

int main(void) {
  const struct CMUnitTest tests[] = {
      cmocka_unit_test(test_few_receivers),
      cmocka_unit_test(test_many_receivers),
      cmocka_unit_test(test_light_inside_a_particle),
      cmocka_unit_test(test_light_in_the_very_middle),
      cmocka_unit_test(test_bunched_casters),
      cmocka_unit_test(test_small_casters_near_by),
      cmocka_unit_test(test_refuses_what_takes_longer),
      cmocka_unit_test(test_refuses_grids_for_small_casters),
      cmocka_unit_test(test_only_lit_receivers),
      cmocka_unit_test(test_threads_change_no_bit),
      cmocka_unit_test(test_instruction_sets_agree),
      cmocka_unit_test(test_picking),
  };
  return cmocka_run_group_tests(tests, NULL, NULL);
}
