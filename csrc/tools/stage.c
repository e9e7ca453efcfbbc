/* SPDX-License-Identifier: GPL-3.0-or-later */
#include "tools/stage.h"

#include <math.h>
#include <string.h>

int32_t stage_create(fum_context *context, const cloud *c, fum_scene **out_scene) {
  fum_particles_desc particles;
  fum_particles_desc_init(&particles);
  particles.name = "cloud";
  particles.count = c->count;
  particles.positions = c->positions;
  particles.radii = c->radii;
  particles.densities = c->densities;
  particles.albedos = c->albedos;
  const int32_t status = fum_scene_create(context, out_scene);
  return status == FUM_OK ? fum_scene_add_particles(*out_scene, &particles) : status;
}

void stage_place(const cloud *c, const double position[3], double out_world[3]) {
  for (int axis = 0; axis < 3; axis++)
    out_world[axis] = c->middle[axis] + c->radius * position[axis];
}

/* A wall that only casts shadows, half way between the light and the cloud. Its edge leans across the middle. */
static int32_t add_wall(fum_scene *scene, const cloud *c, const double light[3]) {
  const double turn = 0.4, length = hypot(hypot(light[0], light[1]), light[2]);
  const double flat = hypot(light[0], light[1]);
  const double across[3] = {-light[1] / flat, light[0] / flat, 0.0};
  const double up[3] = {-light[0] * light[2] / (flat * length), -light[1] * light[2] / (flat * length), flat / length};
  float vertices[12];
  for (int corner = 0; corner < 4; corner++) {
    const double u = corner == 0 || corner == 3 ? -10.0 : 10.0, v = corner < 2 ? -10.0 : 0.0;
    double place[3], world[3];
    for (int axis = 0; axis < 3; axis++) {
      const double right = cos(turn) * across[axis] + sin(turn) * up[axis];
      const double above = cos(turn) * up[axis] - sin(turn) * across[axis];
      place[axis] = 0.5 * light[axis] + u * right + v * above;
    }
    stage_place(c, place, world);
    for (int axis = 0; axis < 3; axis++)
      vertices[3 * corner + axis] = (float)world[axis];
  }
  const uint32_t triangles[6] = {0, 1, 2, 0, 2, 3};
  fum_mesh_desc mesh;
  fum_mesh_desc_init(&mesh);
  mesh.name = "wall";
  mesh.visibility = FUM_VISIBLE_TO_SHADOW;
  mesh.vertex_count = 4;
  mesh.triangle_count = 2;
  mesh.vertices = vertices;
  mesh.triangles = triangles;
  return fum_scene_add_mesh(scene, &mesh);
}

int32_t stage_add_light(fum_scene *scene, const cloud *c, const double position[3], double brightness) {
  fum_light_desc light;
  fum_light_desc_init(&light);
  double world[3];
  stage_place(c, position, world);
  for (int axis = 0; axis < 3; axis++) {
    light.world_from_light[4 * axis + 3] = world[axis];
    light.intensity[axis] = (float)(40.0 * c->radius * c->radius * brightness);
  }
  const int32_t status = fum_scene_add_light(scene, &light);
  return status == FUM_OK && c->has_wall ? add_wall(scene, c, position) : status;
}

void stage_ring(int index, double out_position[3]) {
  const double angle = 0.7 + 2.39996 * index;
  out_position[0] = 2.5 * cos(angle);
  out_position[1] = 2.5 * sin(angle);
  out_position[2] = 1.2;
}

int32_t stage_create_ring(fum_context *context, const cloud *c, int count, fum_scene **out_scene) {
  int32_t status = stage_create(context, c, out_scene);
  for (int i = 0; i < count && status == FUM_OK; i++) {
    double position[3];
    stage_ring(i, position);
    status = stage_add_light(*out_scene, c, position, 1.0 / count);
  }
  return status;
}

fum_camera stage_camera(const cloud *c, int32_t width, int32_t height) {
  fum_camera camera;
  fum_camera_init(&camera);
  const double *middle = c->middle, radius = c->radius;
  const double tangent = 0.36, aspect = (double)width / (double)height;
  const double matrix[16] = {1, 0, 0, middle[0], 0, 0, -1, middle[1] - 3.0 * radius, 0, 1, 0, middle[2], 0, 0, 0, 1};
  memcpy(camera.world_from_camera, matrix, sizeof matrix);
  const double window[4] = {-tangent * aspect, tangent * aspect, -tangent, tangent};
  memcpy(camera.window, window, sizeof window);
  camera.clip_start = 0.01 * radius;
  camera.clip_end = 10.0 * radius;
  camera.width = width;
  camera.height = height;
  return camera;
}
