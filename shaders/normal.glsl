// SPDX-License-Identifier: GPL-3.0-or-later
// The normal distribution, and opacity.

// Upper tail of the normal distribution, 1 - Phi(x), for x >= 0. The complementary error function is the Chebyshev fit
// of Press and others, Numerical Recipes, section 6.2: relative error below 1.2e-7 everywhere.
float tail(float x) {
  float z = 0.70710678 * x;
  float t = 1.0 / (1.0 + 0.5 * z);
  float fit = t * (1.00002368 + t * (0.37409196 + t * (0.09678418 + t * (-0.18628806 + t * (0.27886807 +
              t * (-1.13520398 + t * (1.48851587 + t * (-0.82215223 + t * 0.17087277))))))));
  return 0.5 * t * exp(-z * z - 1.26551223 + fit);
}

// Phi(end) - Phi(start), on the side of the distribution where the difference doesn't cancel.
float share_between(float start, float end) {
  if (start >= end) return 0.0;
  if (start >= 0.0) return tail(start) - tail(end);
  if (end <= 0.0) return tail(-end) - tail(-start);
  return 1.0 - tail(-start) - tail(end);
}

// 1 - exp(-tau), also for a tau that would vanish beside 1.
float opacity(float tau) {
  if (tau < 0.1) return tau * (1.0 - tau / 2.0 * (1.0 - tau / 3.0 * (1.0 - tau / 4.0 * (1.0 - tau / 5.0))));
  return 1.0 - exp(-tau);
}
