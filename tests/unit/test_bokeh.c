/* SPDX-License-Identifier: GPL-3.0-or-later */
/* A Gaussian out of focus against its mean over points of the aperture. */
#include "support.h"

#include "base/vector.h"
#include "billboard/bokeh.h"

static const struct {
  int32_t blades;
  float rotation, ratio;
} APERTURES[] = {{0, 0.0F, 1.0F}, {0, 0.0F, 2.0F}, {3, 0.3F, 1.0F}, {5, 1.0F, 1.0F}, {6, 0.0F, 0.7F}, {64, 0.0F, 1.0F}};
enum { APERTURES_COUNT = sizeof APERTURES / sizeof *APERTURES };

static fum_camera camera_with(int k) {
  fum_camera camera;
  fum_camera_init(&camera);
  camera.aperture_radius = 0.1;
  camera.aperture_blades = APERTURES[k].blades;
  camera.aperture_rotation = APERTURES[k].rotation;
  camera.aperture_ratio = APERTURES[k].ratio;
  return camera;
}

/* Strips of the aperture: across each one Gaussian's mean is a difference of normal distribution functions. */
static double brute(const fum_aperture *a, double confusion, double width, double x, double y) {
  const int strips = 2000;
  const double reach = a->extent, step = 2.0 * reach / strips;
  double sum = 0.0;
  for (int i = 0; i < strips; i++) {
    double ends[2];
    const double height = -reach + (i + 0.5) * step;
    const double away = (height * confusion - y) / width;
    if (fabs(away) > 7.0 || !fum_aperture_cut(a, height, ends)) continue;
    const double low = (ends[0] * confusion - x) / width, high = (ends[1] * confusion - x) / width;
    sum += exp(-0.5 * away * away) * fabs(erfc(-sqrt(0.5) * high) - erfc(-sqrt(0.5) * low));
  }
  return sum * step * 0.5 * FUM_SQRT_2PI * width / fabs(confusion) / a->area;
}

static double value_at(const fum_bokeh *b, int32_t level, double x, double y) {
  const fum_bokeh_level *l = &b->levels[level];
  const double column = x * (double)l->per_unit + l->side / 2, row = y * (double)l->per_unit + l->side / 2;
  if (!(column >= 0.0 && row >= 0.0 && column < l->side - 1 && row < l->side - 1)) return 0.0;
  const int i = (int)column, j = (int)row;
  const float *v = b->values + (int64_t)(l->first + j) * b->width + i;
  const double u = column - i, below = (double)v[0] + u * (double)(v[1] - v[0]);
  const double above = (double)v[b->width] + u * (double)(v[b->width + 1] - v[b->width]);
  return below + (row - j) * (above - below);
}

static double look_up(const fum_bokeh *b, double confusion, double width, double x, double y) {
  const double squared = width * width, variances[3] = {squared, 0.0, squared};
  const fum_bokeh_place p = fum_bokeh_at(b, confusion, variances);
  const double u = x * (double)p.units[0] + y * (double)p.units[1];
  const double v = x * (double)p.units[1] + y * (double)p.units[2], blend = (double)p.blend;
  return (double)p.density * squared *
         (value_at(b, p.level, u, v) * (1.0 - blend) + value_at(b, p.level + 1, u, v) * blend);
}

/* At any ratio of confusion and width, on lines in many directions: within a hundredth of the peak. */
static void test_tables_are_convolutions(void **state) {
  (void)state;
  fum_context *context = NULL;
  assert_int_equal(fum_context_create(&context), FUM_OK);
  for (int k = 0; k < APERTURES_COUNT; k++) {
    const fum_camera camera = camera_with(k);
    fum_bokeh bokeh;
    fum_aperture aperture;
    fum_aperture_find(&camera, &aperture);
    assert_int_equal(fum_bokeh_find(context, &camera, &bokeh), FUM_OK);
    for (double ratio = 0.36; ratio < 60.0; ratio *= 1.45) {
      const double confusion = 0.3 * (k % 2 == 0 ? 1.0 : -1.0), width = 0.3 / ratio;
      double worst = 0.0, peak = 0.0;
      for (int n = 0; n < 100; n++) {
        const double angle = 2.39996 * n, radius = (0.3 * aperture.extent + 3.0 * width) * sqrt((n + 0.5) / 100.0);
        const double x = radius * cos(angle), y = radius * sin(angle);
        const double expected = brute(&aperture, confusion, width, x, y);
        peak = fmax(peak, expected);
        worst = fmax(worst, fabs(look_up(&bokeh, confusion, width, x, y) - expected));
      }
      if (worst > 0.01 * peak) fail_msg("aperture %d, ratio %.3g: off by %.3g of the peak", k, ratio, worst / peak);
    }
    fum_bokeh_free(context, &bokeh);
  }
  assert_int_equal(atomic_load(&context->memory_bytes), 0);
  fum_context_destroy(context);
}

static void assert_close(double found, double expected) {
  if (!(fabs(found - expected) < 1e-12)) fail_msg("%.15g is not %.15g", found, expected);
}

/* Areas and moments of apertures whose closed forms are known. */
static void test_moments_of_apertures(void **state) {
  (void)state;
  fum_camera camera;
  fum_aperture a;
  fum_camera_init(&camera);
  fum_aperture_find(&camera, &a);
  assert_close(a.area, FUM_PI);
  assert_close(a.variance, 0.25);
  camera.aperture_blades = 4; /* a square of side sqrt 2 */
  fum_aperture_find(&camera, &a);
  assert_close(a.area, 2.0);
  assert_close(a.variance, 2.0 / 12.0);
  camera.aperture_ratio = 2.0F;
  fum_aperture_find(&camera, &a);
  assert_close(a.area, 1.0);
  assert_close(a.variance, 0.625 * 2.0 / 12.0);
}

int main(void) {
  const struct CMUnitTest tests[] = {cmocka_unit_test(test_tables_are_convolutions),
                                     cmocka_unit_test(test_moments_of_apertures)};
  return cmocka_run_group_tests(tests, NULL, NULL);
}
