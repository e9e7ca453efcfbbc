/* SPDX-License-Identifier: GPL-3.0-or-later */
#include "lighting/solver.h"

#include "lighting/sweep.h"

int32_t fum_solver_solve(fum_context *context, fum_solver *solver, fum_medium *medium, const fum_receivers *receivers,
                         const fum_emitter *emitter, const uint8_t *is_lit, const float progress[2],
                         float *out_depths) {
  bool is_solved = false;
  if (solver->wanted == FUM_SOLVER_SWEEP) {
    const int32_t status =
        fum_sweep_solve(context, medium, receivers, emitter, is_lit, progress, out_depths, &is_solved);
    if (status != FUM_OK) return status;
  }
  solver->sweep_count += is_solved;
  solver->exact_count += !is_solved;
  return is_solved ? FUM_OK : fum_exact_solve(context, medium, receivers, emitter, is_lit, progress, out_depths);
}
