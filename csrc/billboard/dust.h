/* SPDX-License-Identifier: GPL-3.0-or-later */
/* Particles thinner than a pixel: drawn wider, and shaded by themselves as a whole, for light is sampled a pixel apart
 * at the closest. */
#ifndef FUM_BILLBOARD_DUST_H
#define FUM_BILLBOARD_DUST_H

/* The smallest sigma drawn, in pixels. Pixels sample the Gaussian at their centres; by Poisson's summation formula the
 * sum of the samples differs from the integral by up to 4 exp(-2 pi^2 s^2): 0.3 % at 0.6. */
static const double FUM_MIN_SIGMA_PIXELS = 0.6;

/* The optical depth with which a Gaussian that is 1 / ratio times wider covers the same area; 0 < ratio <= 1. */
double fum_dust_widened(double optical_depth, double ratio);

/* Light that a particle scatters to the camera past itself, over what it would if light came to it unshaded; `cosine`
 * is that of the angle between the ways to the light and to the camera. */
double fum_dust_shade(double optical_depth, double cosine);

#endif
