/* SPDX-License-Identifier: GPL-3.0-or-later */
#include "lighting/pairs.h"

#include "base/cpu.h"

extern const fum_pairs fum_pairs_plain, fum_pairs_avx2, fum_pairs_avx512;

const fum_pairs *fum_pairs_get(void) {
  return FUM_CPU_CHOOSE(&fum_pairs_plain, &fum_pairs_avx2, &fum_pairs_avx512);
}
