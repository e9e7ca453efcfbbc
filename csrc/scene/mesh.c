/* SPDX-License-Identifier: GPL-3.0-or-later */
#include "base/vector.h"
#include "scene/scene.h"

#include <stdlib.h>
#include <string.h>

static const double IDENTITY[16] = {1, 0, 0, 0, 0, 1, 0, 0, 0, 0, 1, 0, 0, 0, 0, 1};

void fum_mesh_desc_init(fum_mesh_desc *desc) {
  *desc = (fum_mesh_desc){.struct_size = sizeof *desc,
                          .visibility = FUM_VISIBLE_TO_SHADOW | FUM_VISIBLE_TO_CAMERA,
                          .albedo = {0.8F, 0.8F, 0.8F}};
  memcpy(desc->world_from_local, IDENTITY, sizeof IDENTITY);
}

static int32_t check_arrays(fum_context *context, const fum_mesh_desc *d, const char *name) {
  for (int64_t i = 0; i < 3 * d->vertex_count; i++) {
    if (!isfinite(d->vertices[i])) {
      return fum_fail(context, FUM_ERROR_ARGUMENT, "%s: vertex %lld is not finite", name, (long long)(i / 3));
    }
  }
  for (int64_t i = 0; i < 9 * d->triangle_count && d->normals != NULL; i++) {
    if (!isfinite(d->normals[i])) {
      return fum_fail(context, FUM_ERROR_ARGUMENT, "%s: normal of triangle %lld is not finite", name,
                      (long long)(i / 9));
    }
  }
  for (int64_t i = 0; i < 3 * d->triangle_count; i++) {
    if (d->triangles[i] >= d->vertex_count) {
      return fum_fail(context, FUM_ERROR_ARGUMENT, "%s: triangle %lld uses vertex %u of %lld", name, (long long)(i / 3),
                      (unsigned)d->triangles[i], (long long)d->vertex_count);
    }
  }
  return FUM_OK;
}

static int32_t check_desc(fum_context *context, const fum_mesh_desc *d, const char *name) {
  const int64_t limit = UINT32_MAX;
  if (d->vertex_count < 0 || d->vertex_count > limit || d->triangle_count < 0 || d->triangle_count > limit) {
    return fum_fail(context, FUM_ERROR_ARGUMENT, "%s: %lld vertices and %lld triangles are not within 0..4294967295",
                    name, (long long)d->vertex_count, (long long)d->triangle_count);
  }
  if ((d->vertex_count > 0 && d->vertices == NULL) || (d->triangle_count > 0 && d->triangles == NULL)) {
    return fum_fail(context, FUM_ERROR_ARGUMENT, "%s: vertices or triangles are missing", name);
  }
  for (int c = 0; c < 3; c++) {
    if (!(d->albedo[c] >= 0.0F && d->albedo[c] <= 1.0F)) {
      return fum_fail(context, FUM_ERROR_ARGUMENT, "%s: albedo %g is not within 0..1", name, (double)d->albedo[c]);
    }
    if (!(d->emission[c] >= 0.0F && isfinite(d->emission[c]))) {
      return fum_fail(context, FUM_ERROR_ARGUMENT, "%s: emission %g is not finite and at least 0", name,
                      (double)d->emission[c]);
    }
  }
  if (!fum_all_finite(d->world_from_local, 16)) {
    return fum_fail(context, FUM_ERROR_ARGUMENT, "%s: the matrix is not finite", name);
  }
  const int32_t status = fum_check_link_sets(context, name, d->light_set, d->shadow_set, 0);
  return status == FUM_OK ? check_arrays(context, d, name) : status;
}

static void free_mesh(fum_context *context, fum_mesh *mesh) {
  free(mesh->name);
  fum_free(context, &mesh->vertices);
  fum_free(context, &mesh->triangles);
  fum_free(context, &mesh->normals);
}

void fum_scene_free_meshes(fum_scene *scene) {
  for (int32_t i = 0; i < scene->mesh_count; i++)
    free_mesh(scene->context, &scene->meshes[i]);
  free(scene->meshes);
  scene->meshes = NULL;
  scene->mesh_count = 0;
}

static int32_t copy_mesh(fum_context *context, const fum_mesh_desc *d, const char *name, fum_mesh *mesh) {
  int32_t status = fum_alloc(context, d->vertex_count, 3 * sizeof *mesh->vertices, name, &mesh->vertices);
  if (status != FUM_OK) return status;
  status = fum_alloc(context, d->triangle_count, 3 * sizeof *mesh->triangles, name, &mesh->triangles);
  if (status != FUM_OK) return status;
  if (d->normals != NULL) {
    status = fum_alloc(context, d->triangle_count, 9 * sizeof *mesh->normals, name, &mesh->normals);
    if (status != FUM_OK) return status;
    if (d->triangle_count > 0) memcpy(mesh->normals, d->normals, (size_t)d->triangle_count * 9 * sizeof *mesh->normals);
  }
  if (d->vertex_count > 0) memcpy(mesh->vertices, d->vertices, (size_t)d->vertex_count * 3 * sizeof *mesh->vertices);
  if (d->triangle_count > 0)
    memcpy(mesh->triangles, d->triangles, (size_t)d->triangle_count * 3 * sizeof *mesh->triangles);
  return FUM_OK;
}

int32_t fum_scene_add_mesh(fum_scene *scene, const fum_mesh_desc *desc) {
  fum_context *context = scene->context;
  if (desc == NULL || desc->struct_size < sizeof *desc) {
    return fum_fail(context, FUM_ERROR_ARGUMENT, "mesh: the description has no valid struct_size");
  }
  const char *name = desc->name != NULL ? desc->name : "mesh";
  fum_mesh mesh = {.visibility = desc->visibility,
                   .vertex_count = desc->vertex_count,
                   .triangle_count = desc->triangle_count,
                   .light_set = desc->light_set,
                   .shadow_set = desc->shadow_set,
                   .is_holdout = desc->is_holdout != 0};
  memcpy(mesh.world_from_local, desc->world_from_local, sizeof mesh.world_from_local);
  memcpy(mesh.albedo, desc->albedo, sizeof mesh.albedo);
  memcpy(mesh.emission, desc->emission, sizeof mesh.emission);
  int32_t status = check_desc(context, desc, name);
  if (status == FUM_OK) status = copy_mesh(context, desc, name, &mesh);
  if (status != FUM_OK) goto done;
  mesh.name = fum_copy_string(name);
  fum_mesh *grown = realloc(scene->meshes, (size_t)(scene->mesh_count + 1) * sizeof *grown);
  if (grown != NULL) scene->meshes = grown;
  if (mesh.name == NULL || grown == NULL) {
    status = fum_fail(context, FUM_ERROR_MEMORY, "%s: no memory for another mesh", name);
    goto done;
  }
  scene->meshes[scene->mesh_count++] = mesh;
  mesh = (fum_mesh){0};
  fum_scene_drop_caches(scene);
done:
  free_mesh(context, &mesh);
  return status;
}
