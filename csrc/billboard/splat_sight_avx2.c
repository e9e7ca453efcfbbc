/* SPDX-License-Identifier: GPL-3.0-or-later */
#define FUM_LANES 8
#define FUM_SIGHT_NAME fum_sight_avx2
#include "billboard/splat_sight_loop.h"
