/* SPDX-License-Identifier: GPL-3.0-or-later */
/* Where one value of light for each particle, at its centre, is enough: thin smoke, far lights. */
#ifndef FUM_LIGHTING_CENTRES_H
#define FUM_LIGHTING_CENTRES_H

#include "lighting/lamps.h"
#include "lighting/slabs.h"
#include "solid/solid.h"

/* Would light at the particles' centres keep the picture within the tolerance? Looks at what changes inside of a
 * particle: transmittance by its thickness, a lamp's strength and the phase function by its size against distances.
 * Says no where it can't tell: solids, cones and panels have edges. */
bool fum_centres_suffice(const fum_scene *scene, const fum_octree *octree, const fum_view *view, const fum_slabs *slabs,
                         const fum_lamps *lamps, const fum_solids *solids, float tolerance);

#endif
