/* SPDX-License-Identifier: GPL-3.0-or-later */
#include "billboard/stretch.h"

/* Covariance beside that of a round Gaussian: camera space. */
static void find_covariance(const fum_octree *octree, int64_t i, const fum_view *view, double out[3][3]) {
  const double *m = view->camera_from_local;
  double held[FUM_STRETCHES], turned[3][3];
  for (int k = 0; k < FUM_STRETCHES; k++)
    held[k] = (double)octree->stretches[k * (octree->count + FUM_OCTREE_PAD) + i];
  const double local[3][3] = {
      {held[0], held[2], held[3]}, {held[2], held[1], held[4]}, {held[3], held[4], -(held[0] + held[1])}};
  for (int row = 0; row < 3; row++) {
    for (int k = 0; k < 3; k++)
      turned[row][k] = m[4 * row] * local[0][k] + m[4 * row + 1] * local[1][k] + m[4 * row + 2] * local[2][k];
  }
  for (int row = 0; row < 3; row++) {
    for (int k = 0; k < 3; k++)
      out[row][k] = m[4 * k] * turned[row][0] + m[4 * k + 1] * turned[row][1] + m[4 * k + 2] * turned[row][2];
  }
}

/* How depth goes with the place across doesn't matter: it moves smoke by less than a slab. */
fum_stretched fum_stretch_find(const fum_octree *octree, int64_t i, const fum_view *view, const float center[3]) {
  const bool is_perspective = view->type == FUM_CAMERA_PERSPECTIVE;
  const double u = is_perspective ? (double)center[0] / -(double)center[2] : 0.0;
  const double v = is_perspective ? (double)center[1] / -(double)center[2] : 0.0;
  const double sigma = 1.0 / (double)octree->inverse_sigmas[i], round = sigma * sigma, squared = 1.0 + u * u + v * v;
  double c[3][3];
  find_covariance(octree, i, view, c);
  const double along =
      u * u * c[0][0] + v * v * c[1][1] + c[2][2] + 2.0 * (u * v * c[0][1] - u * c[0][2] - v * c[1][2]);
  const double width = round + along / squared;
  /* Moved along the ray into the plane across the view: a round one, and what is beside it. */
  const double beside[3] = {c[0][0] + u * (2.0 * c[0][2] + u * c[2][2]),
                            c[0][1] + v * c[0][2] + u * (c[1][2] + v * c[2][2]),
                            c[1][1] + v * (2.0 * c[1][2] + v * c[2][2])};
  const double xx = round * (1.0 + u * u) + beside[0], xy = round * u * v + beside[1];
  const double yy = round * (1.0 + v * v) + beside[2];
  const double per_area = 1.0 / (xx * yy - xy * xy), per_round = 1.0 / (width * squared), half_log2_e = 0.72134752;
  return (fum_stretched){
      .width = sqrt(width),
      .of = {.xx = (float)(half_log2_e * ((1.0 + v * v) * per_round - yy * per_area)),
             .xy = (float)(half_log2_e * 2.0 * (xy * per_area - u * v * per_round)),
             .yy = (float)(half_log2_e * ((1.0 + u * u) * per_round - xx * per_area))},
      .peak = round * sqrt(squared * per_area),
      .across = {sqrt(xx / (1.0 + u * u)), sqrt(yy / (1.0 + v * v))},
      .lean = fabs(beside[1]) / sqrt(xx * yy),
  };
}
