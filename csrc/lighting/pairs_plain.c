/* SPDX-License-Identifier: GPL-3.0-or-later */
#define FUM_LANES 4
#define FUM_PAIRS_NAME fum_pairs_plain
#include "lighting/pairs_loop.h"
