/* SPDX-License-Identifier: GPL-3.0-or-later */
/* The part of tile_loop.h that knows a tile's pixels: the rays through them, and the slabs that they are cut into. */
#ifndef FUM_BILLBOARD_TILE_RAYS_H
#define FUM_BILLBOARD_TILE_RAYS_H

#include "base/simd.h"
#include "base/vector.h"
#include "billboard/tile.h"

/* The widest vectors, whatever the instruction set. */
enum { WIDEST_LANES = 16 };

/* Splats whose shares of slabs are found together: a lane each. */
enum { BATCH = WIDEST_LANES, SHARES = 2 * BATCH };

/* A tile on its way. Pixels are in the order of fum_tile_pixel. */
typedef struct tile {
  const fum_tile_job *job;
  int32_t x0, y0;
  const float *solid_depths; /* the job's, or those beside solids */
  float *through;            /* where its transmittance goes; NULL: nowhere */
  int32_t first_slab, slab_count, channels;
  float columns[FUM_TILE], rows[FUM_TILE];           /* of the window */
  float u[FUM_TILE_PIXELS], v[FUM_TILE_PIXELS];      /* the same for each pixel */
  float inverse_length[FUM_TILE_PIXELS];             /* of the ray (u, v, -1); 1 in an orthographic view */
  float near[FUM_TILE_PIXELS], far[FUM_TILE_PIXELS]; /* ranges between which the ray sees smoke */
  float weights[FUM_TILE_PIXELS];                    /* shares of the pixels that the depths are for */
  float nearest_far, farthest_near;
  float *shares; /* [slab_count][2][BATCH] from a splat's first slab on: what it leaves there, how that changes */
  float ranges[FUM_MAX_SLABS + 1 + WIDEST_LANES]; /* of the faces from first_slab on */
} tile;

static void aim_pixel(tile *t, int32_t x, int32_t y) {
  const fum_view *view = t->job->view;
  const int32_t i = fum_tile_pixel(x, y);
  const float u = t->columns[x], v = t->rows[y];
  const float length = view->type == FUM_CAMERA_PERSPECTIVE ? sqrtf(1.0F + u * u + v * v) : 1.0F;
  float depth = (float)view->clip_end;
  if (t->solid_depths != NULL && t->x0 + x < view->width && t->y0 + y < view->height) {
    depth = fum_min(depth, t->solid_depths[(int64_t)(t->y0 + y) * view->width + t->x0 + x]);
  }
  t->u[i] = u;
  t->v[i] = v;
  t->inverse_length[i] = 1.0F / length;
  t->near[i] = (float)view->clip_start * length;
  t->far[i] = depth * length;
  t->nearest_far = fum_min(t->nearest_far, t->far[i]);
  t->farthest_near = fum_max(t->farthest_near, t->near[i]);
}

static void aim(tile *t) {
  const fum_view *view = t->job->view;
  const double *w = view->window;
  for (int32_t i = 0; i < FUM_TILE; i++) {
    t->columns[i] = (float)(w[0] + (w[1] - w[0]) * ((double)(t->x0 + i) + 0.5) / (double)view->width);
    t->rows[i] = (float)(w[2] + (w[3] - w[2]) * ((double)(t->y0 + i) + 0.5) / (double)view->height);
  }
  t->nearest_far = INFINITY;
  t->farthest_near = 0.0F;
  for (int32_t y = 0; y < FUM_TILE; y++) {
    for (int32_t x = 0; x < FUM_TILE; x++)
      aim_pixel(t, x, y);
  }
  const fum_face *faces = t->job->slabs->faces + t->first_slab;
  for (int32_t k = 0; k <= t->slab_count; k++)
    t->ranges[k] = faces[k].range;
  for (int32_t k = 0; k < WIDEST_LANES; k++)
    t->ranges[t->slab_count + 1 + k] = t->ranges[t->slab_count];
}

/* Floats from slab to slab. A splat writes one pixel of slab after slab: were they whole pages apart, all of these
 * would fall into the same few lines of the cache, and each load would wait for the store before it. */
static int64_t slab_stride(const tile *t) {
  return (int64_t)t->channels * FUM_TILE_PIXELS + WIDEST_LANES;
}

#endif
