/* SPDX-License-Identifier: GPL-3.0-or-later */
#include "tools/brute.h"

#include <math.h>
#include <stdlib.h>

double brute_transmittance(const cloud *c, const double from[3], const double to[3]) {
  double u[3], length = 0.0, depth = 0.0;
  for (int axis = 0; axis < 3; axis++) {
    u[axis] = to[axis] - from[axis];
    length += u[axis] * u[axis];
  }
  length = sqrt(length);
  for (int axis = 0; axis < 3; axis++)
    u[axis] /= length;
#pragma omp parallel for reduction(+ : depth)
  for (int64_t i = 0; i < c->count; i++) {
    double t = 0.0, squared = 0.0, d[3];
    for (int axis = 0; axis < 3; axis++) {
      d[axis] = (double)c->positions[3 * i + axis] - from[axis];
      t += d[axis] * u[axis];
    }
    for (int axis = 0; axis < 3; axis++) {
      const double p = d[axis] - t * u[axis];
      squared += p * p;
    }
    const double sigma = 0.5 * (double)c->radii[i], root = sigma * sqrt(2.0);
    const double interval = 0.5 * (erf((length - t) / root) - erf(-t / root));
    depth +=
        (double)c->densities[i] * sigma * 2.50662827463100050242 * exp(-0.5 * squared / (sigma * sigma)) * interval;
  }
  return exp(-depth);
}

static int compare(const void *a, const void *b) {
  const double x = *(const double *)a, y = *(const double *)b;
  return (x > y) - (x < y);
}

error_summary summarize(int64_t count, double *errors) {
  error_summary summary = {0};
  if (count == 0) return summary;
  double squares = 0.0;
  for (int64_t i = 0; i < count; i++)
    squares += errors[i] * errors[i];
  qsort(errors, (size_t)count, sizeof *errors, compare);
  summary.rms = sqrt(squares / (double)count);
  summary.p95 = errors[(count - 1) * 95 / 100];
  summary.worst = errors[count - 1];
  return summary;
}
