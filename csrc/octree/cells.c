/* SPDX-License-Identifier: GPL-3.0-or-later */
#include "octree/cells.h"

#include "base/cpu.h"

extern const fum_cell_loops fum_cell_loops_plain, fum_cell_loops_avx2, fum_cell_loops_avx512;

const fum_cell_loops *fum_cell_loops_get(void) {
  return FUM_CPU_CHOOSE(&fum_cell_loops_plain, &fum_cell_loops_avx2, &fum_cell_loops_avx512);
}
