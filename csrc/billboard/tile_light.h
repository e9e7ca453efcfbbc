/* SPDX-License-Identifier: GPL-3.0-or-later */
/* Light in a slab of a tile: the lattice's samples interpolated to pixels, strength and phase function at the middle of
 * the slab. */
#ifndef FUM_BILLBOARD_TILE_LIGHT_H
#define FUM_BILLBOARD_TILE_LIGHT_H

#include "billboard/tile.h"

/* A slab of less optical depth than this isn't lit, nor one behind more than that. */
static const float FUM_TILE_THIN = 1e-10F, FUM_TILE_DARK = 12.0F;

/* The pixels of a tile. */
typedef struct fum_light_grid {
  const fum_tile_job *job;
  const float *columns, *rows; /* [FUM_TILE] of the window */
  const float *u, *v;          /* [FUM_TILE_PIXELS] the same for each pixel */
  const float *inverse_length; /* [FUM_TILE_PIXELS] of (u, v, -1) */
  const float *near, *far;     /* [FUM_TILE_PIXELS] ranges at which the ray begins and ends */
} fum_light_grid;

/* One light in one slab, for all pixels. */
typedef struct fum_slab_light {
  float begin[FUM_TILE_PIXELS], end[FUM_TILE_PIXELS]; /* optical depth to the light on the slab's faces */
  const float *color;                                 /* [3] */
  float strengths[FUM_MAX_CLASSES][FUM_TILE_PIXELS];  /* irradiance times phase function, past solids */
} fum_slab_light;

/* A slab's smoke at all pixels: what isn't seen isn't lit. */
typedef struct fum_slab_smoke {
  int32_t index;                      /* of the slab */
  const float *depth, *before, *next; /* [FUM_TILE_PIXELS] optical depth of the slab and those beside it; NULL: none */
  const float *front;                 /* [FUM_TILE_PIXELS] optical depth in front of it */
} fum_slab_smoke;

/* What the lattice holds around a slab. */
typedef struct fum_slab_held {
  const float *faces[4]; /* [FUM_TILE_PIXELS] optical depth to the light, or that per metre, on the faces before, at the
                            begin, at the end of and behind it; NaN: nothing is held there */
  float ranges[4];       /* of these faces */
  const float *visible;  /* [FUM_TILE_PIXELS] share that solids let through; NULL without solids */
} fum_slab_held;

/* Visibility that is off by less counts as full or none. */
static const float FUM_SHADOW_SLACK = 1e-3F;
/* Distances to a light, over the part of a ray that is looked at, from which on its middle stands for all of it: 1 /
 * this. */
static const float FUM_STEEP = 0.25F;

/* `held` belongs to the lamp as long as the tile's slabs are gone through; `out` points into it. */
void fum_tile_hold(const fum_light_grid *grid, int32_t lamp, int32_t slab, fum_tile_held *held, fum_slab_held *out);

/* Lights one pixel, whatever the lamp, but for an environment's: these are even everywhere. */
void fum_tile_light_pixel(const fum_light_grid *grid, int32_t lamp, const fum_slab_smoke *smoke,
                          const fum_slab_held *held, int32_t pixel, fum_slab_light *out_light);

#endif
