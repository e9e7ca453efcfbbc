/* SPDX-License-Identifier: GPL-3.0-or-later */
#include "tools/cloud.h"

#include "base/hash.h"

#include <math.h>

static const double PI = 3.14159265358979323846, HALF_BOX = 1.4;

/* Radius of the lumpy ball in the direction of p. */
static double surface(const double p[3]) {
  const double length = fmax(sqrt(p[0] * p[0] + p[1] * p[1] + p[2] * p[2]), 1e-9);
  const double x = p[0] / length, y = p[1] / length, z = p[2] / length;
  return 1.0 + 0.12 * (sin(5.0 * x + 0.5) + sin(5.0 * y + 1.7) + sin(5.0 * z + 2.9));
}

/* Random point of the lumpy ball: the next of the box's that lies in it. Counts the tries. */
static void draw_point(uint64_t *tries, double out[3]) {
  for (;;) {
    for (int axis = 0; axis < 3; axis++) {
      out[axis] = HALF_BOX * (2.0 * fum_hash_unit(3 * *tries + (uint64_t)axis) - 1.0);
    }
    ++*tries;
    if (sqrt(out[0] * out[0] + out[1] * out[1] + out[2] * out[2]) < surface(out)) return;
  }
}

void cloud_fill_ball(cloud *c, double ratio) {
  uint64_t tries = 0;
  double cubes = 0.0, squares = 0.0;
  for (int64_t i = 0; i < c->count; i++) {
    double p[3];
    draw_point(&tries, p);
    for (int axis = 0; axis < 3; axis++)
      c->positions[3 * i + axis] = (float)p[axis];
    const double size = pow(ratio, -fum_hash_unit(~(uint64_t)i)); /* in units of the largest */
    c->radii[i] = (float)(2.0 * size);
    cubes += size * size * size;
    squares += size * size;
  }
  const double tries_made = (double)(tries > 0 ? tries : 1);
  const double volume = pow(2.0 * HALF_BOX, 3.0) * (double)c->count / tries_made;
  const double largest = cubes > 0.0 ? cbrt(c->overlap * volume / cubes) : 1.0;
  /* Of one particle, so that the mean extinction over 2 m is c->depth: a Gaussian of the optical depth t through its
   * centre holds t 2 pi sigma^2 of extinction times volume. */
  const double depth = squares > 0.0 ? c->depth * volume / (4.0 * PI * squares * largest * largest) : 0.0;
  for (int64_t i = 0; i < c->count; i++) {
    const double sigma = 0.5 * (double)c->radii[i] * largest;
    c->radii[i] = (float)(2.0 * sigma);
    c->densities[i] = (float)(depth / (sigma * sqrt(2.0 * PI)));
  }
  c->radius = 1.35;
}

void cloud_fill_puffs(cloud *c) {
  static const float centres[6][3] = {{0.0F, 0.0F, 0.0F},    {0.5F, -0.3F, 0.2F},   {-0.45F, 0.2F, 0.3F},
                                      {0.1F, 0.45F, -0.35F}, {-0.2F, -0.4F, -0.3F}, {0.25F, 0.1F, 0.5F}};
  static const double sigmas[6] = {0.3, 0.2, 0.25, 0.22, 0.18, 0.15};
  for (int64_t i = 0; i < c->count; i++) {
    for (int axis = 0; axis < 3; axis++)
      c->positions[3 * i + axis] = centres[i][axis];
    c->radii[i] = (float)(2.0 * sigmas[i]);
    c->densities[i] = (float)(c->depth / (sigmas[i] * sqrt(2.0 * PI)));
  }
  c->radius = 1.35;
}
