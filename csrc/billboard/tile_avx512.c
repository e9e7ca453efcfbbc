/* SPDX-License-Identifier: GPL-3.0-or-later */
#define FUM_LANES 16
#define FUM_TILE_NAME fum_tile_avx512
#include "billboard/tile_loop.h"
