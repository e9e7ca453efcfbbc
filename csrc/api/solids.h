/* SPDX-License-Identifier: GPL-3.0-or-later */
/* Solids in the picture, behind the smoke: shaded ones, and what holdouts hide. */
#ifndef FUM_API_SOLIDS_H
#define FUM_API_SOLIDS_H

#include "api/combine.h"

/* Makes room for r->through, if what is asked for needs it. To be called before Combined is made. */
int32_t fum_solids_begin(fum_rendering *r);

/* Adds solids to r->combined and its parts, and fills in r->holdout. To be called after Combined is made of the smoke.
 */
int32_t fum_solids_compose(fum_rendering *r);

#endif
