/* SPDX-License-Identifier: GPL-3.0-or-later */
#include "solid/solid.h"

#include <embree3/rtcore.h>
#include <pthread.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>

struct fum_solids {
  RTCDevice device;
  RTCScene shadow;        /* NULL: no mesh casts shadows */
  uint64_t shadow_sets;   /* of its meshes */
  RTCScene camera;        /* NULL: the camera sees no mesh */
  const fum_mesh *meshes; /* the scene's; they stay in place as long as the hierarchies */
};

/* Embree calls this on whatever thread fails; the first message is kept. */
static void note_error(void *user, enum RTCError code, const char *text) {
  char *message = user;
  if (message[0] == '\0') snprintf(message, 256, "%s (code %d)", text != NULL ? text : "no message", (int)code);
}

void fum_solids_embree_version(char out_version[32]) {
  snprintf(out_version, 32, "?");
  RTCDevice device = rtcNewDevice("threads=1");
  if (device == NULL) return;
  snprintf(out_version, 32, "%d.%d.%d", (int)rtcGetDeviceProperty(device, RTC_DEVICE_PROPERTY_VERSION_MAJOR),
           (int)rtcGetDeviceProperty(device, RTC_DEVICE_PROPERTY_VERSION_MINOR),
           (int)rtcGetDeviceProperty(device, RTC_DEVICE_PROPERTY_VERSION_PATCH));
  rtcReleaseDevice(device);
}

int32_t fum_solids_check_embree(fum_context *context) {
  char reached[32], built[32];
  fum_solids_embree_version(reached);
  snprintf(built, sizeof built, "%d.%d.%d", RTC_VERSION_MAJOR, RTC_VERSION_MINOR, RTC_VERSION_PATCH);
  if (strcmp(reached, built) == 0) return FUM_OK;
  return fum_fail(context, FUM_ERROR_LIBRARY,
                  "this library was built for Embree %s, but the process reaches Embree %s; load it with RTLD_DEEPBIND",
                  built, reached);
}

static void transform_vertices(const fum_scene *scene, const fum_mesh *mesh, float *out_vertices) {
  for (int64_t i = 0; i < mesh->vertex_count; i++) {
    const float *v = mesh->vertices + 3 * i;
    double world[3];
    fum_transform_point(mesh->world_from_local, (double[3]){(double)v[0], (double)v[1], (double)v[2]}, world);
    for (int axis = 0; axis < 3; axis++)
      out_vertices[3 * i + axis] = (float)(world[axis] - scene->origin[axis]);
  }
}

/* Geometries have the numbers of their meshes. */
static void attach(RTCDevice device, RTCScene *scene, RTCGeometry geometry, int32_t mesh) {
  if (*scene == NULL) {
    *scene = rtcNewScene(device);
    /* Watertight at edges: light must not leak between triangles. */
    rtcSetSceneFlags(*scene, RTC_SCENE_FLAG_ROBUST);
  }
  rtcAttachGeometryByID(*scene, geometry, (unsigned)mesh);
}

static int32_t add_mesh(const fum_scene *scene, int32_t index, fum_solids *solids) {
  const fum_mesh *mesh = &scene->meshes[index];
  RTCGeometry geometry = rtcNewGeometry(solids->device, RTC_GEOMETRY_TYPE_TRIANGLE);
  float *vertices = rtcSetNewGeometryBuffer(geometry, RTC_BUFFER_TYPE_VERTEX, 0, RTC_FORMAT_FLOAT3, 3 * sizeof(float),
                                            (size_t)mesh->vertex_count);
  uint32_t *triangles = rtcSetNewGeometryBuffer(geometry, RTC_BUFFER_TYPE_INDEX, 0, RTC_FORMAT_UINT3,
                                                3 * sizeof(uint32_t), (size_t)mesh->triangle_count);
  if (vertices == NULL || triangles == NULL) {
    rtcReleaseGeometry(geometry);
    return fum_fail(scene->context, FUM_ERROR_MEMORY, "%s: no memory for %lld triangles in Embree", mesh->name,
                    (long long)mesh->triangle_count);
  }
  transform_vertices(scene, mesh, vertices);
  memcpy(triangles, mesh->triangles, (size_t)mesh->triangle_count * 3 * sizeof *triangles);
  /* Stays in place as long as the hierarchies. */
  rtcSetGeometryUserData(geometry, (void *)mesh);
  rtcCommitGeometry(geometry);
  if ((mesh->visibility & FUM_VISIBLE_TO_SHADOW) != 0) {
    attach(solids->device, &solids->shadow, geometry, index);
    solids->shadow_sets |= UINT64_C(1) << mesh->shadow_set;
  }
  if ((mesh->visibility & FUM_VISIBLE_TO_CAMERA) != 0) attach(solids->device, &solids->camera, geometry, index);
  rtcReleaseGeometry(geometry);
  return FUM_OK;
}

/* Embree asks this from its own threads as well; only the thread that called us may report. */
typedef struct monitor {
  fum_context *context;
  pthread_t caller;
} monitor;

static bool go_on(void *user, double fraction) {
  (void)fraction;
  monitor *m = user;
  if (pthread_equal(pthread_self(), m->caller)) fum_progress_pulse(m->context);
  return !fum_is_cancelled(m->context);
}

static void commit(fum_context *context, RTCScene scene) {
  if (scene == NULL || fum_is_cancelled(context)) return;
  monitor m = {context, pthread_self()};
  rtcSetSceneProgressMonitorFunction(scene, go_on, &m);
  rtcCommitScene(scene);
  rtcSetSceneProgressMonitorFunction(scene, NULL, NULL);
}

int32_t fum_solids_build(const fum_scene *scene, fum_solids **out_solids) {
  fum_context *context = scene->context;
  int64_t triangles = 0;
  for (int32_t i = 0; i < scene->mesh_count; i++)
    triangles += scene->meshes[i].triangle_count;
  if (triangles == 0) return FUM_OK;
  char message[256] = "", options[64];
  int32_t status = FUM_OK;
  fum_solids *solids = calloc(1, sizeof *solids);
  if (solids == NULL) return fum_fail(context, FUM_ERROR_MEMORY, "no memory for meshes");
  solids->meshes = scene->meshes;
  snprintf(options, sizeof options, "threads=%d", (int)fum_thread_count(context));
  solids->device = rtcNewDevice(options);
  if (solids->device == NULL) {
    status = fum_fail(context, FUM_ERROR_LIBRARY, "Embree gives no device (code %d)", (int)rtcGetDeviceError(NULL));
    goto done;
  }
  rtcSetDeviceErrorFunction(solids->device, note_error, message);
  for (int32_t i = 0; i < scene->mesh_count && status == FUM_OK; i++) {
    if (scene->meshes[i].triangle_count > 0) status = add_mesh(scene, i, solids);
    if (status == FUM_OK) status = fum_progress_report(context, FUM_STAGE_OCTREE, 0.0F, "Building meshes");
  }
  if (status != FUM_OK) goto done;
  const bool has_sets = (solids->shadow_sets & (solids->shadow_sets - 1)) != 0;
  if (has_sets) rtcSetSceneFlags(solids->shadow, RTC_SCENE_FLAG_ROBUST | RTC_SCENE_FLAG_CONTEXT_FILTER_FUNCTION);
  commit(context, solids->shadow);
  commit(context, solids->camera);
  rtcSetDeviceErrorFunction(solids->device, NULL, NULL);
  status = fum_progress_report(context, FUM_STAGE_OCTREE, 0.0F, "Building meshes");
  if (status != FUM_OK) goto done;
  if (message[0] != '\0') {
    status = fum_fail(context, FUM_ERROR_LIBRARY, "Embree could not build the meshes: %s", message);
    goto done;
  }
  *out_solids = solids;
  solids = NULL;
done:
  fum_solids_destroy(solids);
  return status;
}

void fum_solids_destroy(fum_solids *solids) {
  if (solids == NULL) return;
  if (solids->shadow != NULL) rtcReleaseScene(solids->shadow);
  if (solids->camera != NULL) rtcReleaseScene(solids->camera);
  if (solids->device != NULL) rtcReleaseDevice(solids->device);
  free(solids);
}

static struct RTCRay make_ray(fum_vec3 origin, fum_vec3 direction, float near, float far) {
  return (struct RTCRay){.org_x = origin.x,
                         .org_y = origin.y,
                         .org_z = origin.z,
                         .tnear = near,
                         .dir_x = direction.x,
                         .dir_y = direction.y,
                         .dir_z = direction.z,
                         .tfar = far,
                         .mask = 0xffffffffU};
}

/* A ray that some meshes don't block. */
typedef struct linked_context {
  struct RTCIntersectContext context; /* first, so that Embree's pointer is one to both */
  uint64_t blockers;
} linked_context;

static void let_through(const struct RTCFilterFunctionNArguments *arguments) {
  const fum_mesh *mesh = arguments->geometryUserPtr;
  const linked_context *how = (const linked_context *)(const void *)arguments->context;
  if (!fum_has_set(how->blockers, mesh->shadow_set)) arguments->valid[0] = 0;
}

bool fum_solids_occlude(const fum_solids *solids, uint64_t blockers, fum_vec3 origin, fum_vec3 direction,
                        float length) {
  if (solids == NULL || (solids->shadow_sets & blockers) == 0) return false;
  linked_context how = {.blockers = blockers};
  rtcInitIntersectContext(&how.context);
  if ((solids->shadow_sets & ~blockers) != 0) how.context.filter = let_through;
  struct RTCRay ray = make_ray(origin, direction, 0.0F, length);
  rtcOccluded1(solids->shadow, &how.context, &ray);
  return ray.tfar < 0.0F;
}

bool fum_solids_hide_from_camera(const fum_solids *solids) {
  return solids != NULL && solids->camera != NULL;
}

/* Normals go by the inverse of the transposed matrix, which is that of its cofactors but for the length. */
static fum_vec3 find_smooth(const fum_mesh *mesh, const struct RTCHit *hit, fum_vec3 flat) {
  if (mesh->normals == NULL) return flat;
  const float *n = mesh->normals + 9 * (int64_t)hit->primID, weights[3] = {1.0F - hit->u - hit->v, hit->u, hit->v};
  const double *m = mesh->world_from_local;
  double local[3], world[3];
  for (int axis = 0; axis < 3; axis++)
    local[axis] = (double)(weights[0] * n[axis] + weights[1] * n[3 + axis] + weights[2] * n[6 + axis]);
  for (int row = 0; row < 3; row++) {
    const double *a = m + 4 * ((row + 1) % 3), *b = m + 4 * ((row + 2) % 3);
    world[row] = local[0] * (a[1] * b[2] - a[2] * b[1]) + local[1] * (a[2] * b[0] - a[0] * b[2]) +
                 local[2] * (a[0] * b[1] - a[1] * b[0]);
  }
  const fum_vec3 smooth = {(float)world[0], (float)world[1], (float)world[2]};
  const float length = fum_length(smooth), side = fum_dot(smooth, flat) < 0.0F ? -1.0F : 1.0F;
  return length > 0.0F ? fum_scaled(smooth, side / length) : flat;
}

float fum_solids_see(const fum_solids *solids, fum_vec3 origin, fum_vec3 direction, float near, float far,
                     fum_solid_point *out_point) {
  if (!fum_solids_hide_from_camera(solids)) return far;
  struct RTCIntersectContext how;
  rtcInitIntersectContext(&how);
  struct RTCRayHit hit = {.ray = make_ray(origin, direction, near, far), .hit = {.geomID = RTC_INVALID_GEOMETRY_ID}};
  rtcIntersect1(solids->camera, &how, &hit);
  const fum_vec3 normal = {hit.hit.Ng_x, hit.hit.Ng_y, hit.hit.Ng_z};
  const float length = fum_length(normal), side = fum_dot(normal, direction) > 0.0F ? -1.0F : 1.0F;
  out_point->mesh = (int32_t)hit.hit.geomID;
  out_point->normal = fum_scaled(normal, length > 0.0F ? side / length : 0.0F);
  if (hit.hit.geomID != RTC_INVALID_GEOMETRY_ID)
    out_point->smooth = find_smooth(&solids->meshes[hit.hit.geomID], &hit.hit, out_point->normal);
  return hit.ray.tfar;
}
