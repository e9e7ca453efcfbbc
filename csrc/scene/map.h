/* SPDX-License-Identifier: GPL-3.0-or-later */
/* The map on a set's billboards: an image and its reductions by halves, in the numbers that drawing multiplies with.
 *
 * A map lies on the square of two sigmas to each side of the centre; outside, its border goes on. It shapes a particle
 * and doesn't change how much of it there is: on every level the mean factor on the optical depth, weighted with the
 * particle's Gaussian, is 1, and the mean of each colour what it is on the first. */
#ifndef FUM_SCENE_MAP_H
#define FUM_SCENE_MAP_H

#include "base/context.h"

typedef struct fum_map {
  int32_t user_count;                 /* sets that have it */
  int32_t width, height, level_count; /* of the first level; each level is half as wide and high as the one before */
  bool is_colored;                    /* anything but white */
  float edge;          /* largest factor on the optical depth beyond two sigmas: the border's; at least 1 */
  float contrast;      /* mean factor on the optical depth where the smoke is: weighted with itself; at least 1 */
  int64_t texel_count; /* of all levels */
  float *texels; /* [texel_count][4] level after level, first row at the bottom: factors on the red, green and blue
                    that is scattered and emitted, and on the optical depth. The last level is one texel */
} fum_map;

/* `pixels` [height][width][4] straight RGBA, 0..1. `name` for messages. Has one user; given back by fum_map_drop. */
int32_t fum_map_create(fum_context *context, const char *name, int32_t width, int32_t height, const float *pixels,
                       fum_map **out_map);
bool fum_map_is_like(const fum_map *a, const fum_map *b);

/* Frees the map with its last user. `*map` may be NULL, and is afterwards. */
void fum_map_drop(fum_context *context, fum_map **map);

/* Half of a side of a level. */
static inline int32_t fum_map_half(int32_t side) {
  return side > 1 ? side / 2 : 1;
}

#endif
