/* SPDX-License-Identifier: GPL-3.0-or-later */
#include "billboard/map_look.h"

#include "base/hash.h"

/* Levels coarser than where a texel is as wide as a pixel: between levels bilinear interpolation would let through what
 * is finer than pixels. */
static const double BIAS = 0.5;

/* The camera's axes across the view, turned by the shortest way until they face the direction to the centre (Duff and
 * others 2017, Building an orthonormal basis, revisited). */
static void find_axes(const fum_view *view, const double center[3], double range, double out_axes[2][3]) {
  double to[3] = {0.0, 0.0, -1.0};
  for (int axis = 0; axis < 3 && view->type == FUM_CAMERA_PERSPECTIVE && range > 0.0; axis++)
    to[axis] = center[axis] / range;
  const double per = 1.0 / fum_most(1.0 - to[2], 1e-9);
  for (int k = 0; k < 2; k++) {
    for (int axis = 0; axis < 2; axis++)
      out_axes[k][axis] = (k == axis ? 1.0 : 0.0) - to[k] * to[axis] * per;
    out_axes[k][2] = to[k];
  }
}

static void find_level(const fum_map *map, double wanted, fum_map_look *out) {
  const double level = fum_least(fum_most(wanted, 0.0), (double)(map->level_count - 1));
  const int32_t whole = (int32_t)level;
  out->begin = 0;
  out->width = map->width;
  out->height = map->height;
  for (int32_t k = 0; k < whole; k++) {
    out->begin += out->width * out->height;
    out->width = fum_map_half(out->width);
    out->height = fum_map_half(out->height);
  }
  out->blend = (float)(level - whole);
}

/* Of a particle that is drawn wider than it is, nothing finer is seen than what it is widened by; of one widened to
 * more than root 2 of its sigma nothing but the mean. */
static double wanted_level(const fum_map *map, double pixel, double sigma, double width) {
  const double texels = map->width > map->height ? map->width : map->height;
  const double softness = width > sigma ? sqrt(1.0 - sigma * sigma / (width * width)) : 0.0;
  return BIAS + log2(texels * fum_most(pixel / (4.0 * width), softness));
}

void fum_map_look_find(const fum_particles *set, int64_t index_in_set, const fum_view *view, const double center[3],
                       double sigma, double width, fum_map_look *out_look) {
  const bool is_perspective = view->type == FUM_CAMERA_PERSPECTIVE;
  const double range = sqrt(center[0] * center[0] + center[1] * center[1] + center[2] * center[2]);
  const double pixel = fum_view_pixel(view);
  const double depth = is_perspective ? fum_most(-center[2], 0.0) : 1.0;
  const double angle = 2.0 * FUM_PI * fum_hash_unit(set->ids != NULL ? set->ids[index_in_set] : (uint64_t)index_in_set);
  double axes[2][3];
  find_axes(view, center, range, axes);
  *out_look = (fum_map_look){.is_colored = 1};
  for (int k = 0; k < 3; k++) {
    /* The ray (u, v, -1) of unit length passes the centre as far off as range times its component across. */
    const double scale = (is_perspective ? range : 1.0) / (4.0 * width) * (k == 2 ? -1.0 : 1.0);
    out_look->across[k] = (float)(scale * (cos(angle) * axes[0][k] + sin(angle) * axes[1][k]));
    out_look->up[k] = (float)(scale * (cos(angle) * axes[1][k] - sin(angle) * axes[0][k]));
  }
  if (!is_perspective) {
    out_look->across[2] = (float)(-(double)out_look->across[0] * center[0] - (double)out_look->across[1] * center[1]);
    out_look->up[2] = (float)(-(double)out_look->up[0] * center[0] - (double)out_look->up[1] * center[1]);
  }
  find_level(set->map, wanted_level(set->map, pixel * depth, sigma, width), out_look);
}
