/* SPDX-License-Identifier: GPL-3.0-or-later */
/* Smooth smoke on a coarser grid: splines against closed forms, and which tiles are drawn pixel by pixel. */
#include "support.h"

#include "api/lighting.h"
#include "base/vector.h"
#include "billboard/coarse.h"
#include "billboard/coarse_error.h"
#include "billboard/coarse_grid.h"

enum { POINTS = 40, MOST_SIDE = POINTS * FUM_SPLINE_STEPS };

typedef double (*picture_fn)(double x, double y, int channel);

static double constant(double x, double y, int channel) {
  (void)x;
  (void)y;
  return 3.0 + channel;
}

static double linear(double x, double y, int channel) {
  return 1.0 + 0.3 * x - 0.2 * y * (channel + 1);
}

/* Sigma 1.4 points, its middle between points. */
static double gaussian(double x, double y, int channel) {
  const double u = x - 19.3 - channel, v = y - 18.6;
  return exp(-0.5 * (u * u + v * v) / (1.4 * 1.4));
}

/* The same with its middle at the picture's edge. */
static double gaussian_at_edge(double x, double y, int channel) {
  return gaussian(x + 19.3, y, channel);
}

/* The largest error of a spline through the picture's points, from `margin` points off the ends on. */
static double worst_error(picture_fn picture, int32_t channels, int32_t step, int32_t margin) {
  static float values[4 * POINTS * POINTS], row[4 * POINTS], out[4 * MOST_SIDE];
  const fum_spline spline = {.columns = POINTS, .rows = POINTS, .channels = channels, .values = values};
  const fum_spline_taps taps = fum_spline_find_taps(step);
  const int32_t from = margin * step, count = (POINTS - 2 * margin) * step;
  double worst = 0.0;
  stage s = stage_open();
  for (int i = 0; i < channels * POINTS * POINTS; i++)
    values[i] = (float)picture(i / channels % POINTS, i / channels / POINTS, i % channels);
  fum_spline_fit(s.context, &spline);
  for (int32_t y = from; y < from + count; y++) {
    fum_spline_row(&spline, &taps, y, from, count, row);
    fum_spline_points(&taps, channels, row, from, count, out);
    for (int32_t i = 0; i < channels * count; i++) {
      const double at[2] = {(from + i / channels + 0.5) / step - 0.5, (y + 0.5) / step - 0.5};
      worst = fmax(worst, fabs((double)out[i] - picture(at[0], at[1], i % channels)));
    }
  }
  stage_close(&s);
  return worst;
}

static void test_splines(void **state) {
  (void)state;
  for (int32_t step = 2; step <= FUM_SPLINE_STEPS; step *= 2) {
    for (int32_t channels = 3; channels <= 4; channels++) {
      assert_true(worst_error(constant, channels, step, 3) < 1e-5);
      assert_true(worst_error(linear, channels, step, 3) < 1e-5);
      assert_true(worst_error(gaussian, channels, step, 3) < 1.3e-3);
      /* cut by the end of the samples, which is as many points beside the picture as pictures have it */
      assert_true(worst_error(gaussian_at_edge, channels, step, FUM_COARSE_MARGIN) < 1e-4);
    }
  }
}

/* Waves: rough only where a spline loses more than is allowed, and always where it loses six times as much. */
static void test_roughness(void **state) {
  (void)state;
  static float values[4 * POINTS * POINTS], pixels[1];
  const int32_t x[2] = {12, 27}, y[2] = {12, 27};
  stage s = stage_open();
  for (int k = 4; k <= 28; k++) {
    const double w = 0.1 * k, lost = 2.0 / (1.0 + pow(2.0 * FUM_PI / w - 1.0, 6.0)), height = 0.01;
    for (int i = 0; i < 4 * POINTS * POINTS; i++)
      values[i] = (float)(0.5 + height * cos(w * (i / 4 % POINTS) + 0.3));
    fum_coarse_plane plane = {.spline = {POINTS, POINTS, 4, values}, .pixels = pixels};
    assert_int_equal(fum_coarse_find_means(s.context, 1, &plane), FUM_OK);
    assert_true(fabsf(plane.means[3] - 0.5F) < 0.01F);
    /* opacity may be off by a fifth of the tolerance, of itself and the mean */
    const double share = height * lost / (0.2 * (0.5 + 0.5));
    assert_true(fum_coarse_is_rough(&plane, (float)(share / 6.0), x, y));
    assert_false(fum_coarse_is_rough(&plane, (float)(share * 6.0), x, y));
  }
  stage_close(&s);
}

/* Whatever a picture is drawn from. */
typedef struct set_up {
  stage s;
  fum_view view;
  fum_lighting lighting;
  fum_slabs slabs;
  fum_lattice lattice;
  fum_tile_class classes[FUM_MAX_CLASSES];
  fum_tile_job job;
} set_up;

enum { WIDTH = 400, HEIGHT = 300 };

static void begin(const puffs *p, float *rgba, set_up *u) {
  fum_camera camera;
  fum_settings settings;
  memset(u, 0, sizeof *u);
  u->s = stage_open();
  add_puffs(u->s.scene, p);
  fum_camera_init(&camera);
  camera.width = WIDTH;
  camera.height = HEIGHT;
  camera.world_from_camera[11] = 6.0;
  memcpy(camera.window, (double[4]){-0.4, 0.4, -0.3, 0.3}, sizeof camera.window);
  fum_settings_init(&settings);
  fum_context *context = u->s.context;
  assert_int_equal(fum_view_init(context, &camera, &u->view), FUM_OK);
  assert_int_equal(fum_caches_update(u->s.scene, &settings), FUM_OK);
  fum_view_place(&u->view, u->s.scene->origin);
  const fum_octree *all = u->s.scene->caches->all;
  assert_int_equal(fum_lighting_begin(u->s.scene, &settings, all, &u->lighting), FUM_OK);
  u->job = (fum_tile_job){.scene = u->s.scene,
                          .octree = all,
                          .view = &u->view,
                          .slabs = &u->slabs,
                          .lattice = &u->lattice,
                          .lamps = &u->lighting.lamps,
                          .rgba = rgba};
  assert_int_equal(fum_tiles_find_looks(u->s.scene, u->classes, &u->job), FUM_OK);
  assert_int_equal(fum_slabs_find(context, all, &u->view, NULL, 0.01F, 0.01F, 0.0F, &u->slabs), FUM_OK);
  memset(rgba, 0, 4 * WIDTH * HEIGHT * sizeof *rgba);
}

static fum_coarse_report draw_coarse(set_up *u) {
  const fum_splats_options options = {.footprints = fum_footprints_find(4.0, 3.5)};
  fum_splats splats = {0};
  fum_coarse_report report;
  u->job.splats = &splats;
  assert_int_equal(fum_coarse_draw(u->s.context, &u->job, &options, 0.01F, &splats, &report), FUM_OK);
  fum_splats_free(u->s.context, &splats);
  return report;
}

static void end(set_up *u) {
  fum_free(u->s.context, &u->job.class_of);
  fum_slabs_free(u->s.context, &u->slabs);
  fum_lighting_end(u->s.context, &u->lighting);
  stage_close(&u->s);
}

/* Pixels are 0.012 wide where the particles are. */
static void test_step_follows_the_particles(void **state) {
  (void)state;
  static float rgba[4 * WIDTH * HEIGHT];
  const struct {
    float radius;
    int32_t step;
  } cases[] = {{0.02F, 1}, {0.1F, 2}, {0.3F, 4}, {0.6F, 4}};
  for (size_t i = 0; i < sizeof cases / sizeof *cases; i++) {
    set_up u;
    puffs p = puffs_random(2000, 3, 1.0F, cases[i].radius, 0.01F / cases[i].radius);
    begin(&p, rgba, &u);
    const fum_coarse_report report = draw_coarse(&u);
    assert_int_equal(report.step, cases[i].step);
    assert_int_equal(report.seen_count, 2000);
    if (report.step > 1) assert_true(10 * report.fine_count < report.tile_count);
    end(&u);
    puffs_free(&p);
  }
}

/* One narrow particle among many makes the tiles fine that it touches or nearly does, and no others. */
static void test_one_narrow_particle(void **state) {
  (void)state;
  static float rgba[4 * WIDTH * HEIGHT];
  set_up u;
  puffs p = puffs_random(2000, 3, 1.0F, 0.2F, 0.05F);
  begin(&p, rgba, &u);
  const fum_coarse_report without = draw_coarse(&u);
  end(&u);
  p.radii[7] = 0.01F;
  p.densities[7] = 50.0F;
  begin(&p, rgba, &u);
  const fum_coarse_report with = draw_coarse(&u);
  end(&u);
  puffs_free(&p);
  assert_true(with.step == without.step && with.step > 1);
  assert_int_equal(without.fine_count, 0);
  assert_true(with.fine_count >= 1 && with.fine_count <= 9);
}

/* Tiles with a solid are fine; where most of the smoke is in them, all are. */
static void test_solids(void **state) {
  (void)state;
  static float rgba[4 * WIDTH * HEIGHT], depths[WIDTH * HEIGHT];
  puffs p = puffs_random(2000, 3, 1.0F, 0.2F, 0.05F);
  for (int32_t columns = 0; columns <= WIDTH; columns += 100) {
    set_up u;
    begin(&p, rgba, &u);
    for (int32_t i = 0; i < WIDTH * HEIGHT; i++)
      depths[i] = i % WIDTH < columns ? 6.0F : (float)u.view.clip_end;
    u.job.solid_depths = depths;
    const fum_coarse_report report = draw_coarse(&u);
    assert_int_equal(report.step > 1, columns < WIDTH / 2);
    if (report.step > 1) {
      const int64_t fine = (columns + FUM_TILE - 1) / FUM_TILE * ((HEIGHT + FUM_TILE - 1) / FUM_TILE);
      assert_true(report.fine_count <= fine && (columns == 0 || 2 * report.fine_count > fine));
    }
    end(&u);
  }
  puffs_free(&p);
}

int main(void) {
  const struct CMUnitTest tests[] = {
      cmocka_unit_test(test_splines),
      cmocka_unit_test(test_roughness),
      cmocka_unit_test(test_step_follows_the_particles),
      cmocka_unit_test(test_one_narrow_particle),
      cmocka_unit_test(test_solids),
  };
  return cmocka_run_group_tests(tests, NULL, NULL);
}
