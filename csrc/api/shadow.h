/* SPDX-License-Identifier: GPL-3.0-or-later */
/* The passes of smoke's shadows on solids. */
#ifndef FUM_API_SHADOW_H
#define FUM_API_SHADOW_H

#include "api/combine.h"

/* Fills in r->shadow, and r->light_shadows of the lights that are asked for. */
int32_t fum_shadow_find(fum_rendering *r);

#endif
