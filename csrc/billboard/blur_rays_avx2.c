/* SPDX-License-Identifier: GPL-3.0-or-later */
#define FUM_LANES 8
#define FUM_BLUR_SUM fum_blur_sum_avx2
#include "billboard/blur_rays_loop.h"
