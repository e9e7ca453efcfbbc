/* SPDX-License-Identifier: GPL-3.0-or-later */
#define FUM_LANES 4
#define FUM_BLUR_SUM fum_blur_sum_plain
#include "billboard/blur_rays_loop.h"
