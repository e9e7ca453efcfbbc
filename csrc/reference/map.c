/* SPDX-License-Identifier: GPL-3.0-or-later */
#include "reference/map.h"

#include "base/vector.h"

#include <string.h>

static double dot(const double a[3], const double b[3]) {
  return a[0] * b[0] + a[1] * b[1] + a[2] * b[2];
}

/* The two texels of a row around a place, 0..1 across it, and the share of the second. */
static double find_neighbours(int32_t count, double place, int32_t out[2]) {
  const double at = fmin(fmax(place * count - 0.5, 0.0), (double)(count - 1));
  out[0] = (int32_t)at;
  out[1] = out[0] + 1 < count ? out[0] + 1 : out[0];
  return at - out[0];
}

/* What the Gaussian weighs each texel of a row with: a sum over points much closer than texels. */
static void find_weights(int32_t count, double *weights) {
  const double step = 4.0 / count / 256.0, reach = 8.0; /* sigmas */
  double total = 0.0;
  memset(weights, 0, (size_t)count * sizeof *weights);
  for (double x = -reach; x < reach; x += step) {
    const double gauss = exp(-0.5 * x * x);
    int32_t texels[2];
    const double share = find_neighbours(count, 0.5 + x / 4.0, texels);
    weights[texels[0]] += gauss * (1.0 - share);
    weights[texels[1]] += gauss * share;
    total += gauss;
  }
  for (int32_t i = 0; i < count; i++)
    weights[i] /= total;
}

int32_t fum_reference_map_make(fum_context *context, const fum_map *map, fum_reference_map *out_map) {
  double *weights = NULL, mean = 0.0;
  const int32_t status = fum_alloc(context, (int64_t)map->width + map->height, sizeof *weights, "reference", &weights);
  if (status != FUM_OK) return status;
  find_weights(map->width, weights);
  find_weights(map->height, weights + map->width);
  for (int32_t y = 0; y < map->height; y++) {
    for (int32_t x = 0; x < map->width; x++)
      mean += weights[x] * weights[map->width + y] * (double)map->texels[4 * ((int64_t)y * map->width + x) + 3];
  }
  *out_map = (fum_reference_map){map, mean};
  fum_free(context, &weights);
  return FUM_OK;
}

/* Where the ray passes the centre, m to the right and up as the camera sees it. */
static void find_offset(const fum_view *view, const double centre[3], const double start[3], const double direction[3],
                        double distance, double out[2]) {
  const double *m = view->local_from_camera;
  const double camera[3] = {m[3], m[7], m[11]}, forward[3] = {-m[2], -m[6], -m[10]};
  double to[3], between[3], sides[2];
  for (int axis = 0; axis < 3; axis++)
    to[axis] = centre[axis] - camera[axis];
  const double range = sqrt(dot(to, to));
  for (int axis = 0; axis < 3; axis++) {
    to[axis] = view->type == FUM_CAMERA_PERSPECTIVE ? to[axis] / range : forward[axis];
    between[axis] = forward[axis] + to[axis];
  }
  for (int k = 0; k < 2; k++) {
    const double side[3] = {m[k], m[4 + k], m[8 + k]};
    double turned[3]; /* with the camera, until this looks at the centre */
    for (int axis = 0; axis < 3; axis++)
      turned[axis] = side[axis] - dot(side, to) / (1.0 + dot(forward, to)) * between[axis];
    sides[k] = dot(view->type == FUM_CAMERA_PERSPECTIVE ? direction : start, turned);
    if (view->type != FUM_CAMERA_PERSPECTIVE) sides[k] -= dot(centre, turned);
  }
  const double length = hypot(sides[0], sides[1]);
  for (int k = 0; k < 2; k++)
    out[k] = length > 0.0 ? distance * sides[k] / length : 0.0;
}

void fum_reference_map_read(const fum_reference_map *map, const fum_view *view, const double centre[3], double sigma,
                            double turn, const double start[3], const double direction[3], double distance,
                            double out_factors[4]) {
  double offset[2];
  int32_t columns[2], rows[2];
  find_offset(view, centre, start, direction, distance, offset);
  const double across = cos(turn) * offset[0] + sin(turn) * offset[1];
  const double up = cos(turn) * offset[1] - sin(turn) * offset[0];
  const double x = find_neighbours(map->map->width, 0.5 + across / (4.0 * sigma), columns);
  const double y = find_neighbours(map->map->height, 0.5 + up / (4.0 * sigma), rows);
  for (int c = 0; c < 4; c++) {
    double sum = 0.0;
    for (int k = 0; k < 4; k++) {
      const int64_t texel = (int64_t)rows[k / 2] * map->map->width + columns[k % 2];
      sum += (k % 2 == 0 ? 1.0 - x : x) * (k / 2 == 0 ? 1.0 - y : y) * (double)map->map->texels[4 * texel + c];
    }
    out_factors[c] = sum / map->mean;
  }
}
