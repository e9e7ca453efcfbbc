/* SPDX-License-Identifier: GPL-3.0-or-later */
/* The samples of the lattice that are marked, in groups of neighbours on a few faces: what a solver lights together. */
#ifndef FUM_LIGHTING_LATTICE_GROUPS_H
#define FUM_LIGHTING_LATTICE_GROUPS_H

#include "lighting/lattice_marks.h"

/* Lists them in the lattice. */
int32_t fum_lattice_group(fum_context *context, const fum_marks *marks, fum_lattice *lattice);

#endif
