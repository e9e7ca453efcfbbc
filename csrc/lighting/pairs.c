/* SPDX-License-Identifier: GPL-3.0-or-later */
#include "lighting/pairs.h"

#include "base/cpu.h"

extern const fum_pairs fum_pairs_plain, fum_pairs_avx2, fum_pairs_avx512;

const fum_pairs *fum_pairs_get(void) {
#if defined(__x86_64__)
  switch (fum_cpu()) {
  case FUM_CPU_AVX512:
    return &fum_pairs_avx512;
  case FUM_CPU_AVX2:
    return &fum_pairs_avx2;
  default:
    return &fum_pairs_plain;
  }
#else
  return &fum_pairs_plain;
#endif
}
