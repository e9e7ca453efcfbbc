/* SPDX-License-Identifier: GPL-3.0-or-later */
/* The one way to the solvers: receivers in, optical depth to a light out. */
#ifndef FUM_LIGHTING_SOLVER_H
#define FUM_LIGHTING_SOLVER_H

#include "lighting/exact.h"

typedef struct fum_solver {
  int32_t wanted;                   /* FUM_SOLVER_ */
  float tolerance;                  /* of the picture; a sweep is for those that it keeps by far */
  bool is_careful;                  /* sweeps are to take each particle by itself */
  bool has_bunched;                 /* one didn't */
  int64_t exact_count, sweep_count; /* calls that each has solved */
} fum_solver;

/* As fum_exact_solve, by what is wanted; automatic: by what is predicted to be faster. What a sweep can't do is solved
 * exactly, whatever is wanted. */
int32_t fum_solver_solve(fum_context *context, fum_solver *solver, fum_medium *medium, fum_receivers *receivers,
                         const fum_emitter *emitter, const uint8_t *is_lit, const float progress[2], float *out_depths);

/* After the meter has said no: if the choice was free and a sweep was taken, takes back the counts, has everything
 * solved more exactly from now on, by careful sweeps or not by sweeps, and returns true. */
static inline bool fum_solver_fall_back(fum_solver *solver) {
  if (solver->wanted != FUM_SOLVER_AUTOMATIC || solver->sweep_count == 0) return false;
  const int32_t wanted = solver->has_bunched ? FUM_SOLVER_AUTOMATIC : FUM_SOLVER_EXACT;
  *solver = (fum_solver){.wanted = wanted, .tolerance = solver->tolerance, .is_careful = true};
  return true;
}

#endif
