/* SPDX-License-Identifier: GPL-3.0-or-later */
#define FUM_LANES 4
#define FUM_TILE_NAME fum_tile_plain
#include "billboard/tile_loop.h"
