/* SPDX-License-Identifier: GPL-3.0-or-later */
/* Shadows of the casters in a light's vicinity, which are too large or too near for the sweep's grids. Receivers behind
 * all of them see each in full: how deep they are depends on the direction alone and is smooth in it, so it is sampled
 * in directions all around the light. For receivers among them it is found exactly, one by one. */
#ifndef FUM_LIGHTING_SWEEP_NEAR_H
#define FUM_LIGHTING_SWEEP_NEAR_H

#include "lighting/sweep.h"

typedef struct fum_sweep_near {
  bool is_worthwhile; /* few enough of all the casters are near, or none */
  double cost_us;     /* predicted, on all threads together */
  uint8_t *is_exact;  /* [receivers] lit, and to be found one by one; NULL where no casters are near */
  int32_t side;       /* directions along a side of a face of the cube around the light; 0: no receiver needs them */
} fum_sweep_near;

/* Decides how the vicinity is worked on. Freed by fum_sweep_near_free, on failure as well. */
int32_t fum_sweep_near_plan(fum_context *context, const fum_sweep_task *task, const fum_sweep_view *view,
                            fum_sweep_near *out_near);
void fum_sweep_near_free(fum_context *context, fum_sweep_near *near);

/* Sets lit receivers' depths to that of the casters in the vicinity; leaves them alone where there are none. */
int32_t fum_sweep_near_solve(fum_context *context, const fum_sweep_task *task, const fum_sweep_view *view,
                             const fum_sweep_near *near, const float progress[2], float *depths);

#endif
