/* SPDX-License-Identifier: GPL-3.0-or-later */
/* The meter's particles: a fair sample that stays the same while smoke moves, is born and dies. */
#include "support.h"

#include "lighting/meter_pick.h"

enum { COUNT = 20000, MOST = 1000 };

/* Particles of these ids, each at a place that hangs on its id and on the frame; `ids` NULL: 0, 1, 2... */
static void add_frame(fum_scene *scene, const char *name, int64_t count, const uint64_t *ids, float frame,
                      bool is_visible) {
  fum_particles_desc desc;
  fum_particles_desc_init(&desc);
  float *positions = malloc((size_t)count * 3 * sizeof *positions);
  assert_non_null(positions);
  for (int64_t i = 0; i < count; i++) {
    const uint64_t id = ids != NULL ? ids[i] : (uint64_t)i;
    for (uint64_t axis = 0; axis < 3; axis++)
      positions[3 * i + (int64_t)axis] =
          uniform(6 * id + axis, -1.0F, 1.0F) + frame * uniform(6 * id + 3 + axis, -0.2F, 0.2F);
  }
  desc.name = name;
  desc.count = count;
  desc.positions = positions;
  desc.ids = ids;
  desc.visible_to_camera = is_visible;
  assert_int_equal(fum_scene_add_particles(scene, &desc), FUM_OK);
  free(positions);
}

/* Of each particle of the scene, whether it was picked. The caller frees it. */
static uint8_t *pick(fum_scene *scene, const bool *takes, int64_t *out_count) {
  fum_octree *octree = NULL;
  fum_meter_picks picks;
  const fum_octree_options options = {64, 1.0F, takes};
  uint8_t *is_picked = calloc((size_t)scene->particle_count, 1);
  assert_non_null(is_picked);
  fum_scene_find_origin(scene);
  assert_int_equal(fum_octree_build(scene, &options, &octree), FUM_OK);
  assert_int_equal(fum_meter_pick(scene->context, scene, octree, MOST, &picks), FUM_OK);
  for (int64_t k = 0; k < picks.count; k++) {
    assert_true(k == 0 || picks.keys[k] >= picks.keys[k - 1]);
    assert_true(picks.ranks[k] < octree->count);
    assert_int_equal(is_picked[octree->indices[picks.ranks[k]]]++, 0);
  }
  *out_count = picks.count;
  fum_meter_picks_free(scene->context, &picks);
  fum_octree_destroy(scene->context, octree);
  return is_picked;
}

static void assert_about(int64_t found, int64_t expected) {
  if (llabs(found - expected) > 5 * (int64_t)sqrt((double)expected))
    fail_msg("%lld is not about %lld", (long long)found, (long long)expected);
}

/* All of a few; of many about as many as wanted, in the first half as often as in the second. */
static void test_sample_is_fair(void **state) {
  (void)state;
  for (int64_t count = MOST / 2; count <= COUNT; count *= 8) {
    stage s = stage_open();
    add_frame(s.scene, "smoke", count, NULL, 0.0F, true);
    int64_t found, halves[2] = {0};
    uint8_t *is_picked = pick(s.scene, NULL, &found);
    for (int64_t i = 0; i < count; i++)
      halves[2 * i >= count] += is_picked[i];
    if (count <= MOST) assert_int_equal(found, count);
    if (count > MOST) assert_about(found, MOST);
    assert_about(halves[0], found / 2);
    free(is_picked);
    stage_close(&s);
  }
}

/* The next frame: everything has moved, 1 % have died and as many were born, they come in another order, and other
 * smoke comes first. Those of both frames that were picked once are picked again, but for the few that the newborn
 * take the place of. */
static void test_next_frame_has_the_same(void **state) {
  (void)state;
  const uint64_t born = COUNT / 100;
  uint64_t *ids = malloc(COUNT * sizeof *ids);
  assert_non_null(ids);
  for (uint64_t i = 0; i < COUNT; i++)
    ids[i] = COUNT + born - 1 - i;
  stage before = stage_open(), after = stage_open();
  add_frame(before.scene, "smoke", COUNT, NULL, 0.0F, true);
  add_frame(after.scene, "other", 10, NULL, 0.0F, true);
  add_frame(after.scene, "smoke", COUNT, ids, 1.0F, true);
  int64_t found, lost = 0;
  uint8_t *first = pick(before.scene, NULL, &found), *second = pick(after.scene, NULL, &found);
  for (uint64_t id = born; id < COUNT; id++)
    lost += first[id] != second[10 + id - born]; /* sets are sorted by id */
  if (lost > 4) fail_msg("%lld picks changed", (long long)lost);
  free(second);
  free(first);
  stage_close(&after);
  stage_close(&before);
  free(ids);
}

/* What subsampling chooses is no sample of the whole: keys are others than those. */
static void test_keys_differ_from_subsampling(void **state) {
  (void)state;
  stage s = stage_open();
  add_frame(s.scene, "smoke", COUNT, NULL, 0.0F, true);
  int64_t found, chosen = 0;
  uint8_t *is_picked = pick(s.scene, NULL, &found);
  for (int64_t i = 0; i < COUNT; i++)
    chosen += is_picked[i] && fum_hash_unit(fum_particle_identity(&s.scene->particles[0], i)) < 0.1;
  assert_about(chosen, found / 10);
  free(is_picked);
  stage_close(&s);
}

static void test_ids_that_do_not_differ(void **state) {
  (void)state;
  uint64_t *ids = calloc(COUNT, sizeof *ids);
  assert_non_null(ids);
  stage s = stage_open();
  add_frame(s.scene, "smoke", COUNT, ids, 0.0F, true);
  int64_t found;
  free(pick(s.scene, NULL, &found));
  assert_int_equal(found, MOST);
  stage_close(&s);
  free(ids);
}

static void test_smoke_that_is_not_in_the_octree(void **state) {
  (void)state;
  const bool takes[] = {false, true};
  stage s = stage_open();
  add_frame(s.scene, "hidden", COUNT, NULL, 0.0F, false);
  add_frame(s.scene, "seen", COUNT, NULL, 0.0F, true);
  int64_t found;
  uint8_t *is_picked = pick(s.scene, takes, &found);
  assert_about(found, MOST);
  for (int64_t i = 0; i < COUNT; i++)
    assert_int_equal(is_picked[i], 0);
  free(is_picked);
  stage_close(&s);
}

/* What random choices hang on: other sets before change nothing, sets without ids of one name differ. */
static void test_identities(void **state) {
  (void)state;
  const uint64_t ids[] = {7, 8};
  stage s = stage_open(), other = stage_open();
  add_frame(s.scene, "a", 2, NULL, 0.0F, true);
  add_frame(s.scene, "b", 2, ids, 0.0F, true);
  add_frame(s.scene, "a", 2, NULL, 0.0F, true);
  add_frame(s.scene, "a", 2, NULL, 0.0F, true);
  add_frame(other.scene, "b", 2, ids, 0.0F, true);
  const fum_particles *sets = s.scene->particles;
  assert_true(fum_particle_identity(&sets[1], 1) == fum_particle_identity(&other.scene->particles[0], 1));
  for (int k = 0; k < 4; k++) {
    for (int m = 0; m < k; m++)
      assert_true(fum_particle_identity(&sets[k], 0) != fum_particle_identity(&sets[m], 0));
  }
  stage_close(&other);
  stage_close(&s);
}

int main(void) {
  const struct CMUnitTest tests[] = {
      cmocka_unit_test(test_sample_is_fair),
      cmocka_unit_test(test_next_frame_has_the_same),
      cmocka_unit_test(test_keys_differ_from_subsampling),
      cmocka_unit_test(test_ids_that_do_not_differ),
      cmocka_unit_test(test_smoke_that_is_not_in_the_octree),
      cmocka_unit_test(test_identities),
  };
  return cmocka_run_group_tests(tests, NULL, NULL);
}
