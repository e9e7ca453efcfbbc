/* SPDX-License-Identifier: GPL-3.0-or-later */
#define FUM_LANES 8
#define FUM_SWEEP_NAME fum_sweep_avx2
#include "lighting/sweep_loop.h"
