/* SPDX-License-Identifier: GPL-3.0-or-later */
#include "billboard/footprints.h"

#include "lighting/slabs.h"

/* What isn't cut off a Gaussian that ends so many sigmas from its middle. */
static double kept_within(double sigmas) {
  return 1.0 - exp(-0.5 * sigmas * sigmas);
}

fum_footprints fum_footprints_find(double sigmas, double thin_sigmas) {
  return (fum_footprints){.sigmas = sigmas,
                          .thin_sigmas = thin_sigmas,
                          .cut = exp(-0.5 * sigmas * sigmas),
                          .thin = exp(0.5 * (thin_sigmas * thin_sigmas - sigmas * sigmas)),
                          .per_kept = 1.0 / kept_within(thin_sigmas)};
}

double fum_footprints_end(const fum_footprints *f, double *optical_depth) {
  if (*optical_depth <= f->thin) {
    *optical_depth *= f->per_kept;
    return f->thin_sigmas;
  }
  if (*optical_depth >= 1.0) return fum_footprint(f->sigmas, *optical_depth);
  const double end = sqrt(f->sigmas * f->sigmas + 2.0 * log(*optical_depth));
  *optical_depth /= kept_within(end);
  return end;
}
