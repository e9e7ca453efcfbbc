/* SPDX-License-Identifier: GPL-3.0-or-later */
/* Optical depth of runs of neighbouring particles along a segment: the innermost loop of lighting. A segment first
 * meets the spheres around runs; the particles of those that it can hear are summed with the closed form of pairs.h. */
#ifndef FUM_LIGHTING_RUNS_H
#define FUM_LIGHTING_RUNS_H

#include "lighting/pairs.h"
#include "octree/beam.h"

enum { FUM_RUN_SIZE = 16, FUM_BATCH_SIZE = 64 };

/* Particles as the loop wants them; entries behind the last have no optical depth. */
typedef struct fum_run {
  float x[FUM_RUN_SIZE], y[FUM_RUN_SIZE], z[FUM_RUN_SIZE]; /* m, from the middle of the run */
  float scales[FUM_RUN_SIZE];                              /* sqrt(log2(e) / 2) / sigma: exp(-d^2 / 2 sigma^2) is
                                                              2^-(d scale)^2 */
  float optical_depths[FUM_RUN_SIZE];
} fum_run;

/* Spheres around runs. Arrays have FUM_RUN_SIZE readable entries behind their last. */
typedef struct fum_spheres {
  float *x, *y, *z; /* middles */
  float *hearing;   /* m; a segment farther from the middle than this misses the run */
  float *clear;     /* m; an end of a segment farther along it than this cuts no particle */
} fum_spheres;

/* Runs that a beam hears. */
typedef struct fum_batch {
  int32_t count;
  const fum_run *runs[FUM_BATCH_SIZE];
  float x[FUM_BATCH_SIZE], y[FUM_BATCH_SIZE], z[FUM_BATCH_SIZE];
  float hearing[FUM_BATCH_SIZE], clear[FUM_BATCH_SIZE];
} fum_batch;

typedef struct fum_run_loops {
  /* Which of `count` spheres from `first` on, FUM_BATCH_SIZE at most, a beam hears: bit i for sphere first + i. */
  uint64_t (*hear)(const fum_beam *beam, const fum_spheres *spheres, uint32_t first, int32_t count);
  /* Optical depth of the batch along the segment. */
  float (*sum)(const fum_batch *batch, const fum_segment *segment);
} fum_run_loops;

/* The loops for this processor. */
const fum_run_loops *fum_run_loops_get(void);

#endif
