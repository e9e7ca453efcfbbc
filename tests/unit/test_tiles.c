/* SPDX-License-Identifier: GPL-3.0-or-later */
/* Drawing in tiles: opacity against the closed form, the same picture from every instruction set. */
#include "support.h"

#include "api/lighting.h"
#include "base/cpu.h"
#include "billboard/tiles.h"

enum { SIDE = 40 };

static fum_camera make_camera(const double position[3], double half, double clip_start, int32_t type) {
  fum_camera camera;
  fum_camera_init(&camera);
  camera.type = type;
  for (int axis = 0; axis < 3; axis++)
    camera.world_from_camera[4 * axis + 3] = position[axis];
  const double window[4] = {-half, half, -half, half};
  memcpy(camera.window, window, sizeof window);
  camera.clip_start = clip_start;
  camera.clip_end = 20.0;
  camera.width = camera.height = SIDE;
  return camera;
}

static void draw(fum_scene *scene, const fum_camera *camera, float tolerance, float *out_rgba) {
  fum_settings settings;
  fum_settings_init(&settings);
  settings.device = FUM_DEVICE_TILES;
  settings.tolerance = tolerance;
  const fum_pass_buffer pass = {.pass = FUM_PASS_COMBINED, .pixels = out_rgba, .pixels_size = 4 * SIDE * SIDE};
  assert_int_equal(fum_render(scene, camera, &settings, 1, &pass, NULL), FUM_OK);
}

/* Opacity of every pixel against the closed form between the ends of the clip range. */
static void check_opacity(const puffs *p, const fum_camera *camera, double bound) {
  static float rgba[4 * SIDE * SIDE];
  stage s = stage_open();
  add_puffs(s.scene, p);
  draw(s.scene, camera, 1e-3F, rgba);
  for (int i = 0; i < SIDE * SIDE; i += 7) {
    const double *w = camera->window, *m = camera->world_from_camera;
    const double u = w[0] + (w[1] - w[0]) * (i % SIDE + 0.5) / SIDE, v = w[2] + (w[3] - w[2]) * (i / SIDE + 0.5) / SIDE;
    const bool is_perspective = camera->type == FUM_CAMERA_PERSPECTIVE;
    double from[3], to[3];
    const double ends[2] = {camera->clip_start, camera->clip_end};
    for (int e = 0; e < 2; e++) {
      double *point = e == 0 ? from : to;
      point[0] = m[3] + u * (is_perspective ? ends[e] : 1.0);
      point[1] = m[7] + v * (is_perspective ? ends[e] : 1.0);
      point[2] = m[11] - ends[e];
    }
    const double expected = 1.0 - exp(-brute_depth(p, from, to));
    if (fabs((double)rgba[4 * i + 3] - expected) > bound) {
      fail_msg("pixel %d %d: opacity %g is not %g", i % SIDE, i / SIDE, (double)rgba[4 * i + 3], expected);
    }
  }
  stage_close(&s);
}

static void test_opacity_is_the_closed_form(void **state) {
  (void)state;
  puffs small = puffs_random(3000, 1, 1.0F, 0.3F, 0.5F), large = puffs_random(60, 2, 1.0F, 0.8F, 1.0F);
  const double before[3] = {0.1, -0.05, 4.0}, inside[3] = {0.1, -0.2, 0.3}, far_away[3] = {0.0, 0.0, 15.0};
  const fum_camera cameras[] = {
      make_camera(before, 0.4, 0.1, FUM_CAMERA_PERSPECTIVE),
      make_camera(before, 2.0, 3.7, FUM_CAMERA_PERSPECTIVE), /* wide, and cut by the near plane */
      make_camera(inside, 1.0, 0.01, FUM_CAMERA_PERSPECTIVE),
      make_camera(far_away, 0.08, 0.1, FUM_CAMERA_PERSPECTIVE),
      make_camera(before, 1.3, 0.1, FUM_CAMERA_ORTHOGRAPHIC),
  };
  for (size_t i = 0; i < sizeof cameras / sizeof *cameras; i++) {
    check_opacity(&large, &cameras[i], 2e-3);
    /* in the second view the small ones are thinner than pixels, and widened */
    if (i != 1) check_opacity(&small, &cameras[i], 2e-3);
  }
  puffs_free(&large);
  puffs_free(&small);
}

/* AVX2 and AVX-512 differ from the plain loops by rounding, and where rounding ends a dark walk earlier or later;
 * threads make no difference at all. */
static void test_instruction_sets_and_threads(void **state) {
  (void)state;
  static float plain[4 * SIDE * SIDE], other[4 * SIDE * SIDE];
  puffs p = puffs_random(3000, 3, 1.0F, 0.2F, 2.0F);
  const double eye[3] = {0.0, 0.0, 4.0}, light[3] = {3.0, 2.0, 1.0};
  const fum_camera camera = make_camera(eye, 0.4, 0.1, FUM_CAMERA_PERSPECTIVE);
  for (int level = 0; level <= (int)FUM_CPU_AVX512; level++) {
    fum_cpu_limit((fum_cpu_level)level);
    for (int threads = 1; threads <= 3; threads++) {
      stage s = stage_open();
      assert_int_equal(fum_context_set_threads(s.context, threads), FUM_OK);
      add_puffs(s.scene, &p);
      add_point_light(s.scene, light);
      float *out = level == 0 && threads == 1 ? plain : other;
      draw(s.scene, &camera, 0.01F, out);
      if (level == 0) assert_memory_equal(out, plain, sizeof plain);
      for (int i = 0; i < 4 * SIDE * SIDE; i++) {
        if (fabsf(out[i] - plain[i]) > 2e-4F * fabsf(plain[i]) + 1e-6F) {
          fail_msg("level %d: %.9g is not %.9g", level, (double)out[i], (double)plain[i]);
        }
      }
      stage_close(&s);
    }
  }
  fum_cpu_limit(FUM_CPU_AVX512);
  puffs_free(&p);
}

/* The lattice and the splats are found once: the loops alone differ, by rounding. */
static void draw_at_level(fum_context *context, fum_tile_job *job, fum_cpu_level level, float *out_rgba) {
  memset(out_rgba, 0, 4 * SIDE * SIDE * sizeof *out_rgba);
  job->rgba = out_rgba;
  fum_cpu_limit(level);
  assert_int_equal(fum_tiles_draw(context, job), FUM_OK);
  fum_cpu_limit(FUM_CPU_AVX512);
}

static void check_loops(fum_scene *scene, const fum_camera *camera) {
  static float plain[4 * SIDE * SIDE], other[4 * SIDE * SIDE];
  const float footprint_sigmas = 3.5F;
  const fum_footprints footprints = fum_footprints_find(4.0, 3.5);
  fum_context *context = scene->context;
  fum_settings settings;
  fum_view view;
  fum_lighting lighting;
  fum_slabs slabs;
  fum_lattice lattice;
  fum_splats splats;
  fum_tile_class classes[FUM_MAX_CLASSES];
  fum_settings_init(&settings);
  assert_int_equal(fum_view_init(context, camera, &view), FUM_OK);
  assert_int_equal(fum_caches_update(scene, &settings), FUM_OK);
  fum_view_place(&view, scene->origin);
  const fum_octree *all = scene->caches->all;
  fum_tile_job job = {
      .scene = scene, .octree = all, .view = &view, .slabs = &slabs, .splats = &splats, .lattice = &lattice};
  assert_int_equal(fum_tiles_find_looks(scene, classes, &job), FUM_OK);
  assert_int_equal(fum_lighting_begin(scene, &settings, all, &lighting), FUM_OK);
  job.lamps = &lighting.lamps;
  assert_int_equal(
      fum_slabs_find(context, all, &view, NULL, settings.tolerance, settings.tolerance, job.thinnest, &slabs), FUM_OK);
  assert_int_equal(fum_lattice_place(context, all, &view, &slabs, footprint_sigmas, settings.tolerance, &lattice),
                   FUM_OK);
  assert_int_equal(fum_lattice_light(&lighting.gathering, &view, &slabs, &lighting.lamps, &lattice), FUM_OK);
  const fum_splats_options drawn = {.footprints = footprints, .thinnest = job.thinnest};
  assert_int_equal(fum_splats_find(context, all, &view, &slabs, &drawn, &splats), FUM_OK);
  draw_at_level(context, &job, FUM_CPU_PLAIN, plain);
  float brightest = 0.0F;
  for (int level = 1; level <= (int)FUM_CPU_AVX512; level++) {
    draw_at_level(context, &job, (fum_cpu_level)level, other);
    for (int i = 0; i < 4 * SIDE * SIDE; i++) {
      brightest = fmaxf(brightest, plain[i]);
      if (fabsf(other[i] - plain[i]) > 5e-5F * fabsf(plain[i]) + 1e-9F) {
        fail_msg("level %d: %.9g is not %.9g", level, (double)other[i], (double)plain[i]);
      }
    }
  }
  assert_true(brightest > 0.01F);
  fum_splats_free(context, &splats);
  fum_lattice_free(context, &lattice);
  fum_slabs_free(context, &slabs);
  fum_lighting_end(context, &lighting);
  fum_free(context, &job.class_of);
}

/* With one look and with several and glow, near and far. */
static void test_loops_agree(void **state) {
  (void)state;
  puffs small = puffs_random(1000, 3, 1.0F, 0.2F, 2.0F), large = puffs_random(20, 4, 1.0F, 1.0F, 2.0F);
  const double eye[3] = {0.0, 0.0, 4.0}, inside[3] = {0.1, 0.2, 0.5}, light[3] = {3.0, 2.0, 1.0};
  const fum_camera cameras[] = {make_camera(eye, 0.4, 0.1, FUM_CAMERA_PERSPECTIVE),
                                make_camera(inside, 0.8, 0.01, FUM_CAMERA_PERSPECTIVE),
                                make_camera(eye, 1.3, 0.1, FUM_CAMERA_ORTHOGRAPHIC)};
  for (int k = 0; k < 3; k++) {
    stage s = stage_open();
    assert_int_equal(fum_context_set_threads(s.context, 1), FUM_OK);
    add_puffs(s.scene, &small);
    add_point_light(s.scene, light);
    check_loops(s.scene, &cameras[k]);
    fum_particles_desc desc;
    fum_particles_desc_init(&desc);
    desc.count = large.count;
    desc.positions = large.positions;
    desc.radii = large.radii;
    desc.densities = large.densities;
    desc.anisotropy = 0.4F;
    desc.emission[1] = 0.1F;
    assert_int_equal(fum_scene_add_particles(s.scene, &desc), FUM_OK);
    check_loops(s.scene, &cameras[k]);
    stage_close(&s);
  }
  puffs_free(&large);
  puffs_free(&small);
}

/* With maps: a white one, whose opacity alone is read, and a coloured one. */
static void test_loops_read_maps_alike(void **state) {
  (void)state;
  puffs p = puffs_random(200, 5, 1.0F, 0.3F, 2.0F);
  const double eye[3] = {0.0, 0.0, 4.0}, inside[3] = {0.1, 0.2, 0.5}, light[3] = {3.0, 2.0, 1.0};
  const fum_camera cameras[] = {make_camera(eye, 0.4, 0.1, FUM_CAMERA_PERSPECTIVE),
                                make_camera(inside, 0.8, 0.01, FUM_CAMERA_PERSPECTIVE)};
  float map[4 * 9 * 7];
  for (int k = 0; k < 4; k++) {
    const bool is_colored = k % 2 != 0;
    for (int i = 0; i < 4 * 9 * 7; i++)
      map[i] = is_colored || i % 4 == 3 ? uniform(70U + (uint64_t)i, 0.1F, 1.0F) : 1.0F;
    stage s = stage_open();
    fum_particles_desc desc;
    fum_particles_desc_init(&desc);
    desc.count = p.count;
    desc.positions = p.positions;
    desc.radii = p.radii;
    desc.densities = p.densities;
    desc.map = map;
    desc.map_width = 9;
    desc.map_height = 7;
    assert_int_equal(fum_scene_add_particles(s.scene, &desc), FUM_OK);
    add_point_light(s.scene, light);
    check_loops(s.scene, &cameras[k / 2]);
    stage_close(&s);
  }
  puffs_free(&p);
}

int main(void) {
  const struct CMUnitTest tests[] = {
      cmocka_unit_test(test_opacity_is_the_closed_form),
      cmocka_unit_test(test_instruction_sets_and_threads),
      cmocka_unit_test(test_loops_agree),
      cmocka_unit_test(test_loops_read_maps_alike),
  };
  return cmocka_run_group_tests(tests, NULL, NULL);
}
