/* SPDX-License-Identifier: GPL-3.0-or-later */
#define FUM_LANES 4
#define FUM_SIGHT_NAME fum_sight_plain
#include "billboard/splat_sight_loop.h"
