/* SPDX-License-Identifier: GPL-3.0-or-later */
/* Where the camera sees moving particles, and pictures of smears by each instruction set. */
#include "support.h"

#include "api/caches.h"
#include "api/channels.h"
#include "base/cpu.h"
#include "billboard/streak.h"

enum { SIDE = 48, COUNT = 300 };

static fum_camera make_camera(void) {
  fum_camera camera;
  fum_camera_init(&camera);
  camera.width = camera.height = SIDE;
  camera.world_from_camera[11] = 4.0;
  memcpy(camera.window, (double[4]){-0.5, 0.5, -0.5, 0.5}, sizeof camera.window);
  return camera;
}

static void add_cloud(fum_scene *scene, const float velocity[3]) {
  static float positions[3 * COUNT], velocities[3 * COUNT];
  fum_particles_desc desc;
  fum_particles_desc_init(&desc);
  for (int i = 0; i < 3 * COUNT; i++) {
    positions[i] = uniform(17 + (uint64_t)i, -1.0F, 1.0F);
    velocities[i] = velocity[i % 3] * uniform(4000 + (uint64_t)i, 0.5F, 1.5F);
  }
  desc.count = COUNT;
  desc.positions = positions;
  desc.velocities = velocities;
  desc.radius = 0.2F;
  desc.emission[0] = desc.emission[1] = 1.0F;
  assert_int_equal(fum_scene_add_particles(scene, &desc), FUM_OK);
}

static void draw(fum_scene *scene, const fum_camera *camera, float *out) {
  const fum_pass_buffer combined = {FUM_PASS_COMBINED, 0, out, 4 * SIDE * SIDE};
  if (fum_render(scene, camera, NULL, 1, &combined, NULL) != FUM_OK) fail_msg("%s", fum_last_error(scene->context));
}

/* Swept Gaussians, images of the aperture, and both: all loops agree to rounding, whatever the number of threads. */
static void test_loops_agree(void **state) {
  (void)state;
  static float plain[4 * SIDE * SIDE], other[4 * SIDE * SIDE];
  const double shutters[3] = {0.5, 0.0, 0.5}, apertures[3] = {0.0, 0.2, 0.2};
  const int types[3] = {FUM_CAMERA_PERSPECTIVE, FUM_CAMERA_PERSPECTIVE, FUM_CAMERA_ORTHOGRAPHIC};
  for (int k = 0; k < 3; k++) {
    fum_camera camera = make_camera();
    camera.type = types[k];
    camera.shutter_close = shutters[k];
    camera.aperture_radius = apertures[k];
    camera.focus_distance = 3.0;
    camera.aperture_blades = 5;
    for (int level = 0; level <= (int)FUM_CPU_AVX512; level++) {
      stage s = stage_open();
      fum_cpu_limit((fum_cpu_level)level);
      assert_int_equal(fum_context_set_threads(s.context, level + 1), FUM_OK);
      add_cloud(s.scene, (float[3]){0.6F, 0.3F, 0.5F});
      draw(s.scene, &camera, level == 0 ? plain : other);
      for (int i = 0; i < 4 * SIDE * SIDE && level > 0; i++) {
        if (fabsf(other[i] - plain[i]) > 1e-5F + 2e-4F * fabsf(plain[i]))
          fail_msg("blur %d, level %d: %.9g is not %.9g", k, level, (double)other[i], (double)plain[i]);
      }
      stage_close(&s);
    }
    fum_cpu_limit(FUM_CPU_AVX512);
  }
}

/* Paths end where particles are seen then; confusion is that of similar triangles. */
static void test_smears_of_a_moving_camera(void **state) {
  (void)state;
  stage s = stage_open();
  fum_camera camera = make_camera();
  fum_view view;
  fum_smears smears;
  const fum_octree *octree;
  add_cloud(s.scene, (float[3]){0.2F, 0.1F, -0.3F});
  camera.moves = 1;
  camera.shutter_open = -1.0;
  camera.shutter_close = 1.0;
  camera.aperture_radius = 0.1;
  camera.focus_distance = 5.0;
  memcpy(camera.next_window, (double[4]){-0.6, 0.4, -0.4, 0.5}, sizeof camera.next_window);
  memcpy(camera.previous_window, camera.window, sizeof camera.window);
  memcpy(camera.next_world_from_camera, camera.world_from_camera, sizeof camera.world_from_camera);
  memcpy(camera.previous_world_from_camera, camera.world_from_camera, sizeof camera.world_from_camera);
  camera.next_world_from_camera[3] = 0.5;
  camera.previous_world_from_camera[11] = 3.5;
  fum_settings settings;
  fum_settings_init(&settings);
  const fum_channels *channels = NULL;
  assert_int_equal(fum_channels_update(s.scene, &settings, &channels), FUM_OK);
  octree = s.scene->caches->all;
  assert_int_equal(fum_view_init(s.context, &camera, &view), FUM_OK);
  fum_view_place(&view, octree->origin);
  assert_int_equal(fum_smears_find(s.scene, octree, &camera, &view, &smears), FUM_OK);
  for (int64_t i = 0; i < octree->count; i++) {
    const fum_smear *smear = &smears.items[i];
    const float *velocity = s.scene->particles[0].velocities + 3 * (int64_t)octree->indices[i];
    for (int end = 0; end < 2; end++) {
      fum_view then;
      double at[3], px[2], seen[2];
      assert_int_equal(fum_view_init_moved(s.context, &camera, end == 1, &then), FUM_OK);
      fum_view_place(&then, octree->origin);
      const double frames = end == 0 ? -1.0 : 1.0,
                   place[3] = {(double)octree->x[i], (double)octree->y[i], (double)octree->z[i]};
      for (int axis = 0; axis < 3; axis++)
        at[axis] = place[axis] + frames * (double)velocity[axis];
      assert_true(fum_view_project(&then, at, px));
      const double depth = -((double)smear->center[2] + 0.5 * frames * (double)smear->path[2]);
      for (int axis = 0; axis < 2; axis++) {
        const double *w = view.window + 2 * axis;
        const double lateral = (double)smear->center[axis] + 0.5 * frames * (double)smear->path[axis];
        seen[axis] = (lateral / depth - w[0]) / (w[1] - w[0]) * SIDE;
        if (fabs(seen[axis] - px[axis]) > 1e-3) fail_msg("end %d: pixel %g is not %g", end, seen[axis], px[axis]);
      }
    }
    const double confusion = 0.1 * (-(double)smear->center[2] - 5.0) / 5.0;
    if (fabs((double)smear->confusion - confusion) > 1e-6) fail_msg("confusion %g", (double)smear->confusion);
  }
  fum_smears_free(s.context, &smears);
  stage_close(&s);
}

/* A camera that turns is a rotation in between as well. */
static void test_views_between_frames(void **state) {
  (void)state;
  stage s = stage_open();
  fum_camera camera = make_camera();
  fum_view view;
  camera.moves = 1;
  memcpy(camera.next_window, camera.window, sizeof camera.window);
  memcpy(camera.previous_window, camera.window, sizeof camera.window);
  memcpy(camera.previous_world_from_camera, camera.world_from_camera, sizeof camera.world_from_camera);
  memcpy(camera.next_world_from_camera, camera.world_from_camera, sizeof camera.world_from_camera);
  double *m = camera.next_world_from_camera;
  m[0] = m[10] = cos(0.4);
  m[2] = sin(0.4);
  m[8] = -sin(0.4);
  assert_int_equal(fum_view_init_at(s.context, &camera, 0.5, &view), FUM_OK);
  const double expected[3] = {cos(0.2), sin(0.2), 0.0};
  const double found[3] = {view.local_from_camera[0], view.local_from_camera[2], view.local_from_camera[1]};
  for (int i = 0; i < 3; i++) {
    if (fabs(found[i] - expected[i]) > 1e-12) fail_msg("%d: %g is not %g", i, found[i], expected[i]);
  }
  stage_close(&s);
}

int main(void) {
  const struct CMUnitTest tests[] = {cmocka_unit_test(test_loops_agree),
                                     cmocka_unit_test(test_smears_of_a_moving_camera),
                                     cmocka_unit_test(test_views_between_frames)};
  return cmocka_run_group_tests(tests, NULL, NULL);
}
