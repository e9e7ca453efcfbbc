/* SPDX-License-Identifier: GPL-3.0-or-later */
/* A particle's map as the camera sees it: where rays meet it, and at which levels it is read. */
#ifndef FUM_BILLBOARD_MAP_LOOK_H
#define FUM_BILLBOARD_MAP_LOOK_H

#include "base/vector.h"
#include "scene/scene.h"
#include "scene/view.h"

/* OpenGL takes it as it is. A ray through (u, v) of the window meets the map at 0.5 + (across[0] u + across[1] v +
 * across[2]) / length of (u, v, -1), `up` alike, both 0..1 within the map; in an orthographic view the length counts
 * as 1. */
typedef struct fum_map_look {
  float across[3];
  float blend; /* share of the next level beside this one */
  float up[3];
  int32_t begin; /* texel at which the level begins... */
  int32_t width, height;
  int32_t is_colored; /* 0: of the map's channels its opacity alone counts */
} fum_map_look;

/* `center` in camera space; `width` is the sigma across the view with which the particle is drawn, `sigma` its own. */
void fum_map_look_find(const fum_particles *set, int64_t index_in_set, const fum_view *view, const double center[3],
                       double sigma, double width, fum_map_look *out_look);

/* What `across` or `up` says of a ray of length 1, or in an orthographic view of any. */
static inline float fum_map_across(const float axis[3], float u, float v) {
  return axis[0] * u + axis[1] * v + axis[2];
}

/* Factors on red, green, blue and on the optical depth. */
typedef float fum_map_texel __attribute__((vector_size(16)));

static inline fum_map_texel fum_map_bilinear(const float *texels, int32_t width, int32_t height, float x, float y) {
  const float column = fum_min(fum_max(x * (float)width - 0.5F, 0.0F), (float)(width - 1));
  const float row = fum_min(fum_max(y * (float)height - 0.5F, 0.0F), (float)(height - 1));
  const int32_t left = (int32_t)column, below = (int32_t)row;
  const int64_t right = left + 1 < width ? 4 : 0, above = below + 1 < height ? 4 * (int64_t)width : 0;
  const float *at = texels + 4 * ((int64_t)below * width + left);
  const float a = column - (float)left, b = row - (float)below;
  fum_map_texel corners[4];
  for (int k = 0; k < 4; k++)
    __builtin_memcpy(&corners[k], at + (k % 2 == 0 ? 0 : right) + (k / 2 == 0 ? 0 : above), sizeof corners[k]);
  const fum_map_texel lower = corners[0] + (corners[1] - corners[0]) * a;
  const fum_map_texel upper = corners[2] + (corners[3] - corners[2]) * a;
  return lower + (upper - lower) * b;
}

/* The map at a place, 0..1 within it. */
static inline fum_map_texel fum_map_read(const fum_map *map, const fum_map_look *look, float x, float y) {
  const float *level = map->texels + 4 * (int64_t)look->begin;
  fum_map_texel texel = fum_map_bilinear(level, look->width, look->height, x, y);
  if (look->blend > 0.0F) {
    const float *next = level + 4 * (int64_t)look->width * look->height;
    const int32_t width = fum_map_half(look->width), height = fum_map_half(look->height);
    texel += (fum_map_bilinear(next, width, height, x, y) - texel) * look->blend;
  }
  if (look->is_colored == 0) texel = (fum_map_texel){texel[3], texel[3], texel[3], texel[3]};
  return texel;
}

#endif
