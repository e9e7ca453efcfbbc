/* SPDX-License-Identifier: GPL-3.0-or-later */
#include "scene/map.h"

#include "base/vector.h"

#include <stdlib.h>
#include <string.h>

enum { MAX_SIDE = 16384 };

static int32_t check_pixels(fum_context *context, const char *name, int32_t width, int32_t height,
                            const float *pixels) {
  if (width < 1 || height < 1 || width > MAX_SIDE || height > MAX_SIDE) {
    return fum_fail(context, FUM_ERROR_ARGUMENT, "%s: a map of %d x %d pixels; each must be within 1..%d", name,
                    (int)width, (int)height, (int)MAX_SIDE);
  }
  for (int64_t i = 0; i < 4 * (int64_t)width * height; i++) {
    if (pixels[i] >= 0.0F && pixels[i] <= 1.0F) continue;
    const int64_t pixel = i / 4;
    return fum_fail(context, FUM_ERROR_ARGUMENT, "%s: the map's pixel %lld, %lld holds %g, not within 0..1", name,
                    (long long)(pixel % width), (long long)(pixel / width), (double)pixels[i]);
  }
  return FUM_OK;
}

/* The integral of the normal distribution function. */
static double second_integral(double x) {
  return x * 0.5 * erfc(-x / sqrt(2.0)) + exp(-0.5 * x * x) / FUM_SQRT_2PI;
}

/* Weight that the Gaussian gives each texel of a row across the four sigmas, linear between texels and constant beyond
 * the first and the last. They add up to 1. */
static void find_weights(int32_t count, double *weights) {
  const double step = 4.0 / count;
  double last_slope = 0.0; /* of the second integral between the texel and the one before */
  for (int32_t i = 0; i < count; i++) {
    const double at = -2.0 + (i + 0.5) * step;
    const double slope = i + 1 < count ? (second_integral(at + step) - second_integral(at)) / step : 1.0;
    weights[i] = slope - last_slope;
    last_slope = slope;
  }
}

/* One level of the map. */
typedef struct level {
  int32_t width, height;
  float *texels;
} level;

/* Means of the four channels, weighted with the Gaussian, and of the last one's square. */
static void find_means(const level *l, const double *across, const double *up, double out_means[4],
                       double *out_squared) {
  for (int c = 0; c < 4; c++)
    out_means[c] = 0.0;
  *out_squared = 0.0;
  for (int32_t y = 0; y < l->height; y++) {
    for (int32_t x = 0; x < l->width; x++) {
      const float *texel = l->texels + 4 * ((int64_t)y * l->width + x);
      const double weight = across[x] * up[y];
      for (int c = 0; c < 4; c++)
        out_means[c] += weight * (double)texel[c];
      *out_squared += weight * (double)texel[3] * (double)texel[3];
    }
  }
}

/* Places of the texels of a finer row, out of `fine`, that texel i of `count` covers. */
typedef struct cover {
  double begin, end;
  int32_t first, last;
} cover;

static cover find_cover(int32_t i, int32_t count, int32_t fine) {
  cover c = {(double)i * fine / count, (double)(i + 1) * fine / count, 0, 0};
  c.first = (int32_t)c.begin;
  c.last = (int32_t)ceil(c.end) - 1;
  return c;
}

static double covered(const cover *c, int32_t texel) {
  return fum_least(c->end, texel + 1) - fum_most(c->begin, texel);
}

/* Averages areas: where a side is odd, three texels make one, the outer ones in part. */
static void reduce(const level *fine, const level *coarse) {
  for (int32_t y = 0; y < coarse->height; y++) {
    const cover up = find_cover(y, coarse->height, fine->height);
    for (int32_t x = 0; x < coarse->width; x++) {
      const cover across = find_cover(x, coarse->width, fine->width);
      const double area = (up.end - up.begin) * (across.end - across.begin);
      double sums[4] = {0.0};
      for (int32_t v = up.first; v <= up.last; v++) {
        for (int32_t u = across.first; u <= across.last; u++) {
          const double weight = covered(&up, v) * covered(&across, u);
          for (int c = 0; c < 4; c++)
            sums[c] += weight * (double)fine->texels[4 * ((int64_t)v * fine->width + u) + c];
        }
      }
      for (int c = 0; c < 4; c++)
        coarse->texels[4 * ((int64_t)y * coarse->width + x) + c] = (float)(sums[c] / area);
    }
  }
}

/* The first level: colours times opacity. */
static void take_pixels(const float *pixels, fum_map *map) {
  for (int64_t i = 0; i < (int64_t)map->width * map->height; i++) {
    const float *pixel = pixels + 4 * i, opacity = pixel[3];
    for (int c = 0; c < 3; c++) {
      map->texels[4 * i + c] = pixel[c] * opacity;
      map->is_colored = map->is_colored || (opacity > 0.0F && pixel[c] != 1.0F);
    }
    map->texels[4 * i + 3] = opacity;
  }
}

/* Scales a level so that its means are those of the first, over that of its opacity. */
static void scale_level(const level *l, const double means[4], const double first_means[4]) {
  double factors[4];
  for (int c = 0; c < 4; c++)
    factors[c] = means[c] > 0.0 ? first_means[c] / (means[c] * first_means[3]) : 0.0;
  for (int64_t i = 0; i < 4 * (int64_t)l->width * l->height; i++)
    l->texels[i] = (float)((double)l->texels[i] * factors[i % 4]);
}

static float find_edge(const fum_map *map) {
  float edge = 1.0F;
  for (int32_t y = 0; y < map->height; y++) {
    const bool is_border = y == 0 || y == map->height - 1;
    const int32_t step = is_border || map->width < 2 ? 1 : map->width - 1;
    for (int32_t x = 0; x < map->width; x += step)
      edge = fum_max(edge, map->texels[4 * ((int64_t)y * map->width + x) + 3]);
  }
  return edge;
}

static level first_level(const fum_map *map) {
  return (level){map->width, map->height, map->texels};
}

static level next_level(const level *l) {
  return (level){fum_map_half(l->width), fum_map_half(l->height), l->texels + 4 * (int64_t)l->width * l->height};
}

static bool is_last(const level *l) {
  return l->width == 1 && l->height == 1;
}

/* Makes the levels from the first one, then scales all of them. `weights` [width + height] is room. */
static int32_t fill_levels(fum_context *context, const char *name, double *weights, fum_map *map) {
  const double least = 1e-6;
  double *across = weights, *up = weights + map->width, means[4], first_means[4], squared;
  for (level l = first_level(map), next; !is_last(&l); l = next) {
    next = next_level(&l);
    reduce(&l, &next);
  }
  level l = first_level(map);
  for (int32_t k = 0; k < map->level_count; k++, l = next_level(&l)) {
    find_weights(l.width, across);
    find_weights(l.height, up);
    find_means(&l, across, up, k == 0 ? first_means : means, k == 0 ? &squared : &(double){0.0});
    if (first_means[3] < least)
      return fum_fail(context, FUM_ERROR_ARGUMENT, "%s: the map is transparent: its mean opacity is %g", name,
                      first_means[3]);
    if (k == 0) map->contrast = (float)fum_most(1.0, squared / (first_means[3] * first_means[3]));
    scale_level(&l, k == 0 ? first_means : means, first_means);
  }
  map->edge = find_edge(map);
  return FUM_OK;
}

int32_t fum_map_create(fum_context *context, const char *name, int32_t width, int32_t height, const float *pixels,
                       fum_map **out_map) {
  double *weights = NULL;
  fum_map *map = NULL;
  int32_t status = check_pixels(context, name, width, height, pixels);
  if (status != FUM_OK) return status;
  map = calloc(1, sizeof *map);
  if (map == NULL) return fum_fail(context, FUM_ERROR_MEMORY, "%s: no memory for a map", name);
  *map = (fum_map){.user_count = 1, .width = width, .height = height};
  for (level l = {width, height, NULL};; l = (level){fum_map_half(l.width), fum_map_half(l.height), NULL}) {
    map->texel_count += (int64_t)l.width * l.height;
    map->level_count++;
    if (is_last(&l)) break;
  }
  status = fum_alloc(context, map->texel_count, 4 * sizeof *map->texels, name, &map->texels);
  if (status == FUM_OK) status = fum_alloc(context, (int64_t)width + height, sizeof *weights, name, &weights);
  if (status != FUM_OK) goto done;
  take_pixels(pixels, map);
  status = fill_levels(context, name, weights, map);
  if (status != FUM_OK) goto done;
  *out_map = map;
  map = NULL;
done:
  fum_free(context, &weights);
  fum_map_drop(context, &map);
  return status;
}

bool fum_map_is_like(const fum_map *a, const fum_map *b) {
  const size_t bytes = 4 * sizeof *a->texels * (size_t)a->texel_count;
  return a->width == b->width && a->height == b->height && memcmp(a->texels, b->texels, bytes) == 0;
}

void fum_map_drop(fum_context *context, fum_map **map) {
  if (*map != NULL && --(*map)->user_count == 0) {
    fum_free(context, &(*map)->texels);
    free(*map);
  }
  *map = NULL;
}
