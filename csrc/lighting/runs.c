/* SPDX-License-Identifier: GPL-3.0-or-later */
#include "lighting/runs.h"

#include "base/cpu.h"

extern const fum_run_loops fum_run_loops_plain, fum_run_loops_avx2, fum_run_loops_avx512;

const fum_run_loops *fum_run_loops_get(void) {
#if defined(__x86_64__)
  switch (fum_cpu()) {
  case FUM_CPU_AVX512:
    return &fum_run_loops_avx512;
  case FUM_CPU_AVX2:
    return &fum_run_loops_avx2;
  default:
    return &fum_run_loops_plain;
  }
#else
  return &fum_run_loops_plain;
#endif
}
