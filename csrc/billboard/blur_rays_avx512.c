/* SPDX-License-Identifier: GPL-3.0-or-later */
#define FUM_LANES 16
#define FUM_BLUR_SUM fum_blur_sum_avx512
#include "billboard/blur_rays_loop.h"
