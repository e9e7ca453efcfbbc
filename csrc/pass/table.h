/* SPDX-License-Identifier: GPL-3.0-or-later */
/* The one table of passes. */
#ifndef FUM_PASS_TABLE_H
#define FUM_PASS_TABLE_H

#include "fumarole.h"

/* The pass with this number, or NULL. */
const fum_pass_info *fum_pass_find(int32_t pass);

#endif
