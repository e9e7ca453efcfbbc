/* SPDX-License-Identifier: GPL-3.0-or-later */
/* Particles as the camera sees them, sorted into the tiles of the picture that they touch. */
#ifndef FUM_BILLBOARD_SPLATS_H
#define FUM_BILLBOARD_SPLATS_H

#include "billboard/footprints.h"
#include "billboard/streak.h"
#include "billboard/stretch.h"
#include "lighting/slabs.h"

enum { FUM_TILE = 32 }; /* pixels a side */

typedef struct fum_splat {
  float center[3];                /* camera space */
  float sigma;                    /* along the view, m */
  float width;                    /* sigma across the view: at least 0.6 of a pixel */
  float optical_depth;            /* through the centre, lowered when it was widened */
  float reach;                    /* m along the view beyond which it holds nothing that is seen */
  float range;                    /* distance of the centre, in an orthographic view its depth */
  float footprint;                /* widths out to which it is drawn */
  float self_shade;               /* factor on what it scatters, of particles thinner than a pixel; 1 else */
  float middle_px[2], half_px[2]; /* box around its outline, in pixels from the centre of the first one; halves are 0 if
                                     it isn't seen */
  float rim; /* pixels whose distances from the middle, over the halves, have squares that add up to more are outside */
  uint16_t first_slab, last_slab; /* that it reaches into */
} fum_splat;

typedef struct fum_splats {
  int64_t count;
  fum_splat *splats;      /* [count] in the octree's order */
  fum_stretch *stretches; /* [count] of an octree's bunches; NULL: all are round */
  fum_streak *streaks;    /* [count] of smeared particles; NULL: none are */
  int64_t seen_count;     /* those with pixels */
  bool has_dust;          /* some are drawn wider than they are */
  int32_t columns, rows;  /* of tiles */
  int64_t *tile_begins;   /* [columns rows + 1] into tile_splats */
  uint32_t *tile_splats;  /* splats of each tile, in the octree's order */
} fum_splats;

static inline bool fum_splat_is_seen(const fum_splat *s) {
  return s->half_px[0] > 0.0F;
}

/* Tiles on so many pixels. */
static inline int32_t fum_tiles_along(int32_t pixels) {
  return (pixels + FUM_TILE - 1) / FUM_TILE;
}

/* Squares of the distances from the splat's middle, over its half size, of the nearest of the pixels first to last. */
static inline float fum_splat_gap(const fum_splat *s, int axis, float first, float last) {
  const float before = first - s->middle_px[axis], behind = s->middle_px[axis] - last;
  const float gap = before > 0.0F ? before : behind > 0.0F ? behind : 0.0F;
  return gap * gap / (s->half_px[axis] * s->half_px[axis]);
}

/* How particles are seen: `smears` NULL where they stand; `thinnest` as in fum_slabs_find. */
typedef struct fum_splats_options {
  const fum_smears *smears;
  fum_footprints footprints;
  float thinnest;
  float least_blur; /* as in fum_streak_kind */
} fum_splats_options;

int32_t fum_splats_find(fum_context *context, const fum_octree *octree, const fum_view *view, const fum_slabs *slabs,
                        const fum_splats_options *options, fum_splats *out_splats);

/* Splats, without streaks, when they are seen in a picture of the same camera with other pixels. */
typedef struct fum_splats_again {
  const uint8_t *from;   /* [columns rows] tiles whose splats are asked for, the others are in none; NULL: all are, and
                            seen anew */
  const uint8_t *wanted; /* [columns rows] tiles of the new picture that they are sorted into; NULL: all */
  float scale, shift[2]; /* from the old pixels to the new ones */
} fum_splats_again;

int32_t fum_splats_see_again(fum_context *context, const fum_octree *octree, const fum_view *view,
                             const fum_slabs *slabs, const fum_splats_options *options, const fum_splats_again *again,
                             fum_splats *splats);
void fum_splats_free(fum_context *context, fum_splats *splats);

#endif
