/* SPDX-License-Identifier: GPL-3.0-or-later */
/* The meter: its exact light and its figures against brute force, and whether it notices light that is wrong. */
#include "support.h"

#include "api/lighting.h"
#include "lighting/meter.h"

static const double LIGHT[3] = {3.0, 1.0, 2.0};

enum { SIDE = 48 };

typedef struct setup {
  stage s;
  fum_settings settings;
  fum_lighting lighting;
  fum_view view;
  fum_meter_options options;
} setup;

static setup *open_setup(const puffs *p, float tolerance) {
  setup *t = malloc(sizeof *t);
  assert_non_null(t);
  *t = (setup){.s = stage_open()};
  add_puffs(t->s.scene, p);
  add_point_light(t->s.scene, LIGHT);
  fum_settings_init(&t->settings);
  t->settings.tolerance = tolerance;
  assert_int_equal(fum_caches_update(t->s.scene, &t->settings), FUM_OK);
  const fum_octree *all = t->s.scene->caches->all;
  assert_int_equal(fum_lighting_begin(t->s.scene, &t->settings, all, &t->lighting), FUM_OK);
  t->options = (fum_meter_options){t->s.scene, all, t->lighting.media, &t->lighting.lamps, {0}, 1e-6};
  fum_camera camera;
  fum_camera_init(&camera);
  camera.world_from_camera[11] = 5.0;
  memcpy(camera.window, (double[4]){-0.4, 0.4, -0.4, 0.4}, sizeof camera.window);
  camera.width = camera.height = SIDE;
  assert_int_equal(fum_view_init(t->s.context, &camera, &t->view), FUM_OK);
  fum_view_place(&t->view, t->s.scene->origin);
  return t;
}

static void close_setup(setup *t) {
  fum_lighting_end(t->s.context, &t->lighting);
  stage_close(&t->s);
  free(t);
}

static double brute_transmittance(const setup *t, const puffs *p, const double local[3]) {
  double world[3];
  for (int axis = 0; axis < 3; axis++)
    world[axis] = local[axis] + t->s.scene->origin[axis];
  return exp(-brute_depth(p, world, LIGHT));
}

/* 1e-6: the particles' places are rounded to float. */
static void test_exact_light_is_brute_force(void **state) {
  (void)state;
  puffs clouds[] = {puffs_random(200, 1, 1.0F, 0.8F, 1.0F), puffs_random(20000, 2, 1.0F, 0.1F, 4.0F)};
  for (int k = 0; k < 2; k++) {
    setup *t = open_setup(&clouds[k], 0.01F);
    fum_meter meter;
    const fum_hidden unknown = {0};
    const fum_meter_sight sight = {&t->view, 3.0, NULL, NULL, &unknown};
    assert_int_equal(fum_meter_begin_points(t->s.context, &t->options, &sight, &meter), FUM_OK);
    assert_int_equal(fum_meter_find_exact(&meter), FUM_OK);
    assert_true(meter.count >= 256 && meter.count <= 1024);
    for (int64_t n = 0; n < meter.count; n += k == 0 ? 1 : 16) {
      const double expected = brute_transmittance(t, &clouds[k], meter.points[n].position);
      const double found = meter.exact[n] / meter.sent[n];
      if (fabs(found - expected) > 3e-6) fail_msg("point %d: %.9g is not %.9g", (int)n, found, expected);
    }
    fum_meter_end(&meter);
    close_setup(t);
    puffs_free(&clouds[k]);
  }
}

static int compare(const void *a, const void *b) {
  const double x = *(const double *)a, y = *(const double *)b;
  return (x > y) - (x < y);
}

/* All particles of a small cloud are chosen. They are told to be brighter or darker by known amounts. */
static void test_figures_are_those_of_the_errors(void **state) {
  (void)state;
  puffs p = puffs_random(200, 3, 1.0F, 0.8F, 1.0F);
  setup *t = open_setup(&p, 0.01F);
  fum_meter meter;
  assert_int_equal(fum_meter_begin_particles(t->s.context, &t->options, &meter), FUM_OK);
  assert_int_equal(meter.count, p.count);
  float depths[200];
  uint8_t is_lit[200];
  double squares = 0.0, sum = 0.0, errors[200];
  int lit = 0;
  for (int i = 0; i < 200; i++) {
    const uint32_t index = t->options.octree->indices[i];
    double from[3];
    for (int axis = 0; axis < 3; axis++)
      from[axis] = (double)p.positions[3 * index + (uint32_t)axis];
    const double exact = exp(-brute_depth(&p, from, LIGHT));
    depths[i] = (float)(brute_depth(&p, from, LIGHT) + 0.02 * (i % 5 - 1));
    is_lit[i] = i % 4 != 0;
    if (!is_lit[i]) continue;
    const double error = exp(-(double)depths[i]) - exact;
    errors[lit++] = fabs(error);
    squares += error * error;
    sum += error;
  }
  const fum_emitter sample = fum_lamp_sample(t->lighting.lamps.items, 0);
  fum_meter_listen(&meter, t->lighting.lamps.items, &sample, is_lit, depths);
  fum_accuracy a;
  assert_int_equal(fum_meter_read(&meter, &a), FUM_OK);
  assert_int_equal(a.count, lit);
  assert_true(fabs(a.rms - sqrt(squares / lit)) < 3e-6);
  assert_true(fabs(a.bias - sum / lit) < 3e-6);
  qsort(errors, (size_t)lit, sizeof *errors, compare);
  assert_true(fabs(a.worst - errors[lit - 1]) < 3e-6);
  assert_true(fabs(a.p95 - errors[(lit - 1) * 95 / 100]) < 3e-6);
  fum_meter_end(&meter);
  close_setup(t);
  puffs_free(&p);
}

/* The lattice as it is, then with its optical depths a tenth too large. */
static void test_spoiled_lattice_is_noticed(void **state) {
  (void)state;
  puffs p = puffs_random(2000, 4, 1.0F, 0.3F, 2.0F);
  setup *t = open_setup(&p, 0.01F);
  const fum_octree *all = t->options.octree;
  fum_slabs slabs;
  fum_lattice lattice;
  fum_meter meter;
  fum_accuracy right, spoiled;
  const float footprint = 3.46F, tolerance = t->settings.tolerance;
  assert_int_equal(fum_slabs_find(t->s.context, all, &t->view, NULL, tolerance, tolerance, 0.0F, &slabs), FUM_OK);
  assert_int_equal(fum_lattice_place(t->s.context, all, &t->view, &slabs, footprint, tolerance, &lattice), FUM_OK);
  assert_int_equal(fum_lattice_light(&t->lighting.gathering, &t->view, &slabs, &t->lighting.lamps, &lattice), FUM_OK);
  const fum_meter_sight sight = {&t->view, (double)footprint, NULL, &slabs, &lattice.hidden};
  assert_non_null(lattice.hidden.depths);
  assert_int_equal(fum_meter_begin_points(t->s.context, &t->options, &sight, &meter), FUM_OK);
  assert_int_equal(fum_meter_find_exact(&meter), FUM_OK);
  fum_meter_ask(&meter, &slabs, &lattice);
  assert_int_equal(fum_meter_read(&meter, &right), FUM_OK);
  if (right.rms > 2.0 * (double)tolerance * right.level) fail_msg("rms %g of %g", right.rms, right.level);
  for (int64_t i = 0; i < lattice.sample_count; i++)
    lattice.depths[i] *= 1.1F;
  fum_meter_ask(&meter, &slabs, &lattice);
  assert_int_equal(fum_meter_read(&meter, &spoiled), FUM_OK);
  double expected = 0.0;
  for (int64_t n = 0; n < meter.count; n++) {
    const double exact = meter.exact[n] / meter.sent[n];
    expected += (pow(exact, 1.1) - exact) / (double)meter.count;
  }
  assert_true(expected < -0.01);
  const double added = spoiled.bias - right.bias;
  if (fabs(added - expected) > 0.1 * -expected) fail_msg("bias grew by %g, not %g", added, expected);
  assert_true(spoiled.rms > 3.0 * right.rms);
  fum_meter_end(&meter);
  fum_lattice_free(t->s.context, &lattice);
  fum_slabs_free(t->s.context, &slabs);
  close_setup(t);
  puffs_free(&p);
}

static fum_render_stats render_with(const puffs *p, int32_t threads) {
  static float rgba[4 * SIDE * SIDE];
  stage s = stage_open();
  add_puffs(s.scene, p);
  add_point_light(s.scene, LIGHT);
  assert_int_equal(fum_context_set_threads(s.context, threads), FUM_OK);
  fum_camera camera;
  fum_camera_init(&camera);
  camera.world_from_camera[11] = 5.0;
  camera.width = camera.height = SIDE;
  const fum_pass_buffer pass = {.pass = FUM_PASS_COMBINED, .pixels = rgba, .pixels_size = 4 * SIDE * SIDE};
  fum_render_stats stats;
  fum_render_stats_init(&stats);
  assert_int_equal(fum_render(s.scene, &camera, NULL, 1, &pass, &stats), FUM_OK);
  stage_close(&s);
  return stats;
}

static void check_threads(puffs *p) {
  const fum_render_stats one = render_with(p, 1), three = render_with(p, 3);
  assert_true(one.accuracy_count >= 256 && one.accuracy_count <= 1024);
  assert_true(one.accuracy_rms > 0.0 && one.accuracy_rms <= one.accuracy_worst);
  assert_true(one.accuracy_count == three.accuracy_count && one.accuracy_rms == three.accuracy_rms);
  assert_true(one.accuracy_p95 == three.accuracy_p95 && one.accuracy_worst == three.accuracy_worst);
  assert_true(one.accuracy_bias == three.accuracy_bias && one.refinement_count == three.refinement_count);
  puffs_free(p);
}

/* Among many particles, points are found by what is known of hidden samples. */
static void test_threads_change_no_figure(void **state) {
  (void)state;
  puffs few = puffs_random(3000, 5, 1.0F, 0.2F, 2.0F), many = puffs_random(60000, 6, 1.0F, 0.07F, 2.0F);
  check_threads(&few);
  check_threads(&many);
}

int main(void) {
  const struct CMUnitTest tests[] = {
      cmocka_unit_test(test_exact_light_is_brute_force),
      cmocka_unit_test(test_figures_are_those_of_the_errors),
      cmocka_unit_test(test_spoiled_lattice_is_noticed),
      cmocka_unit_test(test_threads_change_no_figure),
  };
  return cmocka_run_group_tests(tests, NULL, NULL);
}
