/* SPDX-License-Identifier: GPL-3.0-or-later */
/* What the shutter and the lens do to the particles of a rendering, for both devices. */
#ifndef FUM_API_SMEARED_H
#define FUM_API_SMEARED_H

#include "api/combine.h"
#include "billboard/bokeh.h"
#include "lighting/smears.h"

typedef struct fum_smeared {
  fum_smears smears;
  fum_bokeh bokeh; /* empty without an aperture */
} fum_smeared;

/* Root mean square of a particle's blur, in its sigmas, that is left out: it changes the peak by a tenth of the
 * tolerance. */
float fum_least_blur(const fum_settings *settings);

/* Finds nothing where nothing is blurred. Outputs start as zeros. */
int32_t fum_smeared_find(const fum_rendering *r, fum_smeared *out);
void fum_smeared_free(fum_context *context, fum_smeared *smeared);

#endif
