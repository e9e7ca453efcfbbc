/* SPDX-License-Identifier: GPL-3.0-or-later */
#include "support.h"

#include "base/cpu.h"
#include "lighting/medium.h"
#include "octree/neighbours.h"

/* The levels that this machine runs, each selected in turn. */
static int select_level(int index) {
  fum_cpu_limit(FUM_CPU_AVX512);
  const fum_cpu_level best = fum_cpu();
  if (index > (int)best) return 0;
  fum_cpu_limit((fum_cpu_level)index);
  return 1;
}

/* A scene's medium with runs. */
typedef struct smoke {
  stage stage;
  fum_octree *octree;
  fum_medium medium;
} smoke;

static smoke smoke_open(const puffs *p, int32_t leaf_size, float error) {
  smoke s = {.stage = stage_open()};
  const fum_octree_options options = {leaf_size, 1.0F, NULL};
  add_puffs(s.stage.scene, p);
  fum_scene_find_origin(s.stage.scene);
  assert_int_equal(fum_octree_build(s.stage.scene, &options, &s.octree), FUM_OK);
  s.medium = (fum_medium){.octree = s.octree, .sigma_scale = 1.0F, .depth_scale = 1.0F, .depth_limit = 20.0F};
  assert_int_equal(fum_medium_begin(s.stage.context, error, &s.medium), FUM_OK);
  assert_int_equal(fum_medium_lay_runs(s.stage.context, &s.medium), FUM_OK);
  return s;
}

static void smoke_close(smoke *s) {
  fum_medium_end(s->stage.context, &s->medium);
  fum_octree_destroy(s->stage.context, s->octree);
  stage_close(&s->stage);
}

static int64_t runs_below(const smoke *s, uint32_t index) {
  const fum_octree_node *node = &fum_medium_casters(&s->medium)->nodes[index];
  int64_t count = 0;
  if (node->count <= FUM_PACKET_SIZE || node->children == 0) return (node->count + FUM_RUN_SIZE - 1) / FUM_RUN_SIZE;
  for (uint32_t c = 0; c < (uint32_t)__builtin_popcount(node->octants); c++)
    count += runs_below(s, node->children + c);
  return count;
}

static int64_t count_runs(const smoke *s) {
  return runs_below(s, 0);
}

static fum_vec3 sphere_middle(const smoke *s, int64_t run) {
  return (fum_vec3){s->medium.spheres.x[run], s->medium.spheres.y[run], s->medium.spheres.z[run]};
}

/* Optical depth of a run's particles along a segment, in double precision. */
static double run_depth(const smoke *s, int64_t r, const fum_segment *segment) {
  const fum_run *run = &s->medium.runs[r];
  const fum_vec3 middle = sphere_middle(s, r);
  double depth = 0.0;
  for (int i = 0; i < FUM_RUN_SIZE; i++) {
    const double at[3] = {(double)middle.x + (double)run->x[i], (double)middle.y + (double)run->y[i],
                          (double)middle.z + (double)run->z[i]};
    double along = 0.0, squared = 0.0;
    for (int axis = 0; axis < 3; axis++)
      along += (at[axis] - (double)segment->origin[axis]) * (double)segment->direction[axis];
    for (int axis = 0; axis < 3; axis++)
      squared += pow(at[axis] - (double)segment->origin[axis] - along * (double)segment->direction[axis], 2.0);
    const double scale = (double)run->scales[i], per_root = scale * sqrt(log(2.0)); /* 1 / (sqrt(2) sigma) */
    depth += (double)run->optical_depths[i] * exp2(-squared * scale * scale) * 0.5 *
             (erfc(-along * per_root) - erfc(((double)segment->length - along) * per_root));
  }
  return depth;
}

static fum_segment random_segment(uint64_t seed, float size, float length) {
  const fum_vec3 way = {uniform(seed, -1.0F, 1.0F), uniform(seed + 1, -1.0F, 1.0F), uniform(seed + 2, -1.0F, 1.0F)};
  const fum_vec3 u = fum_scaled(way, 1.0F / fum_length(way));
  return (fum_segment){{uniform(seed + 3, -size, size), uniform(seed + 4, -size, size), uniform(seed + 5, -size, size)},
                       {u.x, u.y, u.z},
                       length};
}

/* Every particle is in one run: counts and optical depths agree, also where many share a place. */
static void test_runs_hold_every_particle(void **state) {
  (void)state;
  const int32_t leaf_sizes[] = {1, 64, 4096};
  for (int k = 0; k < 3; k++) {
    puffs p = puffs_random(5000, 3, 1.0F, 0.1F, 1.0F);
    for (int64_t i = 0; i < 1500; i++)
      memcpy(p.positions + 3 * i, (float[3]){0.5F, 0.25F, 0.0F}, 3 * sizeof(float));
    smoke s = smoke_open(&p, leaf_sizes[k], 1e-3F);
    double expected = 0.0, found = 0.0;
    int64_t particles = 0;
    for (int64_t i = 0; i < s.octree->count; i++)
      expected += (double)s.octree->optical_depths[i];
    for (int64_t r = 0; r < count_runs(&s); r++) {
      for (int i = 0; i < FUM_RUN_SIZE; i++) {
        found += (double)s.medium.runs[r].optical_depths[i];
        particles += s.medium.runs[r].optical_depths[i] > 0.0F;
      }
    }
    assert_int_equal(particles, p.count);
    assert_true(fabs(found / expected - 1.0) < 1e-9);
    smoke_close(&s);
    puffs_free(&p);
  }
}

/* A run that a segment doesn't hear weighs less there than its share of the error, whatever it is made of. */
static void test_what_is_not_heard_does_not_matter(void **state) {
  (void)state;
  const float error = 1e-3F;
  puffs p = puffs_random(8000, 4, 1.0F, 0.1F, 1.0F);
  for (int64_t i = 0; i < p.count; i++) {
    if (i % 5 == 0) p.radii[i] *= 30.0F;    /* mixed radii */
    if (i % 7 == 0) p.densities[i] *= 1e4F; /* dense ones beside thin ones */
  }
  smoke s = smoke_open(&p, 64, error);
  int64_t tested = 0;
  for (uint64_t trial = 0; trial < 200; trial++) {
    const fum_segment segment = random_segment(trial * 8, 15.0F, uniform(trial * 8 + 7, 0.0F, 30.0F));
    for (int64_t r = 0; r < count_runs(&s); r++) {
      const fum_vec3 o = {segment.origin[0], segment.origin[1], segment.origin[2]};
      const fum_vec3 u = {segment.direction[0], segment.direction[1], segment.direction[2]};
      const fum_vec3 d = fum_sub(sphere_middle(&s, r), o);
      const float t = fminf(fmaxf(fum_dot(d, u), 0.0F), segment.length);
      const float distance = fum_length(fum_mad(u, -t, d)), hearing = s.medium.spheres.hearing[r];
      if (distance <= hearing || distance > 1.5F * hearing) continue;
      assert_true(run_depth(&s, r, &segment) < 0.2501 * (double)error);
      tested++;
    }
  }
  assert_true(tested > 1000);
  smoke_close(&s);
  puffs_free(&p);
}

/* The loops against double precision, with runs well within the segment, near either end and near both. */
static void test_sums_agree_with_double_precision(void **state) {
  (void)state;
  puffs p = puffs_random(1000, 5, 1.0F, 0.2F, 0.3F);
  smoke s = smoke_open(&p, 64, 1e-6F);
  const int32_t counts[] = {1, 15, 37, FUM_BATCH_SIZE};
  fum_batch batch = {0};
  for (int32_t i = 0; i < FUM_BATCH_SIZE && i < count_runs(&s); i++) {
    const fum_vec3 middle = sphere_middle(&s, i);
    batch.runs[i] = &s.medium.runs[i];
    batch.x[i] = middle.x, batch.y[i] = middle.y, batch.z[i] = middle.z;
    batch.hearing[i] = s.medium.spheres.hearing[i];
    batch.clear[i] = s.medium.spheres.clear[i];
  }
  for (int level = 0; select_level(level); level++) {
    for (uint64_t trial = 0; trial < 200; trial++) {
      const float lengths[] = {0.2F, 1.0F, 3.0F, INFINITY};
      const fum_segment segment = random_segment(trial * 8, 1.5F, lengths[trial % 4]);
      double expected = 0.0;
      batch.count = counts[trial / 4 % 4];
      for (int32_t i = 0; i < batch.count; i++)
        expected += run_depth(&s, i, &segment);
      const double found = (double)fum_run_loops_get()->sum(&batch, &segment);
      assert_true(fabs(found - expected) < 2e-5 * expected + 1e-6 * (double)batch.count);
    }
  }
  fum_cpu_limit(FUM_CPU_AVX512);
  smoke_close(&s);
  puffs_free(&p);
}

/* No sphere that any segment of a beam touches is refused, and every level refuses the same. */
static void test_beams_hear_all_that_their_segments_hear(void **state) {
  (void)state;
  enum { COUNT = 50 };
  float arrays[5][COUNT + FUM_RUN_SIZE] = {0};
  int64_t heard = 0, refused = 0;
  for (uint64_t trial = 0; trial < 300; trial++) {
    const fum_spheres spheres = {arrays[0], arrays[1], arrays[2], arrays[3], arrays[4]};
    for (int i = 0; i < COUNT; i++) {
      const uint64_t seed = fum_hash64(trial * COUNT + (uint64_t)i);
      for (int axis = 0; axis < 3; axis++)
        arrays[axis][i] = uniform(seed + (uint64_t)axis, -2.0F, 2.0F);
      arrays[3][i] = uniform(seed + 3, 0.01F, 0.8F);
    }
    const fum_segment axis = random_segment(trial * 16, 1.0F, 2.0F);
    const fum_vec3 start = {axis.origin[0], axis.origin[1], axis.origin[2]};
    const fum_vec3 u = {axis.direction[0], axis.direction[1], axis.direction[2]};
    const fum_vec3 light = fum_mad(u, axis.length, start);
    const float radius = 0.3F;
    const fum_beam beam = {start, u, -radius, axis.length + radius, radius, -radius / axis.length};
    uint64_t first = 0;
    for (int level = 0; select_level(level); level++) {
      const uint64_t bits = fum_run_loops_get()->hear(&beam, &spheres, 0, COUNT);
      if (level == 0) first = bits;
      assert_true(bits == first && bits >> COUNT == 0);
    }
    heard += __builtin_popcountll(first);
    for (uint64_t ray = 0; ray < 20; ray++) {
      fum_vec3 offset = {uniform(ray * 3 + trial, -1.0F, 1.0F), uniform(ray * 3 + 1 + trial, -1.0F, 1.0F),
                         uniform(ray * 3 + 2 + trial, -1.0F, 1.0F)};
      offset = fum_scaled(offset, radius / fmaxf(1.0F, fum_length(offset)));
      const fum_vec3 from = {start.x + offset.x, start.y + offset.y, start.z + offset.z};
      const fum_vec3 way = fum_sub(light, from);
      for (int i = 0; i < COUNT; i++) {
        if (first >> i & 1) continue;
        const fum_vec3 d = fum_sub((fum_vec3){arrays[0][i], arrays[1][i], arrays[2][i]}, from);
        const float t = fminf(fmaxf(fum_dot(d, way) / fum_dot(way, way), 0.0F), 1.0F);
        assert_true(fum_length(fum_mad(way, -t, d)) > arrays[3][i]);
        refused++;
      }
    }
  }
  assert_true(heard > 1000 && refused > 10000);
  fum_cpu_limit(FUM_CPU_AVX512);
}

/* Runs of scattered particles are compact: sixteen of 4,096 in a cube of side 2 fill one of side 0.31. */
static void test_neighbours_are_near(void **state) {
  (void)state;
  enum { COUNT = 4096 };
  puffs p = puffs_random(COUNT, 6, 1.0F, 0.1F, 1.0F);
  smoke s = smoke_open(&p, COUNT, 1e-3F);
  uint32_t order[COUNT];
  uint8_t seen[COUNT] = {0};
  double mean = 0.0;
  for (uint32_t i = 0; i < COUNT; i++)
    order[i] = i;
  fum_neighbours_sort(s.octree, FUM_RUN_SIZE, COUNT, order);
  for (uint32_t i = 0; i < COUNT; i++)
    assert_int_equal(seen[order[i]]++, 0);
  for (uint32_t begin = 0; begin < COUNT; begin += FUM_RUN_SIZE) {
    float lower[3] = {9, 9, 9}, upper[3] = {-9, -9, -9};
    for (uint32_t i = begin; i < begin + FUM_RUN_SIZE; i++) {
      const float at[3] = {s.octree->x[order[i]], s.octree->y[order[i]], s.octree->z[order[i]]};
      for (int axis = 0; axis < 3; axis++) {
        lower[axis] = fminf(lower[axis], at[axis]);
        upper[axis] = fmaxf(upper[axis], at[axis]);
      }
    }
    for (int axis = 0; axis < 3; axis++)
      mean += (double)(upper[axis] - lower[axis]) / (3.0 * COUNT / FUM_RUN_SIZE);
  }
  assert_true(mean < 0.33);
  smoke_close(&s);
  puffs_free(&p);
}

int main(void) {
  const struct CMUnitTest tests[] = {
      cmocka_unit_test(test_runs_hold_every_particle),
      cmocka_unit_test(test_what_is_not_heard_does_not_matter),
      cmocka_unit_test(test_sums_agree_with_double_precision),
      cmocka_unit_test(test_beams_hear_all_that_their_segments_hear),
      cmocka_unit_test(test_neighbours_are_near),
  };
  return cmocka_run_group_tests(tests, NULL, NULL);
}
