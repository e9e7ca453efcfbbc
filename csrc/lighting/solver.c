/* SPDX-License-Identifier: GPL-3.0-or-later */
#include "lighting/solver.h"

#include "lighting/sweep.h"

#include <math.h>

/* Where a sweep's errors don't matter beside the tolerance (docs/ACCURACY.md): they grow with the thickness, in which
 * exact solvers are quick. */
static const float LEAST_TOLERANCE = 0.005F;
static const double MOST_THICKNESS = 0.6;

/* Of fewer, each is seen, and how it lies between grid lines as well when the light moves. */
enum { FEWEST_CASTERS = 10000 };

/* Levels of a sweep up to which it is predicted to be faster than the exact solver; 0: none. Of measured times: exactly
 * a receiver takes as long as it meets particles, whose number grows with the cube root; by a sweep, a caster takes its
 * time at its own level, and each is looked at, as each receiver is, at all of them. */
static int32_t affordable_levels(int64_t casters, int64_t receivers) {
  const double exact_us = 0.018 * cbrt((double)casters) * (double)receivers;
  const double once_us = 0.16 * (double)casters, level_us = 0.04 * (double)casters + 0.07 * (double)receivers;
  return exact_us > once_us ? (int32_t)fmin((exact_us - once_us) / level_us, (double)FUM_SWEEP_MOST_LEVELS) : 0;
}

static int32_t levels_to_try(const fum_solver *solver, const fum_medium *medium, const fum_receivers *receivers) {
  if (solver->wanted == FUM_SOLVER_SWEEP) return FUM_SWEEP_MOST_LEVELS;
  if (solver->wanted == FUM_SOLVER_EXACT || solver->tolerance < LEAST_TOLERANCE) return 0;
  if (medium->thickness > MOST_THICKNESS || medium->octree->count < FEWEST_CASTERS) return 0;
  return affordable_levels(fum_medium_casters(medium)->count, receivers->octree->count);
}

int32_t fum_solver_solve(fum_context *context, fum_solver *solver, fum_medium *medium, const fum_receivers *receivers,
                         const fum_emitter *emitter, const uint8_t *is_lit, const float progress[2],
                         float *out_depths) {
  const int32_t levels = levels_to_try(solver, medium, receivers);
  bool is_solved = false;
  if (levels > 0) {
    const fum_sweep_task task = {medium, receivers, emitter, is_lit, levels};
    const int32_t status = fum_sweep_solve(context, &task, progress, out_depths, &is_solved);
    if (status != FUM_OK) return status;
  }
  solver->sweep_count += is_solved;
  solver->exact_count += !is_solved;
  return is_solved ? FUM_OK : fum_exact_solve(context, medium, receivers, emitter, is_lit, progress, out_depths);
}
