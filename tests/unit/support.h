/* SPDX-License-Identifier: GPL-3.0-or-later */
/* What the unit tests share: cmocka, a scene to build on and double-precision brute force. */
#ifndef FUM_TESTS_SUPPORT_H
#define FUM_TESTS_SUPPORT_H

#include <setjmp.h>
#include <stdarg.h>
#include <stddef.h>
#include <stdint.h>

#include <cmocka.h>

#include "base/hash.h"
#include "scene/scene.h"

#include <math.h>
#include <stdlib.h>
#include <string.h>

/* A context and a scene for one test. */
typedef struct stage {
  fum_context *context;
  fum_scene *scene;
} stage;

static inline stage stage_open(void) {
  stage s = {0};
  assert_int_equal(fum_context_create(&s.context), FUM_OK);
  assert_int_equal(fum_scene_create(s.context, &s.scene), FUM_OK);
  return s;
}

static inline void stage_close(stage *s) {
  fum_scene_destroy(s->scene);
  assert_int_equal(atomic_load(&s->context->memory_bytes), 0); /* everything was given back */
  fum_context_destroy(s->context);
}

static inline float uniform(uint64_t seed, float low, float high) {
  return low + (high - low) * (float)fum_hash_unit(seed);
}

/* Random particles in a box around `middle`; arrays belong to the caller. */
typedef struct puffs {
  int64_t count;
  float *positions, *radii, *densities;
} puffs;

static inline puffs puffs_random(int64_t count, uint64_t seed, float half_size, float radius, float density) {
  puffs p = {.count = count};
  p.positions = malloc((size_t)count * 3 * sizeof(float));
  p.radii = malloc((size_t)count * sizeof(float));
  p.densities = malloc((size_t)count * sizeof(float));
  assert_true(p.positions != NULL && p.radii != NULL && p.densities != NULL);
  for (int64_t i = 0; i < count; i++) {
    const uint64_t s = fum_hash64(seed) + (uint64_t)i * 5;
    for (int axis = 0; axis < 3; axis++)
      p.positions[3 * i + axis] = uniform(s + (uint64_t)axis, -half_size, half_size);
    p.radii[i] = radius * uniform(s + 3, 0.5F, 1.5F);
    p.densities[i] = density * uniform(s + 4, 0.5F, 1.5F);
  }
  return p;
}

static inline void puffs_free(puffs *p) {
  free(p->positions);
  free(p->radii);
  free(p->densities);
}

static inline void add_puffs(fum_scene *scene, const puffs *p) {
  fum_particles_desc desc;
  fum_particles_desc_init(&desc);
  desc.count = p->count;
  desc.positions = p->positions;
  desc.radii = p->radii;
  desc.densities = p->densities;
  assert_int_equal(fum_scene_add_particles(scene, &desc), FUM_OK);
}

static inline void add_point_light(fum_scene *scene, const double position[3]) {
  fum_light_desc desc;
  fum_light_desc_init(&desc);
  for (int axis = 0; axis < 3; axis++)
    desc.world_from_light[4 * axis + 3] = position[axis];
  assert_int_equal(fum_scene_add_light(scene, &desc), FUM_OK);
}

/* Optical depth of every particle between two points, DESIGN.md section 1, with nothing left out. */
static inline double brute_depth(const puffs *p, const double from[3], const double to[3]) {
  double u[3], length = 0.0, depth = 0.0;
  for (int axis = 0; axis < 3; axis++) {
    u[axis] = to[axis] - from[axis];
    length += u[axis] * u[axis];
  }
  length = sqrt(length);
  if (length == 0.0) return 0.0;
  for (int64_t i = 0; i < p->count; i++) {
    double t = 0.0, d2 = 0.0, d[3];
    for (int axis = 0; axis < 3; axis++) {
      d[axis] = (double)p->positions[3 * i + axis] - from[axis];
      t += d[axis] * u[axis] / length;
    }
    for (int axis = 0; axis < 3; axis++) {
      const double q = d[axis] - t * u[axis] / length;
      d2 += q * q;
    }
    const double sigma = 0.5 * (double)p->radii[i], root = sigma * sqrt(2.0);
    const double a = -t / root, b = (length - t) / root;
    const double interval = a > 0.0 ? erfc(a) - erfc(b) : b < 0.0 ? erfc(-b) - erfc(-a) : erf(b) - erf(a);
    depth +=
        (double)p->densities[i] * sigma * 2.50662827463100050242 * exp(-0.5 * d2 / (sigma * sigma)) * 0.5 * interval;
  }
  return depth;
}

#endif
