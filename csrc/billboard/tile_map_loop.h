/* SPDX-License-Identifier: GPL-3.0-or-later */
/* The part of tile_loop.h that knows maps: what a splat's holds at the tile's pixels. */
#include "billboard/map_look.h"
#include "billboard/tile_rays.h"

/* A splat's map, and what it holds at the pixels of a vector: red, green, blue and opacity. */
typedef struct splat_map {
  const fum_map *map;
  fum_map_look look;
  fum_vf here[4];
} splat_map;

/* False if the splat has no map. */
static bool find_map(const fum_tile_job *job, uint32_t splat, splat_map *out) {
  if (!job->has_maps) return false;
  const fum_splat *s = &job->splats->splats[splat];
  const uint32_t index = job->octree->indices[splat];
  const fum_particles *set = fum_scene_particles_of(job->scene, index);
  const double center[3] = {(double)s->center[0], (double)s->center[1], (double)s->center[2]};
  if (set->map == NULL) return false;
  out->map = set->map;
  fum_map_look_find(set, index - set->offset, job->view, center, (double)s->sigma, (double)s->width, &out->look);
  out->look.is_colored = set->map->is_colored && !job->ignores_map_colors;
  return true;
}

/* Where rays meet a level: the texels around, and the shares of those to the right and above. */
typedef struct map_place {
  fum_vi first, right, above; /* floats from the level's first to a texel's first channel, and to those beside it */
  fum_vf across, up;
} map_place;

static map_place find_map_place(int32_t width, int32_t height, fum_vf x, fum_vf y) {
  const fum_vf columns = x * (float)width - 0.5F, rows = y * (float)height - 0.5F;
  const fum_vf column = fum_vf_min(fum_vf_at_least(columns, 0.0F), fum_vf_set((float)(width - 1)));
  const fum_vf row = fum_vf_min(fum_vf_at_least(rows, 0.0F), fum_vf_set((float)(height - 1)));
  const fum_vi left = __builtin_convertvector(column, fum_vi), below = __builtin_convertvector(row, fum_vi);
  return (map_place){.first = 4 * (below * width + left),
                     .right = (left < width - 1) & 4,
                     .above = (below < height - 1) & (4 * width),
                     .across = column - __builtin_convertvector(left, fum_vf),
                     .up = row - __builtin_convertvector(below, fum_vf)};
}

/* fum_map_bilinear of one channel. */
static fum_vf read_channel(const float *level, const map_place *at, int channel) {
  const float *from = level + channel;
  const fum_vi above = at->first + at->above;
  const fum_vf a = fum_vf_gather(from, at->first), b = fum_vf_gather(from, at->first + at->right);
  const fum_vf c = fum_vf_gather(from, above), d = fum_vf_gather(from, above + at->right);
  const fum_vf lower = a + (b - a) * at->across, upper = c + (d - c) * at->across;
  return lower + (upper - lower) * at->up;
}

/* fum_map_read at the pixels from `pixel` on, of the channels that are needed. */
static void read_map(const tile *t, int32_t pixel, splat_map *m) {
  const fum_map_look *look = &m->look;
  const float *a = look->across, *b = look->up;
  const fum_vf u = fum_vf_load(t->u + pixel), v = fum_vf_load(t->v + pixel);
  const fum_vf inverse_length = fum_vf_load(t->inverse_length + pixel);
  const fum_vf x = 0.5F + (u * a[0] + v * a[1] + a[2]) * inverse_length;
  const fum_vf y = 0.5F + (u * b[0] + v * b[1] + b[2]) * inverse_length;
  const float *level = m->map->texels + 4 * (int64_t)look->begin;
  const float *next = level + 4 * (int64_t)look->width * look->height;
  const map_place place = find_map_place(look->width, look->height, x, y);
  const map_place coarse = find_map_place(fum_map_half(look->width), fum_map_half(look->height), x, y);
  for (int c = t->channels > 1 && look->is_colored != 0 ? 0 : 3; c < 4; c++) {
    m->here[c] = read_channel(level, &place, c);
    if (look->blend > 0.0F) m->here[c] += (read_channel(next, &coarse, c) - m->here[c]) * look->blend;
  }
  for (int c = 0; c < 3 && look->is_colored == 0; c++)
    m->here[c] = m->here[3];
}

/* `depth` without the map. */
static void deposit_mapped(const tile *t, float *at, fum_vf depth, const float *look, const splat_map *m) {
  fum_vf_store(at, fum_vf_load(at) + depth * m->here[3]);
  for (int32_t c = 1; c < t->channels; c++) {
    float *channel = at + (int64_t)c * FUM_TILE_PIXELS;
    fum_vf_store(channel, fum_vf_load(channel) + depth * look[c - 1] * m->here[(c - 1) % 3]);
  }
}
