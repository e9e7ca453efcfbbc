/* SPDX-License-Identifier: GPL-3.0-or-later */
/* The one way to the solvers: receivers in, optical depth to a light out. */
#ifndef FUM_LIGHTING_SOLVER_H
#define FUM_LIGHTING_SOLVER_H

#include "lighting/exact.h"

typedef struct fum_solver {
  int32_t wanted;                   /* FUM_SOLVER_ */
  int64_t exact_count, sweep_count; /* calls that each has solved */
} fum_solver;

/* As fum_exact_solve. What a sweep can't do is solved exactly, whatever was wanted. */
int32_t fum_solver_solve(fum_context *context, fum_solver *solver, fum_medium *medium, const fum_receivers *receivers,
                         const fum_emitter *emitter, const uint8_t *is_lit, const float progress[2], float *out_depths);

#endif
