/* SPDX-License-Identifier: GPL-3.0-or-later */
/* The radiance that comes along one ray to the camera: the integral of DESIGN's physical model, refined until it has
 * converged. */
#ifndef FUM_REFERENCE_RAY_H
#define FUM_REFERENCE_RAY_H

#include "reference/lamp.h"
#include "reference/smoke.h"
#include "solid/solid.h"

/* What all rays share. */
typedef struct fum_reference_world {
  fum_context *context;
  const fum_smoke *smoke;
  const fum_solids *solids;        /* NULL: none */
  const fum_reference_lamp *lamps; /* [lamp_count] */
  int32_t lamp_count;
  double tolerance;
} fum_reference_world;

/* A part of the ray and the integral over it. */
typedef struct fum_panel {
  double begin, end; /* m along the ray */
  double value[3], error;
} fum_panel;

/* One thread's room for a ray; zero-initialised, freed with fum_ray_free. */
typedef struct fum_ray {
  const fum_reference_world *world;
  fum_way way;  /* from the camera to the nearest solid or clip end */
  double start; /* m along the way at which smoke is seen first: clip start */
  fum_heard_list heard;
  int64_t *active; /* [heard.capacity] of `heard`, those that matter in a panel */
  int64_t active_capacity;
  double *scattering; /* [3 sets] at a point: extinction times albedo */
  fum_panel *panels;
  int64_t panel_count, panel_capacity, step_count;
} fum_ray;

typedef struct fum_ray_result {
  double radiance[3], alpha;
  double through[3]; /* transmittance of the whole way, for red, green and blue */
  double half_way;   /* m along the way at which half of the light gets through; INFINITY: nowhere */
  double error;      /* estimated, of the radiance in the channel that is off most */
  bool has_converged;
} fum_ray_result;

/* Fails with FUM_ERROR_MEMORY (without a message: threads must not write one) or FUM_ERROR_CANCELLED. */
int32_t fum_ray_integrate(fum_ray *ray, const fum_reference_world *world, const fum_way *way, double start,
                          bool wants_half_way, fum_ray_result *out_result);
void fum_ray_free(fum_ray *ray);

#endif
