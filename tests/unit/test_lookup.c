/* SPDX-License-Identifier: GPL-3.0-or-later */
/* The lattice of light asked at single points, on lattices made by hand. */
#include "support.h"

#include "lighting/lattice_spline.h"
#include "lighting/lookup.h"

static const float UNEVEN[4] = {1.0F, 1.5F, 2.75F, 3.25F};

static void test_bow_is_exact_for_parabolas(void **state) {
  (void)state;
  for (int k = 0; k < 20; k++) {
    float ranges[4] = {uniform(100 + (uint64_t)k, -5.0F, 5.0F)}, held[4];
    for (int i = 1; i < 4; i++)
      ranges[i] = ranges[i - 1] + uniform(200 + 4 * (uint64_t)k + (uint64_t)i, 0.2F, 2.0F);
    const float constant = uniform(300 + (uint64_t)k, -1.0F, 1.0F), slope = uniform(400 + (uint64_t)k, -1.0F, 1.0F);
    const float square = uniform(500 + (uint64_t)k, 0.1F, 1.0F) * (k % 2 == 0 ? 1.0F : -1.0F);
    for (int i = 0; i < 4; i++)
      held[i] = constant + ranges[i] * (slope + ranges[i] * square);
    const float length = ranges[2] - ranges[1], expected = -0.25F * square * length * length;
    assert_true(fabsf(fum_lattice_bow(held, ranges) - expected) < 1e-4F * (1.0F + fabsf(expected)));
    /* either side alone says the same */
    for (int side = 0; side < 4; side += 3) {
      float one_sided[4];
      memcpy(one_sided, held, sizeof one_sided);
      one_sided[side] = NAN;
      assert_true(fabsf(fum_lattice_bow(one_sided, ranges) - expected) < 1e-4F * (1.0F + fabsf(expected)));
    }
  }
}

static void test_bow_asks_both_sides(void **state) {
  (void)state;
  const float line[4] = {1.0F, 1.5F, 2.75F, 3.25F}, bend[4] = {0.0F, 1.0F, 1.0F, 2.0F};
  const float alone[4] = {NAN, 1.0F, 3.0F, NAN}, both[4] = {1.0F, 1.0F, 0.0F, -1.0F};
  const float before[4] = {1.0F, 1.0F, 0.0F, NAN}, behind[4] = {NAN, 1.0F, 0.0F, -1.0F};
  assert_true(fum_lattice_bow(line, UNEVEN) == 0.0F);
  assert_true(fum_lattice_bow(bend, UNEVEN) == 0.0F); /* up on one side, down on the other */
  assert_true(fum_lattice_bow(alone, UNEVEN) == 0.0F);
  const float first = fum_lattice_bow(before, UNEVEN), second = fum_lattice_bow(behind, UNEVEN);
  assert_true(first > 0.0F && second > first);
  assert_true(fabsf(fum_lattice_bow(both, UNEVEN) - 0.5F * (first + second)) < 1e-6F);
}

static void test_fill(void **state) {
  (void)state;
  float both[4] = {NAN, 1.0F, 2.0F, NAN}, begin[4] = {5.0F, 1.0F, NAN, 6.0F}, end[4] = {5.0F, NAN, 2.0F, 6.0F};
  float none[4] = {5.0F, NAN, NAN, 6.0F};
  fum_lattice_fill(both);
  assert_true(both[1] == 1.0F && both[2] == 2.0F && isnan(both[0]) && isnan(both[3]));
  fum_lattice_fill(begin);
  assert_true(begin[0] == 5.0F && begin[1] == 1.0F && begin[2] == 1.0F && begin[3] == 6.0F);
  fum_lattice_fill(end);
  assert_true(end[1] == 2.0F && end[2] == 2.0F);
  fum_lattice_fill(none);
  assert_true(none[1] == 0.0F && none[2] == 0.0F);
}

enum { SLABS = 4, FACES = SLABS + 1, LIGHTS = 2, MOST_SAMPLES = FACES * 12 * 12 };

typedef double (*field_fn)(double u, double v, double range);

/* Faces unevenly far apart, each with another grid. */
typedef struct bed {
  fum_face faces[FACES];
  fum_slabs slabs;
  fum_lattice_face grids[FACES];
  float depths[LIGHTS * MOST_SAMPLES];
  fum_lattice lattice;
} bed;

/* The second light holds the field, the first one ten times that; as they are at the samples. */
static void fill_bed(field_fn field, bed *b) {
  static const float ranges[FACES] = {2.0F, 2.5F, 3.5F, 4.0F, 5.5F};
  *b = (bed){0};
  b->slabs = (fum_slabs){.count = SLABS, .faces = b->faces};
  b->lattice = (fum_lattice){.face_count = FACES, .lamp_count = LIGHTS, .faces = b->grids, .depths = b->depths};
  for (int f = 0; f < FACES; f++) {
    b->faces[f].range = ranges[f];
    const float spacing = 0.2F + 0.02F * (float)f;
    b->grids[f] = (fum_lattice_face){.origin = {-1.1F + 0.03F * (float)f, -1.05F - 0.02F * (float)f},
                                     .spacing = {spacing, 1.1F * spacing},
                                     .columns = 12,
                                     .rows = 11,
                                     .first = b->lattice.sample_count};
    b->lattice.sample_count += 12 * 11;
  }
  for (int f = 0; f < FACES; f++) {
    const fum_lattice_face *grid = &b->grids[f];
    for (int32_t i = 0; i < grid->columns * grid->rows; i++) {
      const double u = (double)grid->origin[0] + (double)grid->spacing[0] * (i % grid->columns);
      const double v = (double)grid->origin[1] + (double)grid->spacing[1] * (int)(i / grid->columns);
      const double value = field(u, v, (double)ranges[f]);
      b->depths[grid->first + i] = (float)(10.0 * value);
      b->depths[b->lattice.sample_count + grid->first + i] = (float)value;
    }
  }
}

static void fit_bed(bed *b) {
  stage s = stage_open();
  assert_int_equal(fum_lattice_fit(s.context, &b->lattice), FUM_OK);
  stage_close(&s);
}

static void make_bed(field_fn field, bed *b) {
  fill_bed(field, b);
  fit_bed(b);
}

static double look_up(const bed *b, int32_t light, double u, double v, double range) {
  return fum_lattice_look_up(&b->lattice, &b->slabs, light, (double[2]){u, v}, range);
}

static double constant(double u, double v, double range) {
  (void)u;
  (void)v;
  (void)range;
  return 0.75;
}

static double linear(double u, double v, double range) {
  return 3.0 + 0.5 * u - 0.7 * v + 0.3 * range;
}

static double quadratic(double u, double v, double range) {
  return 4.0 + u * (0.5 + 0.8 * u) - v * (0.3 - 0.6 * v) + 0.4 * u * v + range * (0.2 * u - 0.3 * range + 1.1);
}

static double negative(double u, double v, double range) {
  return -linear(u, v, range);
}

/* Splines whose ends bend evenly are exact for quadratics, and so is the parabola between faces. */
static void test_look_up_is_exact(void **state) {
  (void)state;
  static const field_fn fields[] = {constant, linear, quadratic};
  static bed b;
  for (int k = 0; k < 3; k++) {
    make_bed(fields[k], &b);
    for (uint64_t i = 0; i < 200; i++) {
      const double u = (double)uniform(3 * i, -0.7F, 0.7F), v = (double)uniform(3 * i + 1, -0.7F, 0.7F);
      const double range = (double)uniform(3 * i + 2, 2.0F, 5.5F), expected = fields[k](u, v, range);
      if (fabs(look_up(&b, 1, u, v, range) - expected) > 1e-5 ||
          fabs(look_up(&b, 0, u, v, range) - 10.0 * expected) > 1e-4) {
        fail_msg("field %d at %g %g %g: %.9g is not %.9g", k, u, v, range, look_up(&b, 1, u, v, range), expected);
      }
    }
  }
}

static void test_look_up_beyond_the_lattice(void **state) {
  (void)state;
  static bed b;
  make_bed(constant, &b);
  assert_true(fabs(look_up(&b, 1, 9.0, -9.0, 3.0) - 0.75) < 1e-6);
  make_bed(linear, &b); /* ranges stop at the first and the last face */
  assert_true(fabs(look_up(&b, 1, 0.1, 0.2, 1.0) - linear(0.1, 0.2, 2.0)) < 1e-5);
  assert_true(fabs(look_up(&b, 1, 0.1, 0.2, 9.0) - linear(0.1, 0.2, 5.5)) < 1e-5);
  make_bed(negative, &b);
  assert_true(look_up(&b, 1, 0.1, 0.2, 3.0) == 0.0);
}

/* Slab 1 lies between faces 1 (2.5) and 2 (3.5). */
static void test_look_up_where_nothing_is_held(void **state) {
  (void)state;
  static bed b;
  const double u = 0.1, v = 0.2, range = 2.8;
  make_bed(linear, &b);
  for (int32_t i = 0; i < 12 * 11; i++)
    b.depths[b.lattice.sample_count + b.grids[1].first + i] = NAN;
  assert_true(fabs(look_up(&b, 1, u, v, range) - linear(u, v, 3.5)) < 1e-5);          /* face 2 for both */
  assert_true(fabs(look_up(&b, 0, u, v, range) - 10.0 * linear(u, v, range)) < 1e-4); /* the other light is whole */
  b.grids[2].columns = b.grids[2].rows = 0;
  assert_true(look_up(&b, 1, u, v, range) == 0.0);
  /* one sample among the sixteen is enough to lose a face */
  make_bed(linear, &b);
  const int32_t column = (int32_t)floor((u - (double)b.grids[2].origin[0]) / (double)b.grids[2].spacing[0]);
  const int32_t row = (int32_t)floor((v - (double)b.grids[2].origin[1]) / (double)b.grids[2].spacing[1]);
  b.depths[b.lattice.sample_count + b.grids[2].first + (row + 2) * 12 + column - 1] = NAN;
  assert_true(fabs(look_up(&b, 1, u, v, range) - linear(u, v, 2.5)) < 1e-5);
}

static double noise(double u, double v, double range) {
  (void)range;
  return 1.0 + (double)uniform((uint64_t)(1e6 * (u + 5.0)) * 7919 + (uint64_t)(1e6 * (v + 5.0)), 0.0F, 3.0F);
}

static bool is_lit_around(const bed *b, const fum_lattice_face *grid, int32_t column, int32_t row) {
  for (int32_t r = row - 1; r <= row + 2; r++) {
    for (int32_t c = column - 1; c <= column + 2; c++) {
      if (isnan(b->depths[grid->first + r * grid->columns + c])) return false;
    }
  }
  return true;
}

/* Whatever the samples hold and wherever there are none, splines go through those amid others. */
static void test_splines_meet_the_samples(void **state) {
  (void)state;
  static bed b, fitted;
  int32_t met = 0, missing = 0;
  fill_bed(noise, &b);
  for (int64_t i = 0; i < b.lattice.sample_count; i++) {
    if (uniform(900 + (uint64_t)i, 0.0F, 1.0F) < 0.06F) b.depths[i] = NAN;
  }
  fitted = b;
  fitted.lattice.faces = fitted.grids;
  fitted.lattice.depths = fitted.depths;
  fitted.slabs.faces = fitted.faces;
  fit_bed(&fitted);
  for (int32_t f = 0; f < FACES; f++) {
    const fum_lattice_face *grid = &b.grids[f];
    for (int32_t i = 0; i < grid->columns * grid->rows; i++) {
      const int32_t column = i % grid->columns, row = i / grid->columns;
      assert_int_equal(isnan(b.depths[grid->first + i]), isnan(fitted.depths[grid->first + i]));
      missing += isnan(b.depths[grid->first + i]);
      if (column < 1 || row < 1 || column > grid->columns - 3 || row > grid->rows - 3) continue;
      if (!is_lit_around(&b, grid, column, row)) continue;
      /* a little past the sample, so that rounding takes none before it */
      const double u = (double)grid->origin[0] + (double)grid->spacing[0] * (column + 1e-6);
      const double v = (double)grid->origin[1] + (double)grid->spacing[1] * (row + 1e-6);
      const double found = look_up(&fitted, 0, u, v, (double)b.faces[f].range);
      const double expected = (double)b.depths[grid->first + i];
      if (fabs(found - expected) > 1e-3) fail_msg("face %d at %d %d: %g is not %g", f, column, row, found, expected);
      met++;
    }
  }
  assert_true(missing > 10 && met > 100);
}

static double gaussian(double u, double v, double range) {
  const double sigma = 0.3;
  (void)range;
  return exp(-0.5 * (u * u + v * v) / (sigma * sigma));
}

/* A Gaussian sampled up to a sigma apart: cubics through four samples alone are off by 8 % of its peak. */
static void test_splines_are_close(void **state) {
  (void)state;
  static bed b;
  double worst = 0.0;
  make_bed(gaussian, &b);
  for (int f = 0; f < FACES; f++) {
    for (uint64_t i = 0; i < 400; i++) {
      const double u = (double)uniform(2 * i, -0.4F, 0.4F), v = (double)uniform(2 * i + 1, -0.4F, 0.4F);
      worst = fmax(worst, fabs(look_up(&b, 1, u, v, (double)b.faces[f].range) - gaussian(u, v, 0.0)));
    }
  }
  if (worst > 0.035) fail_msg("off by %g", worst);
}

int main(void) {
  const struct CMUnitTest tests[] = {
      cmocka_unit_test(test_bow_is_exact_for_parabolas),
      cmocka_unit_test(test_bow_asks_both_sides),
      cmocka_unit_test(test_fill),
      cmocka_unit_test(test_look_up_is_exact),
      cmocka_unit_test(test_look_up_beyond_the_lattice),
      cmocka_unit_test(test_look_up_where_nothing_is_held),
      cmocka_unit_test(test_splines_meet_the_samples),
      cmocka_unit_test(test_splines_are_close),
  };
  return cmocka_run_group_tests(tests, NULL, NULL);
}
