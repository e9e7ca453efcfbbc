/* SPDX-License-Identifier: GPL-3.0-or-later */
#define FUM_LANES 4
#define FUM_SWEEP_NAME fum_sweep_plain
#include "lighting/sweep_loop.h"
