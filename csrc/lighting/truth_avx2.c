/* SPDX-License-Identifier: GPL-3.0-or-later */
#define FUM_LANES 8
#define FUM_TRUTH_WALK fum_truth_walk_avx2
#include "lighting/truth_loop.h"
