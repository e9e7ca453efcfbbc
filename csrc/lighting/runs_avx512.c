/* SPDX-License-Identifier: GPL-3.0-or-later */
#define FUM_LANES 16
#define FUM_RUN_LOOPS_NAME fum_run_loops_avx512
#include "lighting/runs_loop.h"
