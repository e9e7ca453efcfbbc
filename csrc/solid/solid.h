/* SPDX-License-Identifier: GPL-3.0-or-later */
/* The scene's meshes as Embree sees them; the only place that knows Embree. */
#ifndef FUM_SOLID_SOLID_H
#define FUM_SOLID_SOLID_H

#include "base/vector.h"
#include "scene/scene.h"

typedef struct fum_solids fum_solids;

/* Fails unless the Embree that the process reaches is the one that this library was built for: a host may have another
 * one loaded under the same names, which would answer "not occluded" to every ray. */
int32_t fum_solids_check_embree(fum_context *context);

/* "major.minor.patch" that the process reaches, "?" if none answers. */
void fum_solids_embree_version(char out_version[32]);

/* Hierarchies over the scene's meshes, relative to scene->origin. *out_solids stays NULL if there is no triangle. */
int32_t fum_solids_build(const fum_scene *scene, fum_solids **out_solids);
void fum_solids_destroy(fum_solids *solids);

/* Is there a mesh that casts shadows, and whose shadow_set is among `blockers`, between origin and origin + length
 * direction? NULL solids hide nothing. */
bool fum_solids_occlude(const fum_solids *solids, uint64_t blockers, fum_vec3 origin, fum_vec3 direction, float length);

bool fum_solids_hide_from_camera(const fum_solids *solids);

/* Where a ray meets a mesh. */
typedef struct fum_solid_point {
  int32_t mesh;    /* of the scene */
  fum_vec3 normal; /* unit, of the triangle there, on the side that the ray comes from */
  fum_vec3 smooth; /* unit, of the smooth surface that the triangle stands for, on the same side; else the same */
} fum_solid_point;

/* Parameter t of the first point origin + t direction on a mesh that the camera sees, within near..far; far if none:
 * `out_point` is undefined then. */
float fum_solids_see(const fum_solids *solids, fum_vec3 origin, fum_vec3 direction, float near, float far,
                     fum_solid_point *out_point);

#endif
