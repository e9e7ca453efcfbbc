/* SPDX-License-Identifier: GPL-3.0-or-later */
#include "lighting/runs.h"

#include "base/cpu.h"

extern const fum_run_loops fum_run_loops_plain, fum_run_loops_avx2, fum_run_loops_avx512;

const fum_run_loops *fum_run_loops_get(void) {
  return FUM_CPU_CHOOSE(&fum_run_loops_plain, &fum_run_loops_avx2, &fum_run_loops_avx512);
}
