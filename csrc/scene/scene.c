/* SPDX-License-Identifier: GPL-3.0-or-later */
#include "scene/scene.h"

#include "base/vector.h"

#include <stdlib.h>

void fum_scene_free_particles(fum_scene *scene);
void fum_scene_free_meshes(fum_scene *scene);

int32_t fum_scene_create(fum_context *context, fum_scene **out_scene) {
  if (out_scene == NULL) return fum_fail(context, FUM_ERROR_ARGUMENT, "fum_scene_create: out_scene is null");
  fum_scene *scene = calloc(1, sizeof *scene);
  if (scene == NULL) return fum_fail(context, FUM_ERROR_MEMORY, "no memory for a scene");
  scene->context = context;
  *out_scene = scene;
  return FUM_OK;
}

void fum_scene_destroy(fum_scene *scene) {
  if (scene == NULL) return;
  fum_scene_drop_caches(scene);
  fum_scene_free_particles(scene);
  fum_scene_free_meshes(scene);
  fum_scene_clear_lights(scene);
  free(scene);
}

static int32_t check_set(fum_context *context, const char *name, const char *field, int32_t set, int32_t least) {
  if (set >= least && set < FUM_LINK_SETS) return FUM_OK;
  return fum_fail(context, FUM_ERROR_ARGUMENT, "%s: %s %d is not within %d..%d", name, field, (int)set, (int)least,
                  FUM_LINK_SETS - 1);
}

int32_t fum_check_link_sets(fum_context *context, const char *name, int32_t light_set, int32_t shadow_set,
                            int32_t least) {
  const int32_t status = check_set(context, name, "light_set", light_set, 0);
  return status == FUM_OK ? check_set(context, name, "shadow_set", shadow_set, least) : status;
}

typedef struct bounds {
  double lower[3], upper[3];
} bounds;

static void extend(bounds *box, const double point[3]) {
  for (int axis = 0; axis < 3; axis++) {
    box->lower[axis] = fmin(box->lower[axis], point[axis]);
    box->upper[axis] = fmax(box->upper[axis], point[axis]);
  }
}

static void extend_by_set(fum_context *context, const fum_particles *set, bounds *box) {
  double lx = INFINITY, ly = INFINITY, lz = INFINITY, ux = -INFINITY, uy = -INFINITY, uz = -INFINITY;
#pragma omp parallel for num_threads(fum_thread_count(context)) reduction(min : lx, ly, lz) reduction(max : ux, uy, uz)
  for (int64_t i = 0; i < set->count; i++) {
    const double x = (double)set->positions[3 * i], y = (double)set->positions[3 * i + 1],
                 z = (double)set->positions[3 * i + 2];
    lx = fum_least(lx, x), ux = fum_most(ux, x);
    ly = fum_least(ly, y), uy = fum_most(uy, y);
    lz = fum_least(lz, z), uz = fum_most(uz, z);
  }
  if (set->count == 0) return;
  extend(box, (double[3]){lx, ly, lz});
  extend(box, (double[3]){ux, uy, uz});
}

void fum_scene_find_origin(fum_scene *scene) {
  bounds box = {{INFINITY, INFINITY, INFINITY}, {-INFINITY, -INFINITY, -INFINITY}};
  for (int32_t s = 0; s < scene->particles_count; s++)
    extend_by_set(scene->context, &scene->particles[s], &box);
  for (int32_t m = 0; scene->particle_count == 0 && m < scene->mesh_count; m++) {
    const fum_mesh *mesh = &scene->meshes[m];
    for (int64_t i = 0; i < mesh->vertex_count; i++) {
      const float *v = mesh->vertices + 3 * i;
      double world[3];
      fum_transform_point(mesh->world_from_local, (double[3]){(double)v[0], (double)v[1], (double)v[2]}, world);
      extend(&box, world);
    }
  }
  for (int axis = 0; axis < 3; axis++) {
    const double middle = 0.5 * (box.lower[axis] + box.upper[axis]);
    scene->origin[axis] = isfinite(middle) ? middle : 0.0;
  }
}
