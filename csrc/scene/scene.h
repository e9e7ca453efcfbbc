/* SPDX-License-Identifier: GPL-3.0-or-later */
/* What is to be rendered, as it was described, checked and owned. */
#ifndef FUM_SCENE_SCENE_H
#define FUM_SCENE_SCENE_H

#include "base/context.h"
#include "scene/map.h"

/* A set of particles in the order of their ids; NULL arrays mean the uniform value beside them. */
typedef struct fum_particles {
  char *name;
  char *matte_name; /* in Cryptomatte */
  int64_t offset;   /* scene index of its first particle */
  int64_t count;
  float anisotropy;
  float *positions;                        /* [3 count] world space */
  float *sigmas;                           /* [count] m */
  float *densities;                        /* [count] peak extinction, the mean of red, green and blue, 1/m */
  float *tints;                            /* [3 count] extinction of red, green and blue over their mean, or NULL */
  float *albedos, *emissions, *velocities; /* [3 count] or NULL; velocities: world space, m a frame */
  uint64_t *ids;                           /* [count] or NULL: 0, 1, 2... */
  uint64_t seed;                           /* tells its particles from those of other sets with the same ids */
  float albedo[3], emission[3], tint[3];
  fum_map *map; /* on their billboards, or NULL */
  int32_t light_set, shadow_set;
  bool is_visible_to_camera;
} fum_particles;

typedef struct fum_mesh {
  char *name;
  uint32_t visibility;
  int64_t vertex_count, triangle_count;
  float *vertices;     /* [3 vertex_count] local space */
  uint32_t *triangles; /* [3 triangle_count] */
  float *normals;      /* [9 triangle_count] of their corners, or NULL: flat */
  double world_from_local[16];
  int32_t light_set, shadow_set;
  float albedo[3], emission[3];
  bool is_holdout; /* also where solids are shaded */
} fum_mesh;

typedef struct fum_light {
  char *name;
  fum_light_desc desc; /* name not to be used: it belongs to the caller */
  float *pixels;       /* desc.environment_pixels, owned; or NULL */
} fum_light;

struct fum_scene {
  fum_context *context;
  fum_particles *particles;
  int32_t particles_count; /* sets */
  int64_t particle_count;  /* over all sets */
  fum_mesh *meshes;
  int32_t mesh_count;
  fum_light *lights;
  int32_t light_count;
  double origin[3];          /* what is built from the scene lives in coordinates relative to this point... */
  struct fum_caches *caches; /* ...and is kept here by api/, until particles or meshes change */
};

/* Is this light_set or shadow_set among those of a light? -1 is among none. */
static inline bool fum_has_set(uint64_t sets, int32_t set) {
  return set >= 0 && (sets >> set & 1U) != 0;
}

/* `least` of shadow_set: 0 or -1. */
int32_t fum_check_link_sets(fum_context *context, const char *name, int32_t light_set, int32_t shadow_set,
                            int32_t least);

/* Do the same lights shine on two light_sets? */
bool fum_scene_is_lit_alike(const fum_scene *scene, int32_t a, int32_t b);

/* Set of the particle with this scene index. */
const fum_particles *fum_scene_particles_of(const fum_scene *scene, int64_t index);

/* What maps there are on particles that the camera sees. */
typedef struct fum_map_traits {
  bool has_maps;
  float edge, contrast; /* as of fum_map, the largest; 1 without maps */
} fum_map_traits;

fum_map_traits fum_scene_map_traits(const fum_scene *scene);

/* What random choices about a particle hang on: its id and its set's name, so that they stay the same from frame to
 * frame, whatever other sets come and go. */
uint64_t fum_particle_identity(const fum_particles *set, int64_t index_in_set);

/* Sets scene->origin to the middle of all particles (of all meshes where there are none), so that float coordinates
 * stay precise however far from the world's origin the scene stands. */
void fum_scene_find_origin(fum_scene *scene);

/* Frees what was built from particles and meshes. Defined by api/, which owns the caches. */
void fum_scene_drop_caches(fum_scene *scene);

#endif
