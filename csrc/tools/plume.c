/* SPDX-License-Identifier: GPL-3.0-or-later */
#include "tools/cloud.h"

#include "base/hash.h"

#include <math.h>

static const double HEIGHT = 3.0, RADIUS_LOW = 0.15, RADIUS_HIGH = 0.9;

static double radius_at(double z) {
  return RADIUS_LOW + (RADIUS_HIGH - RADIUS_LOW) * z / HEIGHT;
}

/* Height at which a share of the plume's volume lies below: the radius grows linearly, so the volume with its cube. */
static double height_of(double share) {
  const double low = pow(RADIUS_LOW, 3.0), high = pow(RADIUS_HIGH, 3.0);
  return (cbrt(low + share * (high - low)) - RADIUS_LOW) * HEIGHT / (RADIUS_HIGH - RADIUS_LOW);
}

/* Folds the plume into billows: each octave shifts along one axis by waves of the others, which keeps volumes. */
static void billow(double p[3]) {
  double wavelength = 1.3, amplitude = 0.16;
  for (int octave = 0; octave < 5; octave++) {
    const double k = 2.0 * 3.14159265358979 / wavelength, turn = 1.7 * octave;
    p[0] += amplitude * sin(k * p[2] + turn) * cos(0.8 * k * p[1] + 2.0 * turn);
    p[1] += amplitude * sin(k * p[0] + 0.5 + turn) * cos(0.7 * k * p[2] + turn);
    p[2] += 0.7 * amplitude * sin(k * p[1] + 1.1 + turn) * cos(0.9 * k * p[0] + 3.0 * turn);
    wavelength *= 0.5;
    amplitude *= 0.55;
  }
}

void cloud_fill_plume(cloud *c) {
  const double pi = 3.14159265358979323846, count = (double)(c->count > 0 ? c->count : 1);
  const double volume = pi * HEIGHT / 3.0 * (pow(RADIUS_HIGH, 3.0) - pow(RADIUS_LOW, 3.0)) / (RADIUS_HIGH - RADIUS_LOW);
  const double sigma = cbrt(c->overlap * volume / count);
  /* Mean extinction of overlapping Gaussians: n k (2 pi)^(3/2) sigma^3. */
  const double density = c->depth / (2.0 * radius_at(0.5 * HEIGHT)) / (c->overlap * pow(2.0 * pi, 1.5));
  for (int64_t i = 0; i < c->count; i++) {
    const uint64_t seed = (uint64_t)i * 3;
    const double z = height_of(fum_hash_unit(seed)), angle = 2.0 * pi * fum_hash_unit(seed + 1);
    const double r = radius_at(z) * sqrt(fum_hash_unit(seed + 2));
    double p[3] = {r * cos(angle), r * sin(angle), z};
    billow(p);
    for (int axis = 0; axis < 3; axis++)
      c->positions[3 * i + axis] = (float)p[axis];
    c->radii[i] = (float)(2.0 * sigma);
    c->densities[i] = (float)density;
  }
  cloud_frame(c);
}
