/* SPDX-License-Identifier: GPL-3.0-or-later */
#define FUM_LANES 16
#define FUM_PAIRS_NAME fum_pairs_avx512
#include "lighting/pairs_loop.h"
