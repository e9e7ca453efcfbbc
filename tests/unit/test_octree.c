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

/* Bits of the coordinates in the cube, the highest first. */
static uint64_t code_of(const fum_octree *octree, int64_t i) {
  const fum_octree_node *root = &octree->nodes[0];
  const float p[3] = {octree->x[i], octree->y[i], octree->z[i]};
  double side = 0.0;
  uint64_t code = 0;
  for (int axis = 0; axis < 3; axis++)
    side = fmax(side, (double)root->upper[axis] - (double)root->lower[axis]);
  for (int axis = 0; axis < 3; axis++) {
    const double cell = ((double)p[axis] - (double)root->lower[axis]) * ((double)(1 << 21) / side);
    const uint64_t whole = (uint64_t)fmin(cell, (double)((1 << 21) - 1));
    for (int bit = 0; bit < 21; bit++)
      code |= (whole >> bit & 1) << (3 * bit + axis);
  }
  return code;
}

/* Particles in Morton order, ties as they came, nodes where codes say: evenly spread ones, thousands in one cell of
 * the first few levels and in one of the finest, two sets, a share of them; whatever the number of threads. */
static void test_order_is_that_of_codes(void **state) {
  (void)state;
  puffs p = puffs_random(150000, 8, 1.0F, 0.1F, 1.0F), q = puffs_random(1000, 9, 1.0F, 0.1F, 1.0F);
  for (int64_t i = 0; i < p.count; i++) {
    const float shrink = i % 3 == 0 ? 1.0F : i % 3 == 1 ? 1e-4F : 0.0F;
    for (int axis = 0; axis < 3; axis++)
      p.positions[3 * i + axis] = 0.3F + shrink * (p.positions[3 * i + axis] - 0.3F);
  }
  const float shares[2] = {1.0F, 0.8F};
  for (int k = 0; k < 2; k++) {
    fum_octree *first = NULL;
    stage s = stage_open();
    add_puffs(s.scene, &p);
    add_puffs(s.scene, &q);
    fum_scene_find_origin(s.scene);
    for (int threads = 1; threads <= 3; threads++) {
      const fum_octree_options options = {64, shares[k], NULL};
      fum_octree *octree = NULL;
      assert_int_equal(fum_context_set_threads(s.context, threads), FUM_OK);
      assert_int_equal(fum_octree_build(s.scene, &options, &octree), FUM_OK);
      check_structure(octree, 64, true);
      for (int64_t i = 1; i < octree->count; i++) {
        const uint64_t before = code_of(octree, i - 1), here = code_of(octree, i);
        assert_true(before < here || (before == here && octree->indices[i - 1] < octree->indices[i]));
      }
      for (int64_t i = 0; i < octree->count; i++)
        assert_int_equal(octree->inverse_sigmas[i] > 0.0F, 1);
      if (first == NULL) {
        first = octree;
        continue;
      }
      assert_int_equal(octree->count, first->count);
      assert_int_equal(octree->node_count, first->node_count);
      assert_memory_equal(octree->indices, first->indices, (size_t)first->count * sizeof *first->indices);
      assert_memory_equal(octree->nodes, first->nodes, (size_t)first->node_count * sizeof *first->nodes);
      fum_octree_destroy(s.context, octree);
    }
    fum_octree_destroy(s.context, first);
    stage_close(&s);
  }
  puffs_free(&q);
  puffs_free(&p);
}

/* Each place has what its particle has, of two sets in three and of a share of their particles; whatever the number of
 * threads. Particles are counted past 16384, where they are dealt out by one thread, and past the piles of 32768. */
static void test_places_have_their_particles(void **state) {
  (void)state;
  puffs sets[3] = {puffs_random(70000, 11, 1.0F, 0.1F, 1.0F), puffs_random(300, 12, 1.0F, 0.1F, 1.0F),
                   puffs_random(9001, 13, 1.0F, 0.1F, 1.0F)};
  const bool takes[3] = {true, false, true};
  stage s = stage_open();
  for (int k = 0; k < 3; k++) {
    for (int64_t i = 0; i < sets[k].count; i++)
      sets[k].radii[i] *= 1.0F + (float)(i % 5);
    if (k == 0) memset(sets[k].positions, 0, 3 * 40000 * sizeof(float));
    add_puffs(s.scene, &sets[k]);
  }
  fum_scene_find_origin(s.scene);
  for (int round = 0; round < 6; round++) {
    const double share = round % 2 == 0 ? 1.0 : 0.3F;
    const fum_octree_options options = {64, (float)share, takes};
    fum_octree *octree = NULL;
    assert_int_equal(fum_context_set_threads(s.context, 1 + round / 2), FUM_OK);
    assert_int_equal(fum_octree_build(s.scene, &options, &octree), FUM_OK);
    assert_true(round % 2 == 0 ? octree->count == 79001 : octree->count > 0 && octree->count < 40000);
    uint8_t *seen = calloc(79301, 1);
    for (int64_t i = 0; i < octree->count; i++) {
      assert_int_equal(seen[octree->indices[i]]++, 0);
      const fum_particles *set = fum_scene_particles_of(s.scene, octree->indices[i]);
      const int64_t k = octree->indices[i] - set->offset;
      const float places[3] = {octree->x[i], octree->y[i], octree->z[i]};
      assert_true(set != &s.scene->particles[1]);
      for (int axis = 0; axis < 3; axis++)
        assert_true(places[axis] == (float)((double)set->positions[3 * k + axis] - s.scene->origin[axis]));
      const double sigma = (double)set->sigmas[k], depth = (double)set->densities[k] / share * sigma * FUM_SQRT_2PI;
      assert_true(octree->inverse_sigmas[i] == (float)(1.0 / sigma));
      assert_true(octree->optical_depths[i] == (float)depth);
    }
    free(seen);
    fum_octree_destroy(s.context, octree);
  }
  stage_close(&s);
  for (int k = 0; k < 3; k++)
    puffs_free(&sets[k]);
}

/* A point, and the code of its cell. */
typedef struct key {
  uint64_t code;
  uint32_t index;
} key;

static int compare_keys(const void *a, const void *b) {
  const key *p = a, *q = b;
  if (p->code != q->code) return p->code < q->code ? -1 : 1;
  return (p->index > q->index) - (p->index < q->index);
}

/* The order of points, one by one. What isn't a number is in the last cell. */
static void sort_by_hand(int64_t count, const float *points, key *out) {
  float lower[3] = {INFINITY, INFINITY, INFINITY};
  double side = 0.0;
  for (int axis = 0; axis < 3; axis++) {
    float upper = -INFINITY;
    for (int64_t i = 0; i < count; i++) {
      lower[axis] = fminf(lower[axis], points[3 * i + axis]);
      upper = fmaxf(upper, points[3 * i + axis]);
    }
    side = fmax(side, (double)upper - (double)lower[axis]);
  }
  for (int64_t i = 0; i < count; i++) {
    out[i] = (key){0, (uint32_t)i};
    for (int axis = 0; axis < 3; axis++) {
      const double per_metre = side > 0.0 ? 2097152.0 / side : 0.0;
      const double cell = ((double)points[3 * i + axis] - (double)lower[axis]) * per_metre;
      const uint64_t whole = cell < 2097151.0 ? (uint64_t)cell : 2097151;
      for (int bit = 0; bit < 21; bit++)
        out[i].code |= (whole >> bit & 1) << (3 * bit + axis);
    }
  }
  qsort(out, (size_t)count, sizeof *out, compare_keys);
}

/* Points in a cube, around a speck of it, on each other, not numbers, infinite, all in one place; few and many. */
static void test_points_are_sorted_as_by_hand(void **state) {
  (void)state;
  const int64_t counts[] = {3, 255, 257, 5000, 16400, 120000};
  stage s = stage_open();
  for (int k = 0; k < 5 * 6; k++) {
    const int kind = k % 5;
    const int64_t count = counts[k / 5];
    float *points = malloc(3 * (size_t)count * sizeof *points);
    key *keys = malloc((size_t)count * sizeof *keys);
    for (int64_t i = 0; i < 3 * count; i++) {
      points[i] = uniform((uint64_t)(3 * i + k), -1.0F, 1.0F);
      if (kind == 1 && i / 3 % 4 != 0) points[i] = 0.25F + 1e-5F * points[i];
      if (kind == 2 && i % 11 == 0) points[i] = NAN;
      if (kind == 3 && i % 1001 == 0) points[i] = i % 2 == 0 ? INFINITY : -1e38F;
      if (kind == 4) points[i] = 0.5F;
    }
    if (kind == 2 && count > 100) memset(points, 0, (size_t)count * sizeof *points);
    sort_by_hand(count, points, keys);
    for (int threads = 1; threads <= 3; threads++) {
      fum_octree *octree = NULL;
      assert_int_equal(fum_context_set_threads(s.context, threads), FUM_OK);
      assert_int_equal(fum_octree_build_points(s.context, (double[3]){0.0}, count, points, 64, &octree), FUM_OK);
      assert_int_equal(octree->count, count);
      for (int64_t i = 0; i < count; i++) {
        const float place[3] = {octree->x[i], octree->y[i], octree->z[i]};
        assert_int_equal(octree->indices[i], keys[i].index);
        assert_memory_equal(place, points + 3 * (size_t)octree->indices[i], sizeof place);
      }
      fum_octree_destroy(s.context, octree);
    }
    free(keys);
    free(points);
  }
  stage_close(&s);
}

/* A node's particles share its cell; its children are the octants of the largest cell that parts them. */
static void test_nodes_are_cells(void **state) {
  (void)state;
  puffs p = puffs_random(60000, 10, 1.0F, 0.1F, 1.0F);
  for (int64_t i = 0; i < 30000; i++)
    p.positions[3 * i] *= 1e-3F;
  stage s = stage_open();
  add_puffs(s.scene, &p);
  fum_octree *octree = build(&s, 5);
  for (int64_t n = 0; n < octree->node_count; n++) {
    const fum_octree_node *node = &octree->nodes[n];
    const uint64_t first = code_of(octree, node->begin), last = code_of(octree, node->begin + node->count - 1);
    if (node->children == 0) continue;
    const int level = (63 - __builtin_clzll(first ^ last)) / 3, children = __builtin_popcount(node->octants);
    uint8_t octants = 0;
    for (int c = 0; c < children; c++) {
      const fum_octree_node *child = &octree->nodes[node->children + (uint32_t)c];
      const uint64_t a = code_of(octree, child->begin), b = code_of(octree, child->begin + child->count - 1);
      assert_true(a >> (3 * level) == b >> (3 * level));
      octants |= (uint8_t)(1 << (a >> (3 * level) & 7));
    }
    assert_int_equal(octants, node->octants);
  }
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
      cmocka_unit_test(test_order_is_that_of_codes),
      cmocka_unit_test(test_places_have_their_particles),
      cmocka_unit_test(test_points_are_sorted_as_by_hand),
      cmocka_unit_test(test_nodes_are_cells),
      cmocka_unit_test(test_none_and_one),
      cmocka_unit_test(test_reach_is_each_nodes_own),
      cmocka_unit_test(test_walk_hands_out_all_that_is_heard),
      cmocka_unit_test(test_subsampling_keeps_the_mean),
  };
  return cmocka_run_group_tests(tests, NULL, NULL);
}
