/* SPDX-License-Identifier: GPL-3.0-or-later */
/* One tile of the picture: its particles' optical depth is added up in slabs along each pixel's ray, then light and
 * attenuation are integrated from slab to slab. */
#ifndef FUM_BILLBOARD_TILE_H
#define FUM_BILLBOARD_TILE_H

#include "billboard/bokeh.h"
#include "billboard/splats.h"
#include "lighting/lattice.h"
#include "lighting/slabs.h"

enum { FUM_TILE_PIXELS = FUM_TILE * FUM_TILE, FUM_MAX_CLASSES = 16 };

/* A tile's pixels are kept in square blocks, one after the other: few blocks cover a splat. */
enum { FUM_BLOCK = 4, FUM_BLOCK_PIXELS = FUM_BLOCK * FUM_BLOCK, FUM_BLOCKS = FUM_TILE / FUM_BLOCK };

/* Where the pixel in column x and row y of a tile is kept. */
static inline int32_t fum_tile_pixel(int32_t x, int32_t y) {
  const int32_t block = y / FUM_BLOCK * FUM_BLOCKS + x / FUM_BLOCK;
  return block * FUM_BLOCK_PIXELS + y % FUM_BLOCK * FUM_BLOCK + x % FUM_BLOCK;
}

/* Particles that scatter alike: with one anisotropy, and lit by the same lights. */
typedef struct fum_tile_class {
  float anisotropy;
  int32_t light_set; /* of some of them */
} fum_tile_class;

/* What the tiles of a picture share. */
typedef struct fum_tile_job {
  const fum_scene *scene;
  const fum_octree *octree;
  const fum_view *view;
  const fum_slabs *slabs;
  const fum_splats *splats;
  const uint8_t *wanted;    /* [tiles of the splats] those that are drawn; NULL: all */
  const fum_smears *smears; /* of the splats that have streaks... */
  const fum_bokeh *bokeh;   /* ...and what they are like out of focus; empty if all is in focus */
  const fum_lattice *lattice;
  const fum_lamps *lamps;
  const fum_solids *solids; /* that cast shadows; NULL: none */
  float solid_shadow_intensity;
  const float *solid_depths; /* [height][width] along the axis; NULL: none */
  const float *solid_behind; /* [height][width] the same beside the solid, where its edge runs through a pixel... */
  const float *solid_shares; /* ...and the share of the pixel in front of the solid; NULL: no edges */
  int32_t class_count;
  const fum_tile_class *classes; /* [class_count] */
  uint8_t *class_of;             /* [sets of particles] their class; owned, freed with fum_free */
  bool is_uniform;               /* one class, one albedo and no emission: only optical depth is added up... */
  float albedo[3];               /* ...and this is the albedo */
  bool glows;                    /* emission is added up as well */
  bool has_maps;                 /* some particles have a map... */
  bool ignores_map_colors;       /* ...whose colours are no matter of `values` */
  const float *centre_light; /* [3 octree->count] of particles that are lit at their centres, as of fum_inscatter, and
                                counted as emission; NULL: light comes from the lattice */
  const float *values;       /* [3 octree->count] any quantity of the particles: drawn instead of what they emit, as its
                                mean along the ray, weighted with what each adds to opacity; NULL: none */
  float straight;            /* sigmas along the view within which bent faces count as flat: a share of the tolerance */
  float thinnest;            /* optical depth that a particle counts at least; above 0 if anything glows */
  float *through[2];         /* [height][width] of 1, to be the transmittance up to the solid, and beside it; NULL: not
                                asked for */
  float *rgba;               /* [height][width][4] */
  float *const *light_rgb;   /* [lights] [height][width][3] of rgba, what each light makes; NULL: not asked for */
  float *emission;           /* [height][width][3] of rgba, what the smoke itself emits; NULL: not asked for */
  struct fum_deep *deep;     /* where the smoke in depth goes; NULL: not asked for */
  float deep_tolerance;
} fum_tile_job;

enum { FUM_NO_FACE = INT32_MIN };

/* What the lattice holds of a light at a tile's pixels, on the faces around a slab. */
typedef struct fum_tile_held {
  int32_t faces[4]; /* face f, from -1 on, is kept at f & 3 */
  float values[4][FUM_TILE_PIXELS];
  float visible[FUM_TILE_PIXELS]; /* share that solids let through, of the slab */
  float around[FUM_TILE_PIXELS];  /* of an environment: what smoke scatters to the camera of its unhindered light */
} fum_tile_held;

/* Radiance of a tile's pixels. */
typedef struct fum_tile_rgb {
  float of[3][FUM_TILE_PIXELS];
} fum_tile_rgb;

/* Buffers of one thread; zeroed before the first tile. */
typedef struct fum_tile_scratch {
  float *slabs; /* [slab][channel][FUM_TILE_PIXELS], slabs a little further apart (slab_stride); behind them room for
                   shares of splats */
  int64_t slabs_size;
  fum_tile_held *held;        /* [lamp] */
  fum_tile_rgb *parts;        /* [light + 1] of each light that is asked for by itself, and of emission */
  struct fum_deep_tile *deep; /* what is noted of the tile for deep pixels; NULL: not asked for */
  bool is_out_of_memory;
} fum_tile_scratch;

/* Renders the pixels of tile `index` of job->splats. */
typedef void (*fum_tile_fn)(const fum_tile_job *job, int64_t index, fum_tile_scratch *scratch);

/* The loop for this processor. */
fum_tile_fn fum_tile_get(void);

#endif
