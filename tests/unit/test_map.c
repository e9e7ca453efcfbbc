/* SPDX-License-Identifier: GPL-3.0-or-later */
/* Maps on billboards: their levels, and how a particle's is seen. */
#include "support.h"

#include "billboard/map_look.h"

static const double SIZES[][2] = {{1, 1}, {2, 2}, {16, 16}, {7, 5}, {1, 9}, {33, 12}};
enum { SIZE_COUNT = sizeof SIZES / sizeof *SIZES };

/* Random straight RGBA. */
static float *make_pixels(int32_t width, int32_t height, uint64_t seed) {
  float *pixels = malloc(4 * (size_t)width * (size_t)height * sizeof *pixels);
  assert_non_null(pixels);
  for (int64_t i = 0; i < 4 * (int64_t)width * height; i++)
    pixels[i] = uniform(seed + (uint64_t)i, 0.0F, 1.0F);
  return pixels;
}

static fum_map *make_map(fum_context *context, int32_t width, int32_t height, const float *pixels) {
  fum_map *map = NULL;
  assert_int_equal(fum_map_create(context, "test", width, height, pixels, &map), FUM_OK);
  return map;
}

static double gauss(double x) {
  return exp(-0.5 * x * x) / 2.50662827463100050242;
}

/* Mean of a channel of one level over the plane, weighted with the Gaussian: a sum over points. */
static double brute_mean(const float *texels, int32_t width, int32_t height, int channel) {
  enum { STEPS = 960 };
  const double step = 12.0 / STEPS;
  double sum = 0.0;
  for (int j = 0; j < STEPS; j++) {
    for (int i = 0; i < STEPS; i++) {
      const double x = -6.0 + (i + 0.5) * step, y = -6.0 + (j + 0.5) * step;
      const fum_map_texel t = fum_map_bilinear(texels, width, height, (float)(0.5 + 0.25 * x), (float)(0.5 + 0.25 * y));
      sum += gauss(x) * gauss(y) * step * step * (double)t[channel];
    }
  }
  return sum;
}

static void test_every_level_has_the_same_means(void **state) {
  (void)state;
  stage s = stage_open();
  for (int n = 0; n < SIZE_COUNT; n++) {
    const int32_t width = (int32_t)SIZES[n][0], height = (int32_t)SIZES[n][1];
    float *pixels = make_pixels(width, height, 10U * (uint64_t)n);
    fum_map *map = make_map(s.context, width, height, pixels);
    double first[4] = {0.0};
    const float *level = map->texels;
    int32_t w = width, h = height, k = 0;
    for (;; k++) {
      for (int c = 0; c < 4; c++) {
        const double mean = brute_mean(level, w, h, c);
        if (k == 0) first[c] = mean;
        assert_true(fabs(mean - (c == 3 ? 1.0 : first[c])) < 3e-5);
      }
      level += 4 * (int64_t)w * h;
      if (w == 1 && h == 1) break;
      w = fum_map_half(w);
      h = fum_map_half(h);
    }
    assert_int_equal(k + 1, map->level_count);
    assert_int_equal((level - map->texels) / 4, map->texel_count);
    fum_map_drop(s.context, &map);
    free(pixels);
  }
  stage_close(&s);
}

/* Up to the factors that keep its means a level holds averages of areas of the first one's opacity, and of colour times
 * opacity. */
static void test_levels_average_areas(void **state) {
  (void)state;
  enum { FINE = 840 }; /* points a side, a multiple of all sides */
  stage s = stage_open();
  const int32_t width = 7, height = 12;
  float *pixels = make_pixels(width, height, 3);
  fum_map *map = make_map(s.context, width, height, pixels);
  const float *level = map->texels + 4 * (int64_t)width * height; /* 3 x 6 */
  for (int c = 0; c < 4; c++) {
    double factor = 0.0;
    for (int32_t texel = 0; texel < 18; texel++) {
      double sum = 0.0;
      for (int j = 0; j < 2; j++) { /* rows 2 y and 2 y + 1 are whole */
        for (int i = 0; i < FINE / 3; i++) {
          const int32_t x = (texel % 3 * (FINE / 3) + i) * width / FINE, y = texel / 3 * 2 + j;
          const float *pixel = pixels + 4 * (y * width + x);
          sum += (double)pixel[3] * (c < 3 ? (double)pixel[c] : 1.0) / (2.0 * FINE / 3.0);
        }
      }
      if (texel == 0) factor = (double)level[c] / sum;
      assert_true(fabs((double)level[4 * texel + c] - factor * sum) < 1e-5);
    }
    assert_true(factor > 1.0 && factor < 3.0); /* over the mean opacity, about a half */
  }
  fum_map_drop(s.context, &map);
  free(pixels);
  stage_close(&s);
}

static void test_constant_map_changes_nothing(void **state) {
  (void)state;
  stage s = stage_open();
  float pixels[4 * 15];
  for (int i = 0; i < 15; i++)
    memcpy(pixels + 4 * i, (float[4]){1.0F, 1.0F, 1.0F, 0.3F}, 4 * sizeof *pixels);
  fum_map *map = make_map(s.context, 5, 3, pixels);
  for (int64_t i = 0; i < 4 * map->texel_count; i++)
    assert_true(fabsf(map->texels[i] - 1.0F) < 1e-6F);
  assert_false(map->is_colored);
  assert_true(fabsf(map->edge - 1.0F) < 1e-6F && fabsf(map->contrast - 1.0F) < 1e-6F);
  fum_map_drop(s.context, &map);
  stage_close(&s);
}

/* Opaque in one half: twice as thick there. */
static void test_half_a_map(void **state) {
  (void)state;
  stage s = stage_open();
  float pixels[4 * 64 * 64];
  for (int i = 0; i < 64 * 64; i++)
    memcpy(pixels + 4 * i, (float[4]){1.0F, 0.5F, 1.0F, i % 64 < 32 ? 0.8F : 0.0F}, 4 * sizeof *pixels);
  fum_map *map = make_map(s.context, 64, 64, pixels);
  assert_true(fabsf(map->texels[3] - 2.0F) < 1e-4F && map->texels[4 * 63 + 3] == 0.0F);
  assert_true(fabsf(map->texels[1] - 1.0F) < 1e-4F && map->is_colored);
  assert_true(fabsf(map->edge - 2.0F) < 1e-4F && fabsf(map->contrast - 2.0F) < 0.02F);
  const float *mean = map->texels + 4 * (map->texel_count - 1);
  assert_true(fabsf(mean[3] - 1.0F) < 1e-6F && fabsf(mean[1] - 0.5F) < 1e-6F);
  fum_map_drop(s.context, &map);
  stage_close(&s);
}

static void assert_refused(fum_context *context, int32_t width, int32_t height, const float *pixels,
                           const char *expected) {
  fum_map *map = NULL;
  assert_int_equal(fum_map_create(context, "Puff", width, height, pixels, &map), FUM_ERROR_ARGUMENT);
  assert_null(map);
  assert_string_equal(fum_last_error(context), expected);
}

static void test_bad_maps_are_refused(void **state) {
  (void)state;
  stage s = stage_open();
  float pixels[4 * 4] = {0.0F};
  assert_refused(s.context, 0, 2, pixels, "Puff: a map of 0 x 2 pixels; each must be within 1..16384");
  assert_refused(s.context, 2, 16385, pixels, "Puff: a map of 2 x 16385 pixels; each must be within 1..16384");
  assert_refused(s.context, 2, 2, pixels, "Puff: the map is transparent: its mean opacity is 0");
  pixels[4 * 3 + 1] = 1.5F;
  assert_refused(s.context, 2, 2, pixels, "Puff: the map's pixel 1, 1 holds 1.5, not within 0..1");
  pixels[4 * 3 + 1] = NAN;
  fum_map *map = NULL;
  assert_int_equal(fum_map_create(s.context, "Puff", 2, 2, pixels, &map), FUM_ERROR_ARGUMENT);
  stage_close(&s);
}

/* Sets with the same pixels share a map, and give it back with the scene. */
static void test_sets_share_a_map(void **state) {
  (void)state;
  stage s = stage_open();
  float *pixels = make_pixels(8, 8, 1);
  const float position[3] = {0.0F};
  fum_particles_desc desc;
  fum_particles_desc_init(&desc);
  desc.count = 1;
  desc.positions = position;
  desc.map = pixels;
  desc.map_width = desc.map_height = 8;
  for (int k = 0; k < 3; k++) {
    if (k == 2) pixels[7] *= 0.5F;
    assert_int_equal(fum_scene_add_particles(s.scene, &desc), FUM_OK);
  }
  const fum_particles *sets = s.scene->particles;
  assert_ptr_equal(sets[0].map, sets[1].map);
  assert_int_equal(sets[0].map->user_count, 2);
  assert_ptr_not_equal(sets[0].map, sets[2].map);
  free(pixels);
  stage_close(&s);
}

static fum_view make_view(int32_t type) {
  return (fum_view){.type = type, .width = 100, .height = 100, .window = {-0.5, 0.5, -0.5, 0.5}};
}

/* Where a ray meets the map, from the middle, in sigmas. */
static void find_place(const fum_map_look *look, int32_t type, float u, float v, double out[2]) {
  const float per_length = type == FUM_CAMERA_PERSPECTIVE ? 1.0F / sqrtf(1.0F + u * u + v * v) : 1.0F;
  out[0] = 4.0 * (double)(fum_map_across(look->across, u, v) * per_length);
  out[1] = 4.0 * (double)(fum_map_across(look->up, u, v) * per_length);
}

/* The place is as far from the middle as the ray is from the centre, on the side where it passes, turned by the id. */
static void test_rays_meet_the_map_where_they_pass_the_particle(void **state) {
  (void)state;
  stage s = stage_open();
  float *pixels = make_pixels(8, 8, 1);
  fum_map *map = make_map(s.context, 8, 8, pixels);
  uint64_t ids[2] = {17, 99};
  const fum_particles set = {.map = map, .ids = ids};
  const double center[3] = {0.7, -0.4, -2.0}, sigma = 0.3;
  for (int32_t type = FUM_CAMERA_PERSPECTIVE; type <= FUM_CAMERA_ORTHOGRAPHIC; type++) {
    const fum_view view = make_view(type);
    for (int64_t i = 0; i < 2; i++) {
      const double turn = 2.0 * FUM_PI * fum_hash_unit(ids[i]), depth = type == FUM_CAMERA_PERSPECTIVE ? 2.0 : 1.0;
      const double middle[2] = {center[0] / depth, center[1] / depth}, beside = 0.01;
      fum_map_look look;
      double at[2];
      fum_map_look_find(&set, i, &view, center, sigma, sigma, &look);
      find_place(&look, type, (float)middle[0], (float)middle[1], at);
      assert_true(hypot(at[0], at[1]) < 1e-5);
      find_place(&look, type, (float)(middle[0] + beside), (float)middle[1], at);
      assert_true(fabs(remainder(atan2(at[1], at[0]) + turn, 2.0 * FUM_PI)) < 0.05);
      const float ray[3] = {(float)(middle[0] + beside), (float)(middle[1] + 2.0 * beside), -1.0F};
      const double across[3] = {center[1] * -1.0 - center[2] * (double)ray[1],
                                center[2] * (double)ray[0] + center[0], /* centre x ray */
                                center[0] * (double)ray[1] - center[1] * (double)ray[0]};
      const double length = sqrt((double)(ray[0] * ray[0] + ray[1] * ray[1]) + 1.0);
      const double distance = type == FUM_CAMERA_PERSPECTIVE
                                  ? sqrt(across[0] * across[0] + across[1] * across[1] + across[2] * across[2]) / length
                                  : sqrt(5.0) * beside;
      find_place(&look, type, ray[0], ray[1], at);
      assert_true(fabs(hypot(at[0], at[1]) - distance / sigma) < 1e-4 * distance / sigma);
    }
  }
  fum_map_drop(s.context, &map);
  free(pixels);
  stage_close(&s);
}

/* Texels are about as wide as pixels, or more; of a particle that is widened the mean alone is left. */
static void test_levels_follow_the_size_of_pixels(void **state) {
  (void)state;
  stage s = stage_open();
  float *pixels = make_pixels(64, 64, 1);
  fum_map *map = make_map(s.context, 64, 64, pixels);
  const fum_particles set = {.map = map};
  const fum_view view = make_view(FUM_CAMERA_ORTHOGRAPHIC); /* a pixel is 0.01 wide */
  const double center[3] = {0.0, 0.0, -1.0};
  fum_map_look look;
  double last = 0.0;
  for (double sigma = 2.0; sigma > 0.002; sigma *= 0.99) {
    const double width = fmax(sigma, 0.006);
    fum_map_look_find(&set, 0, &view, center, sigma, width, &look);
    const double texel = 4.0 * width / look.width / 0.01; /* pixels */
    const double level = log2(64.0 / look.width) + (double)look.blend;
    if (look.width == 64 && look.blend == 0.0F) assert_true(texel > 1.4);
    if (look.width < 64 && width == sigma) assert_true(texel > 0.7 && texel * exp2((double)look.blend) < 2.9);
    assert_true(level >= last && level - last < (sigma > 0.006 ? 0.02 : 0.35)); /* no jumps */
    last = level;
  }
  assert_int_equal(look.width, 1);
  assert_int_equal(look.begin, map->texel_count - 1);
  fum_map_drop(s.context, &map);
  free(pixels);
  stage_close(&s);
}

int main(void) {
  const struct CMUnitTest tests[] = {
      cmocka_unit_test(test_every_level_has_the_same_means),
      cmocka_unit_test(test_levels_average_areas),
      cmocka_unit_test(test_constant_map_changes_nothing),
      cmocka_unit_test(test_half_a_map),
      cmocka_unit_test(test_bad_maps_are_refused),
      cmocka_unit_test(test_sets_share_a_map),
      cmocka_unit_test(test_rays_meet_the_map_where_they_pass_the_particle),
      cmocka_unit_test(test_levels_follow_the_size_of_pixels),
  };
  return cmocka_run_group_tests(tests, NULL, NULL);
}
