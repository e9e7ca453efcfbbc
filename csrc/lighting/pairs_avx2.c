/* SPDX-License-Identifier: GPL-3.0-or-later */
#define FUM_LANES 8
#define FUM_PAIRS_NAME fum_pairs_avx2
#include "lighting/pairs_loop.h"
