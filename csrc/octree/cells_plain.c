/* SPDX-License-Identifier: GPL-3.0-or-later */
#define FUM_LANES 4
#define FUM_CELL_LOOPS_NAME fum_cell_loops_plain
#include "octree/cells_loop.h"
