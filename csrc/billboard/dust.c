/* SPDX-License-Identifier: GPL-3.0-or-later */
#include "billboard/dust.h"

#include <math.h>

/* Area that a Gaussian of optical depth tau covers, the integral of 1 - exp(-tau(r)), over 2 pi sigma^2: the entire
 * exponential integral Ein(tau). Above 1: Abramowitz and Stegun, Handbook of Mathematical Functions, 5.1.56. */
static double coverage(double tau) {
  const double euler_gamma = 0.57721566490153286;
  if (tau < 1.0) {
    double term = tau, sum = tau;
    for (int n = 2; n < 16; n++) {
      term *= -tau / n;
      sum += term / n;
    }
    return sum;
  }
  const double tail = exp(-tau) / tau * ((tau + 2.334733) * tau + 0.250621) / ((tau + 3.330657) * tau + 1.681534);
  return log(tau) + euler_gamma + tail;
}

/* The optical depth whose coverage is `area`, by Newton's method. */
static double depth_of_coverage(double area) {
  if (area < 0.01) return area * (1.0 + area * (0.25 + 0.0694 * area));
  double tau = fmax(area, exp(area - 0.57721566490153286));
  for (int i = 0; i < 5; i++)
    tau += (area - coverage(tau)) * tau / (1.0 - exp(-tau));
  return tau;
}

double fum_dust_widened(double optical_depth, double ratio) {
  return depth_of_coverage(coverage(optical_depth) * ratio * ratio);
}

/* With the light behind the camera, integrating exp(-2 tau) through the particle gives Ein(2 tau) / 2; from behind the
 * particle, exp(-tau) everywhere on a line gives 1 - exp(-tau). Between them a fit to quadrature over the particle,
 * within 0.013 up to an optical depth of 30. */
double fum_dust_shade(double optical_depth, double cosine) {
  if (!(optical_depth > 1e-4)) return 1.0;
  const double area = coverage(optical_depth);
  const double lit_from_front = 0.5 * coverage(2.0 * optical_depth) / area,
               lit_from_behind = -expm1(-optical_depth) / area;
  return lit_from_behind + (lit_from_front - lit_from_behind) * (0.4 + cosine * (0.5 + 0.1 * cosine));
}
