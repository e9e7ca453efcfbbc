/* SPDX-License-Identifier: GPL-3.0-or-later */
#define FUM_LANES 4
#define FUM_TRUTH_WALK fum_truth_walk_plain
#include "lighting/truth_loop.h"
