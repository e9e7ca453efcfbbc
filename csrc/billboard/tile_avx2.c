/* SPDX-License-Identifier: GPL-3.0-or-later */
#define FUM_LANES 8
#define FUM_TILE_NAME fum_tile_avx2
#include "billboard/tile_loop.h"
