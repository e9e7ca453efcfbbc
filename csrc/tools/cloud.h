/* SPDX-License-Identifier: GPL-3.0-or-later */
/* Particles for the benchmark: generated or read from a file. */
#ifndef FUM_TOOLS_CLOUD_H
#define FUM_TOOLS_CLOUD_H

#include <stdint.h>

typedef struct cloud {
  int64_t count;
  float *positions;         /* [3 count] */
  float *radii;             /* [count] */
  float *densities;         /* [count] */
  float *albedos;           /* [3 count] or NULL */
  double middle[3], radius; /* what the camera frames */
  double depth;             /* optical depth that it was made for; 0: unknown */
  double overlap;           /* n sigma^3 that it was made for; 0: unknown */
  int has_wall;             /* a wall stands between every light and half of the cloud */
} cloud;

/* A cloud by name, the same for the same numbers: plume, ball, puff, six, mixed or edge. `count` -1, `depth` 0 and
 * `overlap` 0 are the scene's own. On failure returns nonzero and a sentence in `out_error`. */
int cloud_make(const char *name, int64_t count, double depth, double overlap, cloud *out_cloud, char out_error[256]);

/* Binary little-endian PLY: x y z and optionally radius, density, red green blue. On failure returns nonzero and a
 * sentence in `out_error`. */
int cloud_read_ply(const char *path, cloud *out_cloud, char out_error[256]);

/* Room for `count` particles but albedos. Returns 0, or nonzero without memory. */
int cloud_allocate(int64_t count, cloud *out_cloud);
void cloud_free(cloud *c);

/* Particles `grow` times as large of the same optical depth, then `dense` times as dense. */
void cloud_scale(cloud *c, double grow, double dense);

/* Frames the box around all particles. */
void cloud_frame(cloud *c);

/* A turbulent plume 3 m high: sigma = cbrt(c->overlap / n) at the mean number density n. Fills c->count particles. */
void cloud_fill_plume(cloud *c);

/* Random particles in a lumpy ball of about 1 m: n times the mean of sigma^3 is c->overlap. Fills c->count particles,
 * whose radii are drawn from 1 to `ratio` evenly by their logarithm; particles have the same optical depth. */
void cloud_fill_ball(cloud *c, double ratio);

/* Overlapping puffs of the optical depth c->depth each. Fills c->count, at most 6, particles. */
void cloud_fill_puffs(cloud *c);

#endif
