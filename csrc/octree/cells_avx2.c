/* SPDX-License-Identifier: GPL-3.0-or-later */
#define FUM_LANES 8
#define FUM_CELL_LOOPS_NAME fum_cell_loops_avx2
#include "octree/cells_loop.h"
