/* SPDX-License-Identifier: GPL-3.0-or-later */
#define FUM_LANES 16
#define FUM_TRUTH_WALK fum_truth_walk_avx512
#include "lighting/truth_loop.h"
