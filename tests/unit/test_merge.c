/* SPDX-License-Identifier: GPL-3.0-or-later */
#include "support.h"

#include "base/cpu.h"
#include "octree/bunch.h"
#include "octree/merge.h"

typedef struct smoke {
  stage stage;
  fum_octree *octree, *merged;
} smoke;

static smoke smoke_open(const puffs *p, int32_t leaf_size, float error) {
  smoke s = {.stage = stage_open()};
  const fum_octree_options options = {leaf_size, 1.0F, NULL};
  const fum_merge_options merging = {1.0F, 1.0F, error};
  add_puffs(s.stage.scene, p);
  fum_scene_find_origin(s.stage.scene);
  assert_int_equal(fum_octree_build(s.stage.scene, &options, &s.octree), FUM_OK);
  assert_int_equal(fum_octree_merge(s.stage.context, s.octree, &merging, &s.merged), FUM_OK);
  return s;
}

static void smoke_close(smoke *s) {
  fum_octree_destroy(s->stage.context, s->merged);
  fum_octree_destroy(s->stage.context, s->octree);
  stage_close(&s->stage);
}

/* Optical depth of an octree's particles along a line, without ends, in double precision. */
static double line_depth(const fum_octree *octree, const double from[3], const double direction[3]) {
  double depth = 0.0;
  for (int64_t i = 0; i < octree->count; i++) {
    const double d[3] = {(double)octree->x[i] - from[0], (double)octree->y[i] - from[1],
                         (double)octree->z[i] - from[2]};
    const double along = d[0] * direction[0] + d[1] * direction[1] + d[2] * direction[2];
    const double squared = d[0] * d[0] + d[1] * d[1] + d[2] * d[2] - along * along;
    const double inverse = (double)octree->inverse_sigmas[i];
    depth += (double)octree->optical_depths[i] * exp(-0.5 * fmax(squared, 0.0) * inverse * inverse);
  }
  return depth;
}

static void random_line(uint64_t seed, double half_size, double from[3], double direction[3]) {
  double squared = 0.0;
  for (uint64_t axis = 0; axis < 3; axis++) {
    from[axis] = half_size * (2.0 * fum_hash_unit(6 * seed + axis) - 1.0);
    direction[axis] = 2.0 * fum_hash_unit(6 * seed + 3 + axis) - 1.0;
    squared += direction[axis] * direction[axis];
  }
  for (int axis = 0; axis < 3; axis++)
    direction[axis] /= sqrt(squared);
}

static double mass_of(const fum_octree *octree) {
  double mass = 0.0;
  for (int64_t i = 0; i < octree->count; i++)
    mass += (double)octree->optical_depths[i] / pow((double)octree->inverse_sigmas[i], 2.0);
  return mass;
}

/* Every node's particles are its children's, in its box. */
static void check_nodes(const fum_octree *octree) {
  assert_int_equal(octree->nodes[0].begin, 0);
  assert_int_equal(octree->nodes[0].count, octree->count);
  for (int64_t n = 0; n < octree->node_count; n++) {
    const fum_octree_node *node = &octree->nodes[n];
    uint32_t begin = node->begin;
    for (uint32_t c = 0; c < (uint32_t)__builtin_popcount(node->octants); c++) {
      assert_int_equal(octree->nodes[node->children + c].begin, begin);
      begin += octree->nodes[node->children + c].count;
    }
    if (node->children != 0) assert_int_equal(begin, node->begin + node->count);
    for (uint32_t i = node->begin; i < node->begin + node->count; i++) {
      const float at[3] = {octree->x[i], octree->y[i], octree->z[i]};
      for (int axis = 0; axis < 3; axis++) {
        const float slack = 1e-6F;
        assert_true(at[axis] >= node->lower[axis] - slack && at[axis] <= node->upper[axis] + slack);
      }
    }
  }
}

/* Ten thousand at one place are one, whatever the error. */
static void test_coincident_particles_become_one(void **state) {
  (void)state;
  puffs p = puffs_random(10000, 1, 0.0F, 1.0F, 1.0F);
  for (int64_t i = 0; i < p.count; i++) {
    p.radii[i] = 0.5F;
    p.densities[i] = 0.01F;
  }
  smoke s = smoke_open(&p, 64, 1e-9F);
  assert_non_null(s.merged);
  assert_int_equal(s.merged->count, 1);
  assert_true(fabs((double)s.merged->optical_depths[0] / (100.0 * 0.25 * 2.50662827) - 1.0) < 1e-6);
  check_nodes(s.merged);
  smoke_close(&s);
  puffs_free(&p);
}

static void test_scattered_particles_stay(void **state) {
  (void)state;
  puffs p = puffs_random(5000, 2, 1.0F, 0.1F, 1.0F); /* n sigma^3 = 0.08 */
  smoke s = smoke_open(&p, 64, 1e-3F);
  assert_null(s.merged);
  smoke_close(&s);
  puffs_free(&p);
}

/* Smoke in which thousands overlap: a tenth is left where all have one radius. What many bunches on a line are wrong by
 * cancels more than it adds up. */
static void test_overlapping_particles_merge(void **state) {
  (void)state;
  const float error = 2.5e-4F;
  for (int mixed = 0; mixed < 2; mixed++) {
    puffs p = puffs_random(20000, 3, 1.0F, 1.0F, 0.001F);
    for (int64_t i = 0; i < p.count && !mixed; i++)
      p.radii[i] = 1.0F;
    smoke s = smoke_open(&p, 64, error);
    assert_non_null(s.merged);
    if (!mixed) assert_true(s.merged->count < s.octree->count / 10);
    assert_true(fabs(mass_of(s.merged) / mass_of(s.octree) - 1.0) < 1e-6);
    check_nodes(s.merged);
    for (uint64_t trial = 0; trial < 200; trial++) {
      double from[3], direction[3];
      random_line(trial, 1.5, from, direction);
      const double exact = line_depth(s.octree, from, direction), found = line_depth(s.merged, from, direction);
      assert_true(fabs(exp(-exact) - exp(-found)) < 4.0 * (double)error);
    }
    smoke_close(&s);
    puffs_free(&p);
  }
}

/* A bunch by itself keeps the bound on every line, be it made of a few like or unlike particles, thin or dense ones. */
static void test_a_bunch_keeps_its_error(void **state) {
  (void)state;
  int merged = 0;
  for (uint64_t trial = 0; trial < 1000; trial++) {
    const float error = 1e-3F, spread = expf(uniform(7 * trial, -7.0F, 0.0F));
    puffs p = puffs_random(2 + (int64_t)(trial % 7) * (int64_t)(trial % 7), trial, spread, 1.0F,
                           expf(uniform(7 * trial + 1, -7.0F, 3.0F)));
    for (int64_t i = 0; i < p.count; i++) {
      if (trial % 3 == 0) p.radii[i] = 1.0F;
      if (trial % 3 == 1 && i % 2 == 0) p.radii[i] *= 0.1F;
      if (trial % 5 == 0 && i % 3 == 0) p.densities[i] *= 1e3F;
    }
    smoke s = smoke_open(&p, 64, error);
    if (s.merged != NULL && s.merged->count == 1) {
      merged++;
      for (uint64_t n = 0; n < 200; n++) {
        double from[3], direction[3];
        random_line(1000 * trial + n, n % 2 == 0 ? 1.0 : 0.1, from, direction);
        const double difference = line_depth(s.octree, from, direction) - line_depth(s.merged, from, direction);
        if (fabs(difference) > 1.01 * (double)error + 1e-6 * line_depth(s.octree, from, direction))
          fail_msg("trial %d: %g", (int)trial, difference);
      }
    }
    smoke_close(&s);
    puffs_free(&p);
  }
  assert_true(merged > 50);
}

/* A wider look at the particles needs fewer of them, a denser one more. */
static void test_scales_count(void **state) {
  (void)state;
  puffs p = puffs_random(20000, 4, 1.0F, 0.5F, 0.001F);
  for (int64_t i = 0; i < p.count; i++)
    p.radii[i] = 0.5F;
  smoke s = smoke_open(&p, 64, 1e-3F);
  const fum_merge_options wide = {2.0F, 2.0F, 1e-3F}, dense = {1.0F, 5.0F, 1e-3F};
  fum_octree *wider = NULL, *denser = NULL;
  assert_int_equal(fum_octree_merge(s.stage.context, s.octree, &wide, &wider), FUM_OK);
  assert_int_equal(fum_octree_merge(s.stage.context, s.octree, &dense, &denser), FUM_OK);
  assert_true(s.merged != NULL && wider != NULL && denser != NULL);
  assert_true(wider->count < s.merged->count && s.merged->count < denser->count);
  assert_true(fabs(mass_of(wider) / mass_of(s.octree) - 1.0) < 1e-6);
  fum_octree_destroy(s.stage.context, wider);
  fum_octree_destroy(s.stage.context, denser);
  smoke_close(&s);
  puffs_free(&p);
}

/* Root mean square of what optical depths on lines are off by, over that of the depths. */
static double relative_error(const fum_octree *octree, const fum_octree *other) {
  double errors = 0.0, depths = 0.0;
  for (uint64_t trial = 0; trial < 200; trial++) {
    double from[3], direction[3];
    random_line(trial, 0.7, from, direction);
    const double exact = line_depth(octree, from, direction), found = line_depth(other, from, direction);
    errors += (found - exact) * (found - exact);
    depths += exact * exact;
  }
  return sqrt(errors / depths);
}

/* Where the mass is: the sum of mass times place. */
static double moment_of(const fum_octree *octree, const float *places) {
  double moment = 0.0;
  for (int64_t i = 0; i < octree->count; i++)
    moment += (double)(octree->optical_depths[i] * places[i]) / pow((double)octree->inverse_sigmas[i], 2.0);
  return moment;
}

/* Each particle is a member of one bunch, which has the index of one of them. */
static void check_members(const fum_octree *octree, const fum_octree *bunched) {
  int64_t members = 0;
  for (int64_t i = 0; i < bunched->count; i++) {
    members += bunched->members[i];
    assert_true(bunched->members[i] > 0 && bunched->indices[i] < octree->count);
    for (int64_t k = 0; k < i && k < 10; k++)
      assert_true(bunched->indices[i] != bunched->indices[k]);
  }
  assert_int_equal(members, octree->count);
}

/* Dense smoke in bunches: a few times fewer particles, the same mass around the same place, and depths on lines that
 * are off by less in smaller cells. */
static void test_bunches(void **state) {
  (void)state;
  puffs p = puffs_random(20000, 5, 1.0F, 0.1F, 1.0F);
  for (int64_t i = 0; i < p.count; i++)
    p.radii[i] = 0.14F + 0.02F * (float)(i % 2); /* n sigma^3 = 1 */
  smoke s = smoke_open(&p, 64, 1e-6F);
  const struct {
    float side;
    int fewer;
    double most;
  } cases[] = {{2.0F, 2, 0.01}, {3.0F, 4, 0.03}};
  for (size_t k = 0; k < sizeof cases / sizeof *cases; k++) {
    const fum_bunch_options options = {
        .sigma_scale = 1.0F, .side = cases[k].side, .most_left = 0.5F, .keeps_members = true};
    fum_octree *bunched = NULL;
    assert_int_equal(fum_octree_bunch(s.stage.context, s.octree, &options, &bunched), FUM_OK);
    assert_non_null(bunched);
    if (bunched->count > s.octree->count / cases[k].fewer)
      fail_msg("side %g: %d left", (double)cases[k].side, (int)bunched->count);
    assert_true(fabs(mass_of(bunched) / mass_of(s.octree) - 1.0) < 1e-5);
    assert_true(fabs(moment_of(bunched, bunched->z) - moment_of(s.octree, s.octree->z)) < 1e-5 * mass_of(s.octree));
    check_nodes(bunched);
    check_members(s.octree, bunched);
    const double error = relative_error(s.octree, bunched);
    if (!(error < cases[k].most)) fail_msg("side %g: off by %.3g %%", (double)cases[k].side, 100.0 * error);
    const float left = (float)bunched->count / (float)s.octree->count;
    fum_octree_destroy(s.stage.context, bunched);
    const fum_bunch_options stricter = {.sigma_scale = 1.0F, .side = cases[k].side, .most_left = 0.99F * left};
    assert_int_equal(fum_octree_bunch(s.stage.context, s.octree, &stricter, &bunched), FUM_OK);
    assert_null(bunched);
  }
  smoke_close(&s);
  puffs_free(&p);
}

static void check_close(int64_t count, const float *values, const float *others, float slack) {
  for (int64_t i = 0; i < count; i++)
    assert_true(fabsf(values[i] - others[i]) <= slack);
}

/* All make the same bunches, but for rounding; and of many more particles than vectors hold. */
static void test_instruction_sets_agree(void **state) {
  (void)state;
  puffs p = puffs_random(20000, 8, 1.0F, 0.1F, 1.0F);
  smoke s = smoke_open(&p, 64, 1e-6F);
  const fum_bunch_options options = {.sigma_scale = 1.0F, .side = 2.5F, .most_left = 0.9F, .keeps_members = true};
  fum_octree *plain = NULL, *other = NULL;
  fum_cpu_limit(FUM_CPU_PLAIN);
  assert_int_equal(fum_octree_bunch(s.stage.context, s.octree, &options, &plain), FUM_OK);
  assert_non_null(plain);
  for (int level = 1; level <= (int)FUM_CPU_AVX512; level++) {
    fum_cpu_limit((fum_cpu_level)level);
    assert_int_equal(fum_octree_bunch(s.stage.context, s.octree, &options, &other), FUM_OK);
    assert_int_equal(other->count, plain->count);
    assert_memory_equal(other->members, plain->members, (size_t)plain->count * sizeof *plain->members);
    assert_memory_equal(other->indices, plain->indices, (size_t)plain->count * sizeof *plain->indices);
    check_close(plain->count, plain->x, other->x, 1e-5F);
    check_close(plain->count, plain->y, other->y, 1e-5F);
    check_close(plain->count, plain->z, other->z, 1e-5F);
    check_close(plain->count, plain->inverse_sigmas, other->inverse_sigmas, 1e-3F);
    check_close(plain->count, plain->optical_depths, other->optical_depths, 1e-4F);
    check_close(FUM_STRETCHES * (plain->count + FUM_OCTREE_PAD), plain->stretches, other->stretches, 1e-6F);
    fum_octree_destroy(s.stage.context, other);
  }
  fum_cpu_limit(FUM_CPU_AVX512);
  fum_octree_destroy(s.stage.context, plain);
  smoke_close(&s);
  puffs_free(&p);
}

/* What is far apart is left alone; thousands at one place, some of them without any density, are one. */
static void test_bunches_of_one_place_and_of_many(void **state) {
  (void)state;
  puffs sparse = puffs_random(200, 6, 1.0F, 0.02F, 1.0F), heap = puffs_random(5000, 7, 0.0F, 0.1F, 1.0F);
  const fum_bunch_options rough = {.sigma_scale = 1.0F, .side = 2.5F, .most_left = 0.5F};
  fum_octree *bunched = NULL;
  smoke s = smoke_open(&sparse, 64, 1e-6F);
  assert_int_equal(fum_octree_bunch(s.stage.context, s.octree, &rough, &bunched), FUM_OK);
  assert_null(bunched);
  smoke_close(&s);
  for (int64_t i = 0; i < heap.count; i++) {
    heap.radii[i] = 0.5F;
    heap.densities[i] = i % 2 == 0 ? 0.0F : 0.01F;
  }
  s = smoke_open(&heap, 64, 1e-9F);
  assert_int_equal(fum_octree_bunch(s.stage.context, s.octree, &rough, &bunched), FUM_OK);
  assert_non_null(bunched);
  assert_int_equal(bunched->count, 1);
  assert_true(fabs(mass_of(bunched) / mass_of(s.octree) - 1.0) < 1e-5);
  assert_true(fabs((double)bunched->inverse_sigmas[0] - 4.0) < 1e-4);
  fum_octree_destroy(s.stage.context, bunched);
  smoke_close(&s);
  puffs_free(&sparse);
  puffs_free(&heap);
}

int main(void) {
  const struct CMUnitTest tests[] = {
      cmocka_unit_test(test_coincident_particles_become_one),
      cmocka_unit_test(test_scattered_particles_stay),
      cmocka_unit_test(test_overlapping_particles_merge),
      cmocka_unit_test(test_a_bunch_keeps_its_error),
      cmocka_unit_test(test_scales_count),
      cmocka_unit_test(test_bunches),
      cmocka_unit_test(test_instruction_sets_agree),
      cmocka_unit_test(test_bunches_of_one_place_and_of_many),
  };
  return cmocka_run_group_tests(tests, NULL, NULL);
}
