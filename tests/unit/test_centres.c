/* SPDX-License-Identifier: GPL-3.0-or-later */
/* When light at the particles' centres is taken to be enough. */
#include "support.h"

#include "api/lighting.h"
#include "lighting/centres.h"

/* A thin cloud (sigma 0.05) seen from 5 m, and one light. */
typedef struct setup {
  float density, anisotropy;
  int32_t light_type;
  double light_distance;
  float tolerance;
  int has_solid;
} setup;

static const setup ENOUGH = {0.001F, 0.0F, FUM_LIGHT_SUN, 0.0, 0.01F, 0};

static void add_wall(fum_scene *scene) {
  static const float vertices[9] = {3, -1, -1, 3, 1, -1, 3, 0, 1};
  static const uint32_t triangles[3] = {0, 1, 2};
  fum_mesh_desc desc;
  fum_mesh_desc_init(&desc);
  desc.vertex_count = 3;
  desc.triangle_count = 1;
  desc.vertices = vertices;
  desc.triangles = triangles;
  assert_int_equal(fum_scene_add_mesh(scene, &desc), FUM_OK);
}

static bool suffice(setup u) {
  stage s = stage_open();
  puffs p = puffs_random(2000, 1, 1.0F, 0.1F, u.density);
  fum_particles_desc particles;
  fum_particles_desc_init(&particles);
  particles.count = p.count;
  particles.positions = p.positions;
  particles.densities = p.densities;
  particles.radius = 0.1F;
  particles.anisotropy = u.anisotropy;
  assert_int_equal(fum_scene_add_particles(s.scene, &particles), FUM_OK);
  fum_light_desc light;
  fum_light_desc_init(&light);
  light.type = u.light_type;
  light.world_from_light[3] = u.light_distance;
  assert_int_equal(fum_scene_add_light(s.scene, &light), FUM_OK);
  if (u.has_solid) add_wall(s.scene);
  fum_settings settings;
  fum_settings_init(&settings);
  fum_camera camera;
  fum_camera_init(&camera);
  camera.world_from_camera[11] = 5.0;
  fum_view view;
  fum_lighting lighting;
  fum_slabs slabs;
  assert_int_equal(fum_view_init(s.context, &camera, &view), FUM_OK);
  assert_int_equal(fum_caches_update(s.scene, &settings), FUM_OK);
  fum_view_place(&view, s.scene->origin);
  const fum_octree *all = s.scene->caches->all;
  assert_int_equal(fum_lighting_begin(s.scene, &settings, all, &lighting), FUM_OK);
  assert_int_equal(fum_slabs_find(s.context, all, &view, NULL, u.tolerance, u.tolerance, 0.0F, &slabs), FUM_OK);
  const bool answer =
      fum_centres_suffice(s.scene, all, &view, &slabs, &lighting.lamps, s.scene->caches->solids, u.tolerance);
  fum_slabs_free(s.context, &slabs);
  fum_lighting_end(s.context, &lighting);
  stage_close(&s);
  puffs_free(&p);
  return answer;
}

static void test_thin_smoke_under_far_lights(void **state) {
  (void)state;
  setup far = ENOUGH, tight = ENOUGH;
  far.light_type = FUM_LIGHT_POINT;
  far.light_distance = 8.0;
  tight.density *= 0.1F;
  tight.tolerance *= 0.1F;
  assert_true(suffice(ENOUGH));
  assert_true(suffice(far));
  assert_true(suffice(tight));
}

static void test_what_changes_inside_a_particle(void **state) {
  (void)state;
  setup dense = ENOUGH, near = ENOUGH, forward = ENOUGH, tight = ENOUGH;
  dense.density = 1.0F;
  near.light_type = FUM_LIGHT_POINT;
  near.light_distance = 3.0;
  forward.anisotropy = 0.9F;
  tight.density = 0.01F;
  assert_true(suffice(tight));
  tight.tolerance = 1e-4F;
  assert_false(suffice(dense));
  assert_false(suffice(near));
  assert_false(suffice(forward));
  assert_false(suffice(tight));
}

static void test_edges(void **state) {
  (void)state;
  setup solid = ENOUGH, cone = ENOUGH, panel = ENOUGH;
  solid.has_solid = 1;
  cone.light_type = FUM_LIGHT_SPOT;
  cone.light_distance = 100.0;
  panel.light_type = FUM_LIGHT_AREA;
  panel.light_distance = 100.0;
  assert_false(suffice(solid));
  assert_false(suffice(cone));
  assert_false(suffice(panel));
}

int main(void) {
  const struct CMUnitTest tests[] = {
      cmocka_unit_test(test_thin_smoke_under_far_lights),
      cmocka_unit_test(test_what_changes_inside_a_particle),
      cmocka_unit_test(test_edges),
  };
  return cmocka_run_group_tests(tests, NULL, NULL);
}
