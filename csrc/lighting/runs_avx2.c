/* SPDX-License-Identifier: GPL-3.0-or-later */
#define FUM_LANES 8
#define FUM_RUN_LOOPS_NAME fum_run_loops_avx2
#include "lighting/runs_loop.h"
