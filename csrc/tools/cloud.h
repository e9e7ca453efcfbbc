/* SPDX-License-Identifier: GPL-3.0-or-later */
/* Particles for the benchmark: generated or read from a file. */
#ifndef FUM_TOOLS_CLOUD_H
#define FUM_TOOLS_CLOUD_H

#include <stdint.h>

typedef struct cloud {
  int64_t count;
  float *positions; /* [3 count] */
  float *radii;     /* [count] */
  float *densities; /* [count] */
  float *albedos;   /* [3 count] or NULL */
} cloud;

/* A turbulent plume 3 m high: sigma = cbrt(0.7 / n) at the mean number density n, optical depth about 8 across. The
 * same for the same count. Returns 0, or nonzero without memory. */
int cloud_plume(int64_t count, cloud *out_cloud);

/* Binary little-endian PLY: x y z and optionally radius, density, red green blue. On failure returns nonzero and a
 * sentence in `out_error`. */
int cloud_read_ply(const char *path, cloud *out_cloud, char out_error[256]);

void cloud_free(cloud *c);

#endif
