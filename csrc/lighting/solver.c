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

/* Time that a sweep may take: as long as the exact solver. 0: there is to be none. */
static double affordable_us(const fum_solver *solver, const fum_medium *medium, const fum_receivers *receivers) {
  if (solver->wanted == FUM_SOLVER_SWEEP) return INFINITY;
  if (solver->wanted == FUM_SOLVER_EXACT || solver->tolerance < LEAST_TOLERANCE) return 0.0;
  if (medium->thickness > MOST_THICKNESS || medium->octree->count < FEWEST_CASTERS) return 0.0;
  return fum_exact_predict_us(fum_medium_casters(medium)->count, receivers->octree->count);
}

/* Side of the cells whose particles a sweep may take for one, in sigmas. What that is off by grows with the square of
 * the side and the root of the thickness, and is to be a third of the tolerance at most (docs/ACCURACY.md). */
static float bunch_side(const fum_solver *solver, const fum_medium *medium) {
  const double usual_thickness = 0.024, usual_tolerance = 0.01, usual = 1.9, least = 1.2, most = 3.0;
  const double share = (double)solver->tolerance / usual_tolerance * sqrt(usual_thickness / medium->thickness);
  const double side = usual * sqrt(share);
  return solver->is_careful || side < least ? 0.0F : (float)fmin(most, side);
}

/* The medium with its bunches, which it keeps, in the place of its particles. */
static int32_t bunch(fum_context *context, fum_solver *solver, fum_medium *medium, fum_medium *out) {
  const float side = bunch_side(solver, medium);
  const int32_t status = side > 0.0F ? fum_medium_bunch(context, side, medium) : FUM_OK;
  *out = *medium;
  if (side > 0.0F && medium->bunched != NULL) {
    out->merged = medium->bunched;
    solver->has_bunched = true;
  }
  return status;
}

int32_t fum_solver_solve(fum_context *context, fum_solver *solver, fum_medium *medium, fum_receivers *receivers,
                         const fum_emitter *emitter, const uint8_t *is_lit, const float progress[2],
                         float *out_depths) {
  const double most_us = affordable_us(solver, medium, receivers);
  bool is_solved = false;
  if (most_us > 0.0) {
    fum_medium bunched;
    int32_t status = bunch(context, solver, medium, &bunched);
    const fum_sweep_task task = {&bunched, receivers, emitter, is_lit, most_us};
    if (status == FUM_OK) status = fum_sweep_solve(context, &task, progress, out_depths, &is_solved);
    if (status != FUM_OK) return status;
  }
  solver->sweep_count += is_solved;
  solver->exact_count += !is_solved;
  return is_solved ? FUM_OK : fum_exact_solve(context, medium, receivers, emitter, is_lit, progress, out_depths);
}
