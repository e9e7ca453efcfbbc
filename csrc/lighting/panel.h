/* SPDX-License-Identifier: GPL-3.0-or-later */
/* Area lights as a whole: what one sends to a point, close by too, where a few samples don't stand for it. */
#ifndef FUM_LIGHTING_PANEL_H
#define FUM_LIGHTING_PANEL_H

#include "lighting/emitter.h"

/* Irradiance, as a factor on the light's colour, on something that faces each part of an area light: the sum of
 * fum_emitter_irradiance over ever more samples. */
float fum_panel_irradiance(const fum_lamp *lamp, fum_vec3 point);

#endif
