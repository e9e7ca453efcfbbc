/* SPDX-License-Identifier: GPL-3.0-or-later */
#define FUM_LANES 16
#define FUM_SIGHT_NAME fum_sight_avx512
#include "billboard/splat_sight_loop.h"
