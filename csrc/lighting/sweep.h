/* SPDX-License-Identifier: GPL-3.0-or-later */
/* The sweep: optical depth from a light to many receivers in time that grows with their number and that of the casters.
 *
 * Seen from the light a caster is a Gaussian footprint. Casters are added to a grid over the light's view from the
 * light outwards, receivers are read from it on the way (DESIGN.md, section 2). Along the rays the grid is cut into
 * slabs, in which each caster leaves its closed-form share. Grids in all three directions are read with cubic
 * B-splines, and casters are put in narrower by as much as these widen them: so a step may be as large as sigma. */
#ifndef FUM_LIGHTING_SWEEP_H
#define FUM_LIGHTING_SWEEP_H

#include "lighting/sweep_patches.h"

/* What the patches of a level share. */
typedef struct fum_sweep_job {
  const fum_octree *casters, *points;
  float sigma_scale, depth_scale; /* of what is put in: that which lies beyond the reach included */
  float edge;                     /* what a Gaussian falls to there */
  const fum_sweep_view *view;
  const fum_sweep_level *level;
  const fum_sweep_patches *patches;
  fum_vec3 to_middle;    /* of the view... */
  float beyond;          /* ...and its squared length less that of the reference */
  const uint8_t *is_lit; /* [points->count] */
  float *depths;         /* [points->count] what is found is added */
} fum_sweep_job;

typedef enum fum_sweep_buffer {
  FUM_SWEEP_LINES,
  FUM_SWEEP_TAPS,
  FUM_SWEEP_FOOTPRINTS,
  FUM_SWEEP_CASTER_BEGINS,
  FUM_SWEEP_CASTER_ORDER,
  FUM_SWEEP_NODE_BEGINS,
  FUM_SWEEP_NODE_ORDER,
  FUM_SWEEP_CHUNKS,
  FUM_SWEEP_BATCHES,
  FUM_SWEEP_BUFFER_COUNT
} fum_sweep_buffer;

/* Buffers of one thread; zeroed before the first patch, freed one by one. */
typedef struct fum_sweep_scratch {
  void *buffers[FUM_SWEEP_BUFFER_COUNT];
  int64_t sizes[FUM_SWEEP_BUFFER_COUNT];
  bool is_out_of_memory;
} fum_sweep_scratch;

/* Works on patch `index`. */
typedef void (*fum_sweep_fn)(const fum_sweep_job *job, int64_t index, fum_sweep_scratch *scratch);

/* The loop for this processor. */
fum_sweep_fn fum_sweep_get(void);

enum { FUM_SWEEP_MOST_LEVELS = 12 };

/* What is to be solved. */
typedef struct fum_sweep_task {
  const fum_medium *medium;
  fum_receivers *receivers;
  const fum_emitter *emitter;
  const uint8_t *is_lit; /* in receivers' order */
  double affordable_us;  /* predicted time, on all threads together, that it may take; INFINITY: whatever it takes */
} fum_sweep_task;

/* Optical depth from each lit receiver to the emitter, as fum_exact_solve. Sets `*out_is_solved` to false, and nothing
 * else, where a sweep can't do it or takes too long: casters too small for a grid, or more unlike than the levels
 * allow, and a light in whose vicinity there are most of the casters. */
int32_t fum_sweep_solve(fum_context *context, const fum_sweep_task *task, const float progress[2], float *out_depths,
                        bool *out_is_solved);

#endif
