/* SPDX-License-Identifier: GPL-3.0-or-later */
/* The exact solver through the public calls, against double-precision brute force. */
#include "support.h"

#include "base/cpu.h"

static double worst_error(fum_scene *scene, const fum_settings *settings, const puffs *p, const double light[3],
                          int64_t count, const float *points) {
  float *found = malloc((size_t)count * sizeof *found);
  assert_int_equal(fum_scene_transmittance(scene, settings, 0, count, points, found), FUM_OK);
  double worst = 0.0;
  for (int64_t i = 0; i < count; i++) {
    const double from[3] = {(double)points[3 * i], (double)points[3 * i + 1], (double)points[3 * i + 2]};
    worst = fmax(worst, fabs((double)found[i] - exp(-brute_depth(p, from, light))));
  }
  free(found);
  return worst;
}

/* One particle, segments that pass it, end in it, start in it, lie in it, point away from it. */
static void test_one_particle(void **state) {
  (void)state;
  puffs p = puffs_random(1, 1, 0.0F, 1.0F, 1.0F);
  p.radii[0] = 1.0F;
  p.densities[0] = 2.0F;
  const double lights[][3] = {{3, 0, 0}, {0.2, 0.1, 0}, {0, 0, 0}, {0, 5, 0.3}, {-0.4, 0, 0}};
  const float points[] = {-3,   0,    0,    -3, 0.4F, 0, -3,    3,    0, 0, 0,  0,
                          0.1F, 0.1F, 0.1F, 3,  0,    0, -0.3F, 0.2F, 0, 0, -4, 0.3F};
  for (int i = 0; i < 5; i++) {
    stage s = stage_open();
    add_puffs(s.scene, &p);
    add_point_light(s.scene, lights[i]);
    assert_true(worst_error(s.scene, NULL, &p, lights[i], 8, points) < 1e-4);
    stage_close(&s);
  }
  puffs_free(&p);
}

static void test_the_particle_itself_counts_half(void **state) {
  (void)state;
  puffs p = puffs_random(1, 1, 0.0F, 1.0F, 1.0F);
  p.radii[0] = 1.0F;
  p.densities[0] = 2.0F;
  const double light[3] = {100, 0, 0};
  stage s = stage_open();
  add_puffs(s.scene, &p);
  add_point_light(s.scene, light);
  float found;
  assert_int_equal(fum_scene_transmittance(s.scene, NULL, 0, 1, p.positions, &found), FUM_OK);
  const double depth = 2.0 * 0.5 * sqrt(2.0 * 3.14159265358979);
  assert_true(fabs((double)found - exp(-0.5 * depth)) < 1e-5);
  stage_close(&s);
  puffs_free(&p);
}

/* Many particles of different kinds at the default tolerance: at most 1e-3, as the header says; a tight one: less. */
static void check_cloud(puffs *p, const double light[3]) {
  stage s = stage_open();
  add_puffs(s.scene, p);
  add_point_light(s.scene, light);
  const int64_t count = p->count < 100 ? p->count : 100;
  for (int level = 0; level <= (int)FUM_CPU_AVX512; level++) {
    fum_cpu_limit((fum_cpu_level)level);
    const double worst = worst_error(s.scene, NULL, p, light, count, p->positions);
    if (worst > 1e-3) fail_msg("worst error %g", worst);
  }
  fum_settings tight;
  fum_settings_init(&tight);
  tight.tolerance = 1e-3F;
  const double worst = worst_error(s.scene, &tight, p, light, count, p->positions);
  if (worst > 1e-4) fail_msg("worst error %g at the tight tolerance", worst);
  stage_close(&s);
}

static void test_clouds(void **state) {
  (void)state;
  const double outside[3] = {4, 3, 2}, inside[3] = {0.1, 0.2, 0.0}, far_away[3] = {3e3, 1e3, 0}, edge[3] = {1.0, 0, 0};
  const struct {
    int64_t count;
    float radius, density;
  } kinds[] = {{50, 1.0F, 3.0F}, {2000, 0.3F, 3.0F}, {20000, 0.1F, 6.0F}, {20000, 0.03F, 100.0F}, {300, 0.2F, 300.0F}};
  for (int k = 0; k < 5; k++) {
    puffs p = puffs_random(kinds[k].count, (uint64_t)k + 10, 1.0F, kinds[k].radius, kinds[k].density);
    check_cloud(&p, outside);
    check_cloud(&p, inside);
    check_cloud(&p, far_away);
    check_cloud(&p, edge);
    puffs_free(&p);
  }
}

static void test_mixed_radii(void **state) {
  (void)state;
  const double light[3] = {3, 2, 5};
  puffs p = puffs_random(20000, 20, 1.0F, 0.05F, 3.0F);
  for (int64_t i = 0; i < 20; i++) {
    p.radii[i * 1000] = 1.5F;
    p.densities[i * 1000] = 0.2F;
  }
  check_cloud(&p, light);
  puffs_free(&p);
  p = puffs_random(3000, 21, 1.0F, 1.0F, 1.0F); /* radii over six orders of magnitude, equal optical depths */
  for (int64_t i = 0; i < p.count; i++) {
    p.radii[i] = powf(10.0F, uniform((uint64_t)i, -6.0F, 0.0F));
    p.densities[i] = 0.01F / p.radii[i];
  }
  check_cloud(&p, light);
  puffs_free(&p);
}

/* Particles that must not be taken for their neighbours: a few dense ones among thousands of thin ones, radii from 1 to
 * 1,000 in one place, a dense cluster far from what it shades, rows of runs that all graze the rays. */
static void test_unlike_neighbours(void **state) {
  (void)state;
  const double light[3] = {3, 2, 5}, in_line[3] = {40, 0, 0};
  puffs p = puffs_random(8000, 23, 1.0F, 0.1F, 0.05F);
  for (int64_t i = 0; i < p.count; i += 997)
    p.densities[i] = 3000.0F;
  check_cloud(&p, light);
  puffs_free(&p);
  p = puffs_random(4000, 24, 1.0F, 1e-3F, 30.0F);
  for (int64_t i = 100; i < p.count; i++) {
    const float factor = powf(1000.0F, uniform((uint64_t)i, 0.0F, 1.0F));
    p.radii[i] *= factor;
    p.densities[i] /= factor * factor;
  }
  check_cloud(&p, light);
  puffs_free(&p);
  p = puffs_random(4000, 25, 1.0F, 0.1F, 0.1F);
  for (int64_t i = 2000; i < p.count; i++) {
    for (int axis = 0; axis < 3; axis++)
      p.positions[3 * i + axis] = 0.02F * p.positions[3 * i + axis] + (axis == 0 ? 20.0F : 0.0F);
    p.radii[i] = 0.5F;
    p.densities[i] = 0.02F;
  }
  check_cloud(&p, in_line);
  puffs_free(&p);
  p = puffs_random(20000, 26, 1.0F, 0.1F, 20.0F);
  for (int64_t i = 0; i < p.count; i++) {
    p.positions[3 * i] *= 10.0F; /* receivers at 3 to 7 sigmas from a rod that points at the light */
    for (int axis = 1; axis < 3 && i >= 100; axis++)
      p.positions[3 * i + axis] *= 0.02F;
    for (int axis = 1; axis < 3 && i < 100; axis++)
      p.positions[3 * i + axis] = axis == 1 ? uniform((uint64_t)i, 0.15F, 0.35F) : 0.0F;
  }
  check_cloud(&p, in_line);
  puffs_free(&p);
}

static void test_coincident_and_aligned(void **state) {
  (void)state;
  const double light[3] = {3, 0.001, 0};
  puffs p = puffs_random(5000, 22, 1.0F, 0.2F, 0.01F);
  for (int64_t i = 0; i < p.count; i++) {
    if (i >= 400) memcpy(p.positions + 3 * i, (float[3]){0.5F, 0.0F, 0.0F}, 3 * sizeof(float));
    if (i < 300) p.positions[3 * i + 1] = p.positions[3 * i + 2] = 0.0F; /* a line that points at the light */
  }
  check_cloud(&p, light);
  puffs_free(&p);
}

/* Splitting every particle in two of half the density changes nothing. */
static void test_splitting_changes_nothing(void **state) {
  (void)state;
  const double light[3] = {4, 3, 2};
  puffs p = puffs_random(4000, 30, 1.0F, 0.2F, 2.0F), twice = puffs_random(8000, 30, 1.0F, 0.2F, 2.0F);
  for (int64_t i = 0; i < twice.count; i++) {
    memcpy(twice.positions + 3 * i, p.positions + 3 * (i / 2), 3 * sizeof(float));
    twice.radii[i] = p.radii[i / 2];
    twice.densities[i] = 0.5F * p.densities[i / 2];
  }
  float one[500], two[500];
  stage a = stage_open(), b = stage_open();
  add_puffs(a.scene, &p);
  add_puffs(b.scene, &twice);
  add_point_light(a.scene, light);
  add_point_light(b.scene, light);
  assert_int_equal(fum_scene_transmittance(a.scene, NULL, 0, 500, p.positions, one), FUM_OK);
  assert_int_equal(fum_scene_transmittance(b.scene, NULL, 0, 500, p.positions, two), FUM_OK);
  for (int i = 0; i < 500; i++)
    assert_true(fabsf(one[i] - two[i]) < 1e-3F);
  stage_close(&a);
  stage_close(&b);
  puffs_free(&p);
  puffs_free(&twice);
}

/* Moving and scaling the whole scene changes nothing beyond rounding. */
static void test_moving_and_scaling_change_nothing(void **state) {
  (void)state;
  puffs p = puffs_random(4000, 31, 1.0F, 0.2F, 2.0F);
  for (int64_t i = 0; i < 3 * p.count; i++)
    p.positions[i] = roundf(p.positions[i] * 4096.0F) / 4096.0F;
  float reference[300];
  const struct {
    float scale, shift;
  } moves[] = {{1.0F, 0.0F}, {1.0F, 1024.0F}, {1024.0F, 0.0F}, {0x1p-12F, 0.0F}, {0.25F, -512.0F}};
  for (int m = 0; m < 5; m++) {
    puffs moved = puffs_random(p.count, 31, 1.0F, 0.2F, 2.0F);
    for (int64_t i = 0; i < 3 * p.count; i++)
      moved.positions[i] = p.positions[i] * moves[m].scale + moves[m].shift;
    for (int64_t i = 0; i < p.count; i++) {
      moved.radii[i] *= moves[m].scale;
      moved.densities[i] /= moves[m].scale;
    }
    double light[3] = {4, 3, 2};
    for (int axis = 0; axis < 3; axis++)
      light[axis] = light[axis] * (double)moves[m].scale + (double)moves[m].shift;
    float found[300];
    stage s = stage_open();
    add_puffs(s.scene, &moved);
    add_point_light(s.scene, light);
    assert_int_equal(fum_scene_transmittance(s.scene, NULL, 0, 300, moved.positions, found), FUM_OK);
    if (m == 0) memcpy(reference, found, sizeof found);
    for (int i = 0; i < 300; i++)
      assert_true(fabsf(found[i] - reference[i]) < 1e-5F);
    stage_close(&s);
    puffs_free(&moved);
  }
  puffs_free(&p);
}

static void test_threads_and_order_change_no_bit(void **state) {
  (void)state;
  const double light[3] = {4, 3, 2};
  puffs p = puffs_random(5000, 32, 1.0F, 0.2F, 2.0F), shuffled = puffs_random(5000, 32, 1.0F, 0.2F, 2.0F);
  uint64_t *ids = malloc(5000 * sizeof *ids), *shuffled_ids = malloc(5000 * sizeof *ids);
  for (uint64_t i = 0; i < 5000; i++) {
    const uint64_t to = (i * 1237) % 5000;
    ids[i] = 7 * i;
    shuffled_ids[to] = 7 * i;
    memcpy(shuffled.positions + 3 * to, p.positions + 3 * i, 3 * sizeof(float));
    shuffled.radii[to] = p.radii[i];
    shuffled.densities[to] = p.densities[i];
  }
  float first[500], other[500];
  for (int run = 0; run < 5; run++) {
    const puffs *source = run == 4 ? &shuffled : &p;
    fum_particles_desc desc;
    fum_particles_desc_init(&desc);
    desc.count = source->count;
    desc.positions = source->positions;
    desc.radii = source->radii;
    desc.densities = source->densities;
    desc.ids = run == 4 ? shuffled_ids : ids;
    stage s = stage_open();
    assert_int_equal(fum_context_set_threads(s.context, run + 1), FUM_OK);
    assert_int_equal(fum_scene_add_particles(s.scene, &desc), FUM_OK);
    add_point_light(s.scene, light);
    fum_settings settings;
    fum_settings_init(&settings);
    settings.subsampling = 0.5F;
    assert_int_equal(fum_scene_transmittance(s.scene, &settings, 0, 500, p.positions, run == 0 ? first : other),
                     FUM_OK);
    if (run > 0) assert_memory_equal(first, other, sizeof first);
    stage_close(&s);
  }
  free(shuffled_ids);
  free(ids);
  puffs_free(&shuffled);
  puffs_free(&p);
}

static void add_wall(fum_scene *scene, double x) {
  const float vertices[] = {0, -9, -9, 0, 9, -9, 0, 9, 9, 0, -9, 9};
  const uint32_t triangles[] = {0, 1, 2, 0, 2, 3};
  fum_mesh_desc desc;
  fum_mesh_desc_init(&desc);
  desc.vertex_count = 4;
  desc.triangle_count = 2;
  desc.vertices = vertices;
  desc.triangles = triangles;
  desc.world_from_local[3] = x;
  assert_int_equal(fum_scene_add_mesh(scene, &desc), FUM_OK);
}

static void test_solids_shadow(void **state) {
  (void)state;
  const double light[3] = {4, 0, 0};
  puffs p = puffs_random(2000, 33, 1.0F, 0.2F, 1.0F);
  float plain[500], found[500];
  stage s = stage_open();
  add_puffs(s.scene, &p);
  add_point_light(s.scene, light);
  assert_int_equal(fum_scene_transmittance(s.scene, NULL, 0, 500, p.positions, plain), FUM_OK);
  add_wall(s.scene, 0.25);
  const float intensities[] = {1.0F, 0.4F, 0.0F};
  for (int k = 0; k < 3; k++) {
    fum_settings settings;
    fum_settings_init(&settings);
    settings.solid_shadow_intensity = intensities[k];
    assert_int_equal(fum_scene_transmittance(s.scene, &settings, 0, 500, p.positions, found), FUM_OK);
    for (int i = 0; i < 500; i++) {
      const bool is_behind = p.positions[3 * i] < 0.25F;
      const float expected = is_behind ? plain[i] * (1.0F - intensities[k]) : plain[i];
      assert_true(fabsf(found[i] - expected) < 1e-5F);
      if (is_behind && intensities[k] == 1.0F) assert_true(found[i] == 0.0F);
    }
  }
  stage_close(&s);
  puffs_free(&p);
}

static void test_artistic_controls(void **state) {
  (void)state;
  const double light[3] = {4, 0, 0};
  puffs p = puffs_random(2000, 34, 1.0F, 0.2F, 0.5F), bent = puffs_random(2000, 34, 1.0F, 0.2F, 0.5F);
  for (int64_t i = 0; i < bent.count; i++) {
    bent.radii[i] *= 1.5F;
    bent.densities[i] *= 0.7F;
  }
  stage s = stage_open();
  add_puffs(s.scene, &p);
  add_point_light(s.scene, light);
  fum_settings settings;
  fum_settings_init(&settings);
  settings.intersection_scale = 1.5F;
  settings.shadowing_density = 0.7F;
  assert_true(worst_error(s.scene, &settings, &bent, light, 300, p.positions) < 1e-3);
  stage_close(&s);
  puffs_free(&bent);
  puffs_free(&p);
}

int main(void) {
  const struct CMUnitTest tests[] = {
      cmocka_unit_test(test_one_particle),
      cmocka_unit_test(test_the_particle_itself_counts_half),
      cmocka_unit_test(test_clouds),
      cmocka_unit_test(test_mixed_radii),
      cmocka_unit_test(test_unlike_neighbours),
      cmocka_unit_test(test_coincident_and_aligned),
      cmocka_unit_test(test_splitting_changes_nothing),
      cmocka_unit_test(test_moving_and_scaling_change_nothing),
      cmocka_unit_test(test_threads_and_order_change_no_bit),
      cmocka_unit_test(test_solids_shadow),
      cmocka_unit_test(test_artistic_controls),
  };
  return cmocka_run_group_tests(tests, NULL, NULL);
}
