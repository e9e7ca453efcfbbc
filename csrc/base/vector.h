/* SPDX-License-Identifier: GPL-3.0-or-later */
/* Small vectors and 4 x 4 matrices. Row-major; matrices act on column vectors. */
#ifndef FUM_BASE_VECTOR_H
#define FUM_BASE_VECTOR_H

#include <math.h>
#include <stdbool.h>

#define FUM_PI 3.14159265358979323846
#define FUM_SQRT_2PI 2.50662827463100050242

typedef struct fum_vec3 {
  float x, y, z;
} fum_vec3;

static inline fum_vec3 fum_sub(fum_vec3 a, fum_vec3 b) {
  return (fum_vec3){a.x - b.x, a.y - b.y, a.z - b.z};
}
static inline fum_vec3 fum_scaled(fum_vec3 a, float s) {
  return (fum_vec3){a.x * s, a.y * s, a.z * s};
}
static inline fum_vec3 fum_mad(fum_vec3 a, float s, fum_vec3 b) {
  return (fum_vec3){b.x + a.x * s, b.y + a.y * s, b.z + a.z * s};
}
/* The lesser and the greater of two; b where a isn't a number. fminf and fmaxf are calls of the C library, because of
 * what they do with b when that isn't one. */
static inline float fum_min(float a, float b) {
  return a < b ? a : b;
}
static inline float fum_max(float a, float b) {
  return a > b ? a : b;
}
static inline double fum_least(double a, double b) {
  return a < b ? a : b;
}
static inline double fum_most(double a, double b) {
  return a > b ? a : b;
}

static inline float fum_dot(fum_vec3 a, fum_vec3 b) {
  return a.x * b.x + a.y * b.y + a.z * b.z;
}
static inline float fum_length(fum_vec3 a) {
  return sqrtf(fum_dot(a, a));
}

static inline bool fum_all_finite(const double *values, int count) {
  for (int i = 0; i < count; i++) {
    if (!isfinite(values[i])) return false;
  }
  return true;
}

/* out = matrix * (point, 1) */
static inline void fum_transform_point(const double matrix[16], const double point[3], double out[3]) {
  for (int row = 0; row < 3; row++) {
    const double *m = matrix + 4 * row;
    out[row] = m[0] * point[0] + m[1] * point[1] + m[2] * point[2] + m[3];
  }
}

/* Column of the linear part, and its length. */
static inline double fum_matrix_column(const double matrix[16], int column, double out[3]) {
  for (int row = 0; row < 3; row++)
    out[row] = matrix[4 * row + column];
  return sqrt(out[0] * out[0] + out[1] * out[1] + out[2] * out[2]);
}

/* Column scaled to unit length. False if its length is zero. */
static inline bool fum_matrix_axis(const double matrix[16], int column, double out[3]) {
  const double length = fum_matrix_column(matrix, column, out);
  if (!(length > 0.0)) return false;
  for (int row = 0; row < 3; row++)
    out[row] /= length;
  return true;
}

#endif
