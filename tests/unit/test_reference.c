/* SPDX-License-Identifier: GPL-3.0-or-later */
/* The reference against closed forms and plain quadrature, one ray at a time. */
#include "support.h"

#include "reference/smoke.h"

static const double PI = 3.14159265358979323846, ROOT_2PI = 2.50662827463100050242;

static void assert_close(double value, double expected, double relative) {
  if (!(fabs(value - expected) <= relative * fabs(expected) + 1e-40)) fail_msg("%.12g is not %.12g", value, expected);
}

/* A ray down from (x, y, 10). */
static fum_camera ray_at(double x, double y) {
  fum_camera camera;
  fum_camera_init(&camera);
  camera.type = FUM_CAMERA_ORTHOGRAPHIC;
  camera.width = camera.height = 1;
  const double half = 1e-6;
  for (int i = 0; i < 4; i++)
    camera.window[i] = i % 2 == 0 ? -half : half;
  camera.world_from_camera[3] = x;
  camera.world_from_camera[7] = y;
  camera.world_from_camera[11] = 10.0;
  camera.clip_start = 0.0;
  camera.clip_end = 100.0;
  return camera;
}

typedef struct pixel {
  double rgba[4], depth;
  fum_reference_stats stats;
} pixel;

static pixel render_ray(fum_scene *scene, const fum_camera *camera, double tolerance) {
  fum_reference_settings settings;
  fum_reference_settings_init(&settings);
  settings.tolerance = tolerance;
  pixel p;
  fum_reference_stats_init(&p.stats);
  assert_int_equal(fum_reference_render(scene, camera, &settings, p.rgba, 4, &p.depth, 1, &p.stats), FUM_OK);
  return p;
}

static pixel trace(fum_scene *scene, double x, double y) {
  const fum_camera camera = ray_at(x, y);
  return render_ray(scene, &camera, 1e-8);
}

static void add_particle(fum_scene *scene, const float position[3], float sigma, float density, float emission,
                         float g) {
  fum_particles_desc desc;
  fum_particles_desc_init(&desc);
  desc.count = 1;
  desc.positions = position;
  desc.radius = 2.0F * sigma;
  desc.density = density;
  desc.anisotropy = g;
  for (int c = 0; c < 3; c++) {
    desc.albedo[c] = 0.25F * (float)(c + 1);
    desc.emission[c] = emission * (float)(c + 1);
  }
  assert_int_equal(fum_scene_add_particles(scene, &desc), FUM_OK);
}

/* A sun of irradiance 2 that shines along `towards`. */
static void add_sun(fum_scene *scene, const double towards[3]) {
  fum_light_desc desc;
  fum_light_desc_init(&desc);
  desc.type = FUM_LIGHT_SUN;
  const int k = fabs(towards[0]) > 0.5 ? 1 : 0; /* any axes across */
  for (int row = 0; row < 3; row++) {
    desc.intensity[row] = 2.0F;
    desc.world_from_light[4 * row + 2] = -towards[row];
    desc.world_from_light[4 * row] = row == k ? 1.0 : 0.0;
    desc.world_from_light[4 * row + 1] = 0.0;
  }
  for (int row = 0; row < 3; row++) {
    const double *m = desc.world_from_light;
    const int a = (row + 1) % 3, b = (row + 2) % 3;
    desc.world_from_light[4 * row + 1] = m[4 * a + 2] * m[4 * b] - m[4 * b + 2] * m[4 * a];
  }
  assert_int_equal(fum_scene_add_light(scene, &desc), FUM_OK);
}

static double phase(double g, double cosine) {
  return (1 - g * g) / (4 * PI * pow(1 + g * g - 2 * g * cosine, 1.5));
}

/* Composite Simpson's rule with many steps. */
static double simpson(double (*f)(double t, const void *user), const void *user, double a, double b) {
  const int steps = 20000;
  const double h = (b - a) / steps;
  double sum = f(a, user) + f(b, user);
  for (int i = 1; i < steps; i++)
    sum += (i % 2 == 1 ? 4.0 : 2.0) * f(a + i * h, user);
  return sum * h / 3.0;
}

static void test_alpha_is_that_of_every_particle(void **state) {
  (void)state;
  for (int kind = 0; kind < 3; kind++) {
    const int64_t counts[] = {1, 200, 3000};
    puffs p = puffs_random(counts[kind], 7, 1.0F, kind == 2 ? 0.1F : 0.6F, 1.5F);
    for (int64_t i = 0; i < p.count; i += 3)
      p.radii[i] *= 0.01F;
    stage s = stage_open();
    add_puffs(s.scene, &p);
    for (int i = 0; i < 10; i++) {
      const double x = (double)uniform((uint64_t)i, -1.2F, 1.2F), y = (double)uniform((uint64_t)i + 99, -1.2F, 1.2F);
      const double depth = brute_depth(&p, (double[3]){x, y, 10.0}, (double[3]){x, y, -90.0});
      assert_true(fabs(trace(s.scene, x, y).rgba[3] + expm1(-depth)) < 1e-9);
    }
    stage_close(&s);
    puffs_free(&p);
  }
}

static void test_depth_towards_lights_is_that_of_every_particle(void **state) {
  (void)state;
  puffs p = puffs_random(3000, 3, 1.0F, 0.2F, 3.0F);
  for (int64_t i = 0; i < p.count; i++)
    p.radii[i] *= powf(10.0F, uniform((uint64_t)i, -4.0F, 0.5F));
  stage s = stage_open();
  add_puffs(s.scene, &p);
  fum_scene_find_origin(s.scene);
  const double *origin = s.scene->origin;
  fum_smoke smoke;
  assert_int_equal(fum_smoke_init(s.scene, 1e-12, &smoke), FUM_OK);
  for (uint64_t i = 0; i < 300; i++) {
    double from[3], to[3], length = 0.0;
    fum_way way;
    for (int axis = 0; axis < 3; axis++) {
      from[axis] = (double)uniform(6 * i + (uint64_t)axis, -1.0F, 1.0F);
      to[axis] = (double)uniform(6 * i + 3 + (uint64_t)axis, -1.0F, 1.0F) * (i % 2 == 0 ? 1.0 : 30.0);
      way.start[axis] = from[axis] - origin[axis];
      way.direction[axis] = to[axis] - from[axis];
      length += way.direction[axis] * way.direction[axis];
    }
    way.length = sqrt(length);
    for (int axis = 0; axis < 3; axis++)
      way.direction[axis] /= way.length;
    double depths[3];
    fum_smoke_depth(&smoke, &way, UINT64_MAX, depths);
    for (int c = 0; c < 3; c++)
      assert_close(depths[c], brute_depth(&p, from, to), 1e-10);
  }
  fum_smoke_free(&smoke);
  stage_close(&s);
  puffs_free(&p);
}

static void test_emission(void **state) {
  (void)state;
  const float centre[3] = {0.1F, 0.2F, 0.3F};
  const double sigma = 0.25, emission = 3.0;
  const double there = exp(-0.5 * (0.1 * 0.1 + 0.05 * 0.05) / (sigma * sigma)), through = sigma * ROOT_2PI * there;
  stage s = stage_open();
  add_particle(s.scene, centre, 0.25F, 0.0F, 3.0F, 0.0F);
  pixel p = trace(s.scene, (double)0.1F + 0.1, (double)0.2F - 0.05);
  for (int c = 0; c < 3; c++)
    assert_close(p.rgba[c], (c + 1) * emission * through, 1e-8);
  assert_true(p.rgba[3] == 0.0);
  stage_close(&s);
  s = stage_open(); /* the same matter absorbs: e / k (1 - exp(-tau)) */
  add_particle(s.scene, centre, 0.25F, 20.0F, 3.0F, 0.0F);
  p = trace(s.scene, (double)0.1F + 0.1, (double)0.2F - 0.05);
  for (int c = 0; c < 3; c++)
    assert_close(p.rgba[c], (c + 1) * emission / 20.0 * -expm1(-20.0 * through), 1e-8);
  stage_close(&s);
}

/* Light along the view, for any cloud: a p E (1 - exp(-2 tau)) / 2 from behind the camera, a p E tau exp(-tau) towards
 * it. */
static void test_sun_along_the_view(void **state) {
  (void)state;
  for (int kind = 0; kind < 4; kind++) {
    puffs p = puffs_random(kind < 2 ? 30 : 1000, 5, 0.6F, kind < 2 ? 0.6F : 0.2F, kind % 2 == 0 ? 0.5F : 8.0F);
    for (int sign = -1; sign <= 1; sign += 2) {
      stage s = stage_open();
      add_puffs(s.scene, &p); /* albedo 0.8 */
      add_sun(s.scene, (double[3]){0.0, 0.0, (double)sign});
      for (int i = 0; i < 5; i++) {
        const double x = 0.2 * i - 0.4, y = 0.1;
        const double depth = brute_depth(&p, (double[3]){x, y, 10.0}, (double[3]){x, y, -90.0});
        const double share = sign < 0 ? -0.5 * expm1(-2.0 * depth) : depth * exp(-depth);
        assert_close(trace(s.scene, x, y).rgba[1], (double)0.8F * 2.0 / (4.0 * PI) * share, 1e-7);
      }
      stage_close(&s);
    }
    puffs_free(&p);
  }
}

/* One particle at the origin, lit from a side or a point; the ray passes it at x, y. */
typedef struct lit_particle {
  double sigma, density, x, y, light[3];
  bool is_sun; /* light: unit direction towards it */
} lit_particle;

static double normal_cdf(double z) {
  return 0.5 * erfc(-z / sqrt(2.0));
}

static double integrand(double z, const void *user) {
  const lit_particle *p = user;
  const double position[3] = {p->x, p->y, z}, k = p->density * p->sigma * ROOT_2PI;
  double u[3], length = 0.0, along = 0.0, squared = 0.0, strength = 2.0;
  for (int axis = 0; axis < 3; axis++) {
    u[axis] = p->light[axis] - (p->is_sun ? 0.0 : position[axis]);
    length += u[axis] * u[axis];
  }
  length = sqrt(length);
  for (int axis = 0; axis < 3; axis++)
    along -= position[axis] * u[axis] / length;
  for (int axis = 0; axis < 3; axis++) {
    const double offset = position[axis] + along * u[axis] / length;
    squared += offset * offset;
  }
  if (!p->is_sun) strength = 1.0 / (length * length);
  const double end = p->is_sun ? 1.0 : normal_cdf((length - along) / p->sigma);
  const double to_light = k * exp(-0.5 * squared / (p->sigma * p->sigma)) * (end - normal_cdf(-along / p->sigma));
  const double across = exp(-0.5 * (p->x * p->x + p->y * p->y) / (p->sigma * p->sigma));
  const double to_camera = k * across * normal_cdf(-z / p->sigma);
  const double there = p->density * across * exp(-0.5 * z * z / (p->sigma * p->sigma));
  return strength * there * exp(-to_light - to_camera) * phase(0.4, u[2] / length * -1.0);
}

static void test_one_particle_lit_from_anywhere(void **state) {
  (void)state;
  const lit_particle cases[] = {
      {0.5, 0.1, 0.0, 0.0, {1, 0, 0}, true},          {0.5, 3.0, 0.2, -0.1, {0.6, 0, 0.8}, true},
      {0.5, 30.0, -0.4, 0.3, {0, -0.8, 0.6}, true},   {0.5, 3.0, 0.1, 0.1, {2, 1, -1}, false},
      {0.5, 3.0, 0.1, 0.1, {0.3, 0, 0.2}, false},     {0.5, 3.0, 0.1, 0.0, {0.1, 0.02, 0}, false},
      {0.5, 200.0, 0.3, 0.0, {0.3, 0.3, 0.9}, false},
  };
  const float centre[3] = {0, 0, 0};
  for (size_t i = 0; i < sizeof cases / sizeof cases[0]; i++) {
    const lit_particle *p = &cases[i];
    stage s = stage_open();
    add_particle(s.scene, centre, (float)p->sigma, (float)p->density, 0.0F, 0.4F);
    if (p->is_sun) {
      add_sun(s.scene, (double[3]){-p->light[0], -p->light[1], -p->light[2]});
    } else {
      add_point_light(s.scene, p->light);
    }
    const double expected = simpson(integrand, p, -5.0, 5.0);
    const pixel found = trace(s.scene, p->x, p->y);
    for (int c = 0; c < 3; c++)
      assert_close(found.rgba[c], 0.25 * (c + 1) * expected, 1e-6);
    stage_close(&s);
  }
}

static void test_lights_and_sets_add_up(void **state) {
  (void)state;
  const float a[3] = {0, 0, 0}, b[3] = {0.2F, 0.1F, 0.5F};
  double parts[3] = {0};
  for (int part = 0; part < 3; part++) {
    stage s = stage_open();
    add_particle(s.scene, a, 0.5F, 2.0F, 0.0F, 0.5F);
    add_particle(s.scene, b, 0.3F, 4.0F, 0.5F, -0.3F);
    if (part != 1) add_point_light(s.scene, (double[3]){2, 1, 1});
    if (part != 0) add_sun(s.scene, (double[3]){0, 0, 1});
    parts[part] = trace(s.scene, 0.1, 0.1).rgba[2];
    fum_scene_clear_lights(s.scene);
    if (part == 2) parts[part] += trace(s.scene, 0.1, 0.1).rgba[2]; /* what shines by itself is in both parts */
    stage_close(&s);
  }
  assert_close(parts[2], parts[0] + parts[1], 1e-7);
}

static void add_wall(fum_scene *scene, uint32_t visibility, const float vertices[12]) {
  const uint32_t triangles[] = {0, 1, 2, 0, 2, 3};
  fum_mesh_desc desc;
  fum_mesh_desc_init(&desc);
  desc.visibility = visibility;
  desc.vertex_count = 4;
  desc.triangle_count = 2;
  desc.vertices = vertices;
  desc.triangles = triangles;
  assert_int_equal(fum_scene_add_mesh(scene, &desc), FUM_OK);
}

static void test_solids_end_the_ray(void **state) {
  (void)state;
  const float centre[3] = {0, 0, 0};
  const float level[12] = {-5, -5, 0.125F, 5, -5, 0.125F, 5, 5, 0.125F, -5, 5, 0.125F};
  for (int is_seen = 0; is_seen < 2; is_seen++) {
    stage s = stage_open();
    add_particle(s.scene, centre, 0.25F, 20.0F, 1.0F, 0.0F);
    add_wall(s.scene, is_seen != 0 ? FUM_VISIBLE_TO_CAMERA : FUM_VISIBLE_TO_SHADOW, level);
    const pixel p = trace(s.scene, 0.3, 0.0);
    const double whole = 20.0 * 0.25 * ROOT_2PI * exp(-0.5 * 0.09 / 0.0625);
    const double depth = is_seen != 0 ? whole * normal_cdf(-0.5) : whole;
    assert_close(p.rgba[3], -expm1(-depth), 1e-6);
    assert_close(p.rgba[0], -expm1(-depth) / 20.0, 1e-6);
    stage_close(&s);
  }
}

/* Thin smoke behind a wall that hides the sun below z = 0.1: the lit part of the Gaussian. */
static void test_shadow_edge_is_found(void **state) {
  (void)state;
  const float centre[3] = {0, 0, 0}, wall[12] = {2, -5, 0.1F, 2, -5, -9, 2, 5, -9, 2, 5, 0.1F};
  stage s = stage_open();
  add_particle(s.scene, centre, 0.25F, 1e-6F, 0.0F, 0.0F);
  add_wall(s.scene, FUM_VISIBLE_TO_SHADOW, wall);
  add_sun(s.scene, (double[3]){-1, 0, 0});
  const fum_camera camera = ray_at(0.1, 0.0);
  const pixel p = render_ray(s.scene, &camera, 1e-5);
  const double whole = 2.0 / (4.0 * PI) * 1e-6 * 0.25 * ROOT_2PI * exp(-0.5 * 0.01 / 0.0625);
  assert_close(p.rgba[2], 0.75 * whole * normal_cdf(-0.1 / 0.25), 2e-5);
  assert_int_equal(p.stats.unconverged_count, 0);
  stage_close(&s);
}

static void test_tiny_particle_in_a_large_one_is_not_missed(void **state) {
  (void)state;
  const float centre[3] = {0, 0, 0}, off[3] = {0, 0, 0.123F};
  stage s = stage_open();
  add_particle(s.scene, centre, 1.0F, 1e-9F, 1.0F, 0.0F);
  add_particle(s.scene, off, 1e-6F, 0.0F, 1e6F, 0.0F);
  assert_close(trace(s.scene, 0.0, 0.0).rgba[0], 2.0 * ROOT_2PI, 1e-6);
  stage_close(&s);
}

static void test_converges_as_asked(void **state) {
  (void)state;
  puffs p = puffs_random(200, 11, 0.6F, 0.5F, 5.0F);
  stage s = stage_open();
  add_puffs(s.scene, &p);
  add_point_light(s.scene, (double[3]){0.3, 0.1, 0.2});
  const fum_camera camera = ray_at(0.28, 0.1);
  const double truth = render_ray(s.scene, &camera, 1e-10).rgba[0];
  int64_t steps = 0;
  for (double tolerance = 1e-2; tolerance > 1e-8; tolerance *= 0.1) {
    const pixel found = render_ray(s.scene, &camera, tolerance);
    assert_true(fabs(found.rgba[0] - truth) <= tolerance * truth);
    assert_true(found.stats.error <= tolerance && found.stats.step_count >= steps);
    steps = found.stats.step_count;
  }
  stage_close(&s);
  puffs_free(&p);
}

static void test_depth_is_where_half_gets_through(void **state) {
  (void)state;
  puffs p = puffs_random(100, 2, 0.6F, 0.6F, 1.0F);
  stage s = stage_open();
  add_puffs(s.scene, &p);
  for (int i = 0; i < 5; i++) {
    const double x = 0.3 * i - 0.2;
    const double depth = trace(s.scene, x, 0.0).depth;
    const double found = brute_depth(&p, (double[3]){x, 0, 10}, (double[3]){x, 0, 10 - depth});
    if (depth < 100.0) assert_close(found, log(2.0), 1e-6);
    if (depth >= 100.0) assert_true(found < log(2.0));
  }
  stage_close(&s);
  puffs_free(&p);
}

static void test_threads_change_no_bit(void **state) {
  (void)state;
  puffs p = puffs_random(500, 8, 0.6F, 0.4F, 4.0F);
  double pictures[2][12 * 12 * 4];
  for (int run = 0; run < 2; run++) {
    stage s = stage_open();
    add_puffs(s.scene, &p);
    add_point_light(s.scene, (double[3]){2, 1, 1});
    assert_int_equal(fum_context_set_threads(s.context, run == 0 ? 1 : 3), FUM_OK);
    fum_camera camera = ray_at(0.0, 0.0);
    camera.width = camera.height = 12;
    for (int i = 0; i < 4; i++)
      camera.window[i] = i % 2 == 0 ? -1.0 : 1.0;
    assert_int_equal(fum_reference_render(s.scene, &camera, NULL, pictures[run], 576, NULL, 0, NULL), FUM_OK);
    stage_close(&s);
  }
  assert_memory_equal(pictures[0], pictures[1], sizeof pictures[0]);
  puffs_free(&p);
}

static int32_t stop(void *user, int32_t stage_number, float fraction, const char *message) {
  (void)user, (void)fraction, (void)message;
  return stage_number == FUM_STAGE_DRAWING;
}

static void test_failures_leave_outputs_alone(void **state) {
  (void)state;
  puffs p = puffs_random(50, 8, 0.6F, 0.4F, 4.0F);
  stage s = stage_open();
  add_puffs(s.scene, &p);
  add_point_light(s.scene, (double[3]){2, 1, 1});
  fum_camera camera = ray_at(0.0, 0.0);
  fum_reference_settings settings;
  fum_reference_settings_init(&settings);
  double rgba[4] = {7, 7, 7, 7};
  settings.tolerance = 0.5;
  assert_int_equal(fum_reference_render(s.scene, &camera, &settings, rgba, 4, NULL, 0, NULL), FUM_ERROR_ARGUMENT);
  assert_non_null(strstr(fum_last_error(s.context), "tolerance 0.5"));
  settings.tolerance = 1e-4;
  settings.light_samples = 0;
  assert_int_equal(fum_reference_render(s.scene, &camera, &settings, rgba, 4, NULL, 0, NULL), FUM_ERROR_ARGUMENT);
  assert_non_null(strstr(fum_last_error(s.context), "light_samples 0"));
  assert_int_equal(fum_reference_render(s.scene, &camera, NULL, rgba, 3, NULL, 0, NULL), FUM_ERROR_ARGUMENT);
  assert_non_null(strstr(fum_last_error(s.context), "3 doubles"));
  assert_int_equal(fum_reference_render(s.scene, &camera, NULL, rgba, 4, rgba, 2, NULL), FUM_ERROR_ARGUMENT);
  camera.width = 0;
  assert_int_equal(fum_reference_render(s.scene, &camera, NULL, rgba, 4, NULL, 0, NULL), FUM_ERROR_ARGUMENT);
  camera.width = 1;
  fum_context_set_progress(s.context, stop, NULL);
  assert_int_equal(fum_reference_render(s.scene, &camera, NULL, rgba, 4, NULL, 0, NULL), FUM_ERROR_CANCELLED);
  for (int i = 0; i < 4; i++)
    assert_true(rgba[i] == 7.0);
  stage_close(&s);
  puffs_free(&p);
}

static void test_nothing_to_see(void **state) {
  (void)state;
  stage s = stage_open();
  pixel p = trace(s.scene, 0.0, 0.0);
  for (int i = 0; i < 4; i++)
    assert_true(p.rgba[i] == 0.0);
  assert_true(p.depth == 100.0 && p.stats.step_count == 0 && p.stats.error == 0.0);
  const float centre[3] = {0, 0, 20.0F}; /* behind the camera */
  add_particle(s.scene, centre, 0.5F, 3.0F, 1.0F, 0.0F);
  add_point_light(s.scene, (double[3]){0, 0, 5});
  p = trace(s.scene, 0.0, 0.0);
  for (int i = 0; i < 4; i++)
    assert_true(p.rgba[i] == 0.0);
  stage_close(&s);
}

int main(void) {
  const struct CMUnitTest tests[] = {
      cmocka_unit_test(test_alpha_is_that_of_every_particle),
      cmocka_unit_test(test_depth_towards_lights_is_that_of_every_particle),
      cmocka_unit_test(test_emission),
      cmocka_unit_test(test_sun_along_the_view),
      cmocka_unit_test(test_one_particle_lit_from_anywhere),
      cmocka_unit_test(test_lights_and_sets_add_up),
      cmocka_unit_test(test_solids_end_the_ray),
      cmocka_unit_test(test_shadow_edge_is_found),
      cmocka_unit_test(test_tiny_particle_in_a_large_one_is_not_missed),
      cmocka_unit_test(test_converges_as_asked),
      cmocka_unit_test(test_depth_is_where_half_gets_through),
      cmocka_unit_test(test_threads_change_no_bit),
      cmocka_unit_test(test_failures_leave_outputs_alone),
      cmocka_unit_test(test_nothing_to_see),
  };
  return cmocka_run_group_tests(tests, NULL, NULL);
}
