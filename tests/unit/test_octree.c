/* SPDX-License-Identifier: GPL-3.0-or-later */
#include "support.h"

#include "octree/beam.h"
#include "octree/octree.h"

static fum_octree *build(stage *s, int32_t leaf_size) {
  fum_octree *octree = NULL;
  const fum_octree_options options = {leaf_size, 1.0F, NULL};
  fum_scene_find_origin(s->scene);
  assert_int_equal(fum_octree_build(s->scene, &options, &octree), FUM_OK);
  return octree;
}

/* Every particle is in exactly one leaf, leaves hold no more than the leaf size unless their particles share a cell,
 * parents' ranges are their children's, boxes hold what they should. */
static void check_structure(const fum_octree *octree, int32_t leaf_size, bool may_share_cells) {
  uint8_t *seen = calloc((size_t)octree->count + 1, 1);
  assert_non_null(seen);
  for (int64_t n = 0; n < octree->node_count; n++) {
    const fum_octree_node *node = &octree->nodes[n];
    for (uint32_t i = node->begin; i < node->begin + node->count; i++) {
      const float p[3] = {octree->x[i], octree->y[i], octree->z[i]};
      for (int axis = 0; axis < 3; axis++)
        assert_true(p[axis] >= node->lower[axis] && p[axis] <= node->upper[axis]);
    }
    if (node->children == 0) {
      assert_true(may_share_cells || node->count <= (uint32_t)leaf_size);
      for (uint32_t i = node->begin; i < node->begin + node->count; i++)
        assert_int_equal(seen[i]++, 0);
      continue;
    }
    const int children = __builtin_popcount(node->octants);
    assert_true(children >= 2);
    assert_true(node->count > (uint32_t)leaf_size);
    uint32_t begin = node->begin;
    for (int c = 0; c < children; c++) {
      const fum_octree_node *child = &octree->nodes[node->children + (uint32_t)c];
      assert_int_equal(child->begin, begin);
      begin += child->count;
    }
    assert_int_equal(begin, node->begin + node->count);
  }
  for (int64_t i = 0; i < octree->count; i++)
    assert_int_equal(seen[i], 1);
  free(seen);
}

static void test_structure(void **state) {
  (void)state;
  const int32_t leaf_sizes[] = {1, 7, 64, 100000};
  puffs p = puffs_random(20000, 1, 3.0F, 0.1F, 1.0F);
  stage s = stage_open();
  add_puffs(s.scene, &p);
  for (size_t i = 0; i < sizeof leaf_sizes / sizeof *leaf_sizes; i++) {
    fum_octree *octree = build(&s, leaf_sizes[i]);
    assert_int_equal(octree->count, p.count);
    check_structure(octree, leaf_sizes[i], false);
    uint8_t *seen = calloc((size_t)p.count, 1);
    for (int64_t k = 0; k < p.count; k++)
      assert_int_equal(seen[octree->indices[k]]++, 0);
    free(seen);
    fum_octree_destroy(s.context, octree);
  }
  puffs_free(&p);
  stage_close(&s);
}

static void test_memory_follows_particles_not_space(void **state) {
  (void)state;
  puffs p = puffs_random(2000, 2, 1.0F, 0.1F, 1.0F);
  for (int64_t i = 1000; i < 2000; i++)
    p.positions[3 * i] += 1e6F; /* two clusters, far apart */
  stage s = stage_open();
  add_puffs(s.scene, &p);
  fum_octree *octree = build(&s, 8);
  check_structure(octree, 8, true);
  assert_true(octree->node_count < 2000);
  fum_octree_destroy(s.context, octree);
  puffs_free(&p);
  stage_close(&s);
}

static void test_coincident_particles_end_in_one_leaf(void **state) {
  (void)state;
  puffs p = puffs_random(10000, 3, 1.0F, 0.1F, 1.0F);
  for (int64_t i = 0; i < p.count - 1; i++)
    memcpy(p.positions + 3 * i, (float[3]){0.25F, 0.5F, -0.75F}, 3 * sizeof(float));
  stage s = stage_open();
  add_puffs(s.scene, &p);
  fum_octree *octree = build(&s, 16);
  check_structure(octree, 16, true);
  assert_true(octree->node_count <= 4);
  fum_octree_destroy(s.context, octree);
  puffs_free(&p);
  stage_close(&s);
}

static void test_none_and_one(void **state) {
  (void)state;
  for (int64_t count = 0; count <= 1; count++) {
    puffs p = puffs_random(1, 4, 1.0F, 0.1F, 1.0F);
    p.count = count;
    stage s = stage_open();
    add_puffs(s.scene, &p);
    fum_octree *octree = build(&s, 16);
    assert_int_equal(octree->count, count);
    assert_int_equal(octree->node_count, count);
    fum_octree_destroy(s.context, octree);
    puffs_free(&p);
    stage_close(&s);
  }
}

static void test_reach_is_each_nodes_own(void **state) {
  (void)state;
  puffs p = puffs_random(4096, 5, 10.0F, 1e-3F, 1.0F);
  p.radii[0] = 1e3F; /* a ratio of a million */
  stage s = stage_open();
  add_puffs(s.scene, &p);
  fum_octree *octree = build(&s, 8);
  float *reaches = NULL;
  assert_int_equal(fum_reach_find(s.context, octree, 1e-3F, &reaches), FUM_OK);
  int64_t wide = 0;
  for (int64_t n = 0; n < octree->node_count; n++)
    wide += reaches[n] > 1.0F;
  assert_true(reaches[0] > 1e3F);
  assert_true(wide < 12); /* the large particle's ancestors and no other node */
  fum_free(s.context, &reaches);
  fum_octree_destroy(s.context, octree);
  puffs_free(&p);
  stage_close(&s);
}

/* Which particles a walk hands out. */
typedef struct visits {
  uint8_t seen[5000];
} visits;

static bool note(void *user, const fum_octree_node *node, float reach) {
  (void)reach;
  for (uint32_t i = node->begin; i < node->begin + node->count; i++)
    ((visits *)user)->seen[i] = 1;
  return true;
}

/* Nothing that is heard by any segment of a beam may be missed by its walk. */
static void test_walk_hands_out_all_that_is_heard(void **state) {
  (void)state;
  puffs p = puffs_random(5000, 6, 2.0F, 0.1F, 1.0F);
  stage s = stage_open();
  add_puffs(s.scene, &p);
  fum_octree *octree = build(&s, 8);
  float *reaches = NULL;
  assert_int_equal(fum_reach_find(s.context, octree, 1e-3F, &reaches), FUM_OK);
  int64_t heard = 0;
  for (uint64_t trial = 0; trial < 200; trial++) {
    fum_vec3 axis = {uniform(trial * 9, -1.0F, 1.0F), uniform(trial * 9 + 1, -1.0F, 1.0F),
                     uniform(trial * 9 + 2, -1.0F, 1.0F)};
    axis = fum_scaled(axis, 1.0F / fum_length(axis));
    const fum_vec3 start = {uniform(trial * 9 + 3, -2.0F, 2.0F), uniform(trial * 9 + 4, -2.0F, 2.0F),
                            uniform(trial * 9 + 5, -2.0F, 2.0F)};
    const float length = uniform(trial * 9 + 6, 0.1F, 4.0F), radius = uniform(trial * 9 + 7, 0.0F, 0.3F);
    const fum_beam beam = {start, axis, -radius, length + radius, radius, trial % 2 == 0 ? 0.0F : -radius / length};
    visits v = {0};
    fum_beam_walk(octree, reaches, trial % 3 == 0 ? 20 : 0, &beam, note, &v);
    for (int64_t i = 0; i < octree->count; i++) {
      /* nearest point of the axis segment; the tapered cylinder is around it */
      const fum_vec3 d = fum_sub((fum_vec3){octree->x[i], octree->y[i], octree->z[i]}, start);
      const float t = fminf(fmaxf(fum_dot(d, axis), 0.0F), length);
      const float distance = fum_length(fum_mad(axis, -t, d)), wide = radius + beam.slope * t;
      const float own_reach = fum_cutoff_sigmas(octree->optical_depths[i], 1e-3F) / octree->inverse_sigmas[i];
      if (distance > own_reach + fmaxf(wide, 0.0F)) continue;
      assert_int_equal(v.seen[i], 1);
      heard++;
    }
  }
  assert_true(heard > 3000);
  fum_free(s.context, &reaches);
  fum_octree_destroy(s.context, octree);
  puffs_free(&p);
  stage_close(&s);
}

static void test_subsampling_keeps_the_mean(void **state) {
  (void)state;
  puffs p = puffs_random(100000, 7, 1.0F, 0.1F, 1.0F);
  stage s = stage_open();
  add_puffs(s.scene, &p);
  fum_scene_find_origin(s.scene);
  double full = 0.0;
  for (int64_t i = 0; i < p.count; i++)
    full += (double)p.densities[i] * (double)p.radii[i] * 0.5 * 2.50662827463;
  const float shares[] = {0.5F, 0.1F, 0.01F};
  for (int k = 0; k < 3; k++) {
    fum_octree *octree = NULL, *again = NULL;
    const fum_octree_options options = {64, shares[k], NULL};
    assert_int_equal(fum_octree_build(s.scene, &options, &octree), FUM_OK);
    assert_int_equal(fum_octree_build(s.scene, &options, &again), FUM_OK);
    assert_int_equal(octree->count, again->count);
    assert_memory_equal(octree->indices, again->indices, (size_t)octree->count * sizeof *octree->indices);
    double sum = 0.0;
    for (int64_t i = 0; i < octree->count; i++)
      sum += (double)octree->optical_depths[i];
    /* The standard error of the sum over a random share: about sqrt((1 - share) / (count share)) times 1.2. */
    const double expected = (double)p.count * (double)shares[k];
    assert_true(fabs(sum / full - 1.0) < 4.0 * 1.2 / sqrt(expected));
    fum_octree_destroy(s.context, again);
    fum_octree_destroy(s.context, octree);
  }
  puffs_free(&p);
  stage_close(&s);
}

int main(void) {
  const struct CMUnitTest tests[] = {
      cmocka_unit_test(test_structure),
      cmocka_unit_test(test_memory_follows_particles_not_space),
      cmocka_unit_test(test_coincident_particles_end_in_one_leaf),
      cmocka_unit_test(test_none_and_one),
      cmocka_unit_test(test_reach_is_each_nodes_own),
      cmocka_unit_test(test_walk_hands_out_all_that_is_heard),
      cmocka_unit_test(test_subsampling_keeps_the_mean),
  };
  return cmocka_run_group_tests(tests, NULL, NULL);
}
