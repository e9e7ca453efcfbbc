/* SPDX-License-Identifier: GPL-3.0-or-later */
#include "billboard/deep.h"

#include "base/vector.h"
#include "billboard/deep_curve.h"

#include <stdlib.h>
#include <string.h>

/* ---- What is noted of a tile ------------------------------------------------------------------------------------- */

/* Sums behind a slab. */
typedef struct layer {
  int32_t slab;
  float optical_depth[FUM_TILE_PIXELS];
  fum_tile_rgb rgb;
} layer;

/* One drawing of a tile, front to back. */
typedef struct trace {
  layer *layers; /* of slabs that show */
  int32_t count, room;
  float near[FUM_TILE_PIXELS], far[FUM_TILE_PIXELS], inverse_length[FUM_TILE_PIXELS], weights[FUM_TILE_PIXELS];
} trace;

enum { TRACES = 2 };

struct fum_deep_tile {
  trace traces[TRACES]; /* up to solids and beside them */
  int32_t trace_count;
  float *memory; /* room for the curves of a pixel... */
  int64_t memory_room;
  fum_deep_sample *samples; /* ...and for the samples of all */
  int64_t sample_room;
};

fum_deep_tile *fum_deep_tile_create(void) {
  return calloc(1, sizeof(fum_deep_tile));
}

void fum_deep_tile_free(fum_deep_tile *tile) {
  if (tile == NULL) return;
  for (int k = 0; k < TRACES; k++)
    free(tile->traces[k].layers);
  free(tile->samples);
  free(tile->memory);
  free(tile);
}

/* Room for at least `needed` items of `size` bytes; what was in it is kept. */
static bool grow(void *buffer_pointer, int64_t needed, size_t size, int64_t *room) {
  void *buffer;
  if (needed <= *room) return true;
  memcpy(&buffer, buffer_pointer, sizeof buffer);
  const int64_t wanted = needed + needed / 2;
  buffer = realloc(buffer, (size_t)wanted * size);
  if (buffer == NULL) return false;
  memcpy(buffer_pointer, &buffer, sizeof buffer);
  *room = wanted;
  return true;
}

bool fum_deep_begin(fum_deep_tile *tile, const fum_deep_rays *rays, int32_t most_slabs) {
  trace *t = &tile->traces[tile->trace_count];
  int64_t room = t->room;
  if (!grow(&t->layers, most_slabs, sizeof *t->layers, &room)) return false;
  t->room = (int32_t)room;
  t->count = 0;
  memcpy(t->near, rays->near, sizeof t->near);
  memcpy(t->far, rays->far, sizeof t->far);
  memcpy(t->inverse_length, rays->inverse_length, sizeof t->inverse_length);
  memcpy(t->weights, rays->weights, sizeof t->weights);
  tile->trace_count++;
  return true;
}

fum_tile_rgb *fum_deep_note(fum_deep_tile *tile, int32_t slab, const float *optical_depth) {
  trace *t = &tile->traces[tile->trace_count - 1];
  layer *l = &t->layers[t->count++];
  l->slab = slab;
  memcpy(l->optical_depth, optical_depth, sizeof l->optical_depth);
  return &l->rgb;
}

/* ---- From a tile to samples -------------------------------------------------------------------------------------- */

/* Where slabs begin and end that hold some of a pixel's smoke. Tails of particles that count as whole may lie in slabs
 * outside of what the ray sees: they go to the nearest slab inside. */
static void find_knots(const trace *t, const fum_face *faces, int32_t pixel, fum_deep_curve *out) {
  const float near = t->near[pixel], far = t->far[pixel], along = t->inverse_length[pixel];
  float before[FUM_DEEP_SUMS] = {0.0F}, sums[FUM_DEEP_SUMS] = {0.0F};
  for (int32_t n = 0; n < t->count; n++) {
    const layer *l = &t->layers[n];
    sums[0] = l->optical_depth[pixel];
    for (int c = 0; c < 3; c++)
      sums[1 + c] = l->rgb.of[c][pixel];
    if (memcmp(sums, before, sizeof sums) == 0) continue;
    const float begin = fum_min(fum_max(faces[l->slab].range, near), far) * along;
    const float end = fum_min(fum_max(faces[l->slab + 1].range, near), far) * along;
    if (!(begin < end)) continue;
    fum_deep_curve_add(out, begin, before);
    fum_deep_curve_add(out, end, sums);
    memcpy(before, sums, sizeof before);
  }
  for (int k = 0; k < FUM_DEEP_SUMS && out->count > 0; k++)
    out->sums[k][out->count - 1] = sums[k];
}

/* Room for a pixel's curves. */
typedef struct curves {
  fum_deep_curve knots, of[TRACES], mixed;
} curves;

static bool place_curves(fum_deep_tile *tile, curves *out) {
  int64_t most = 0;
  for (int32_t k = 0; k < tile->trace_count; k++)
    most = most > tile->traces[k].count ? most : tile->traces[k].count;
  const int64_t knots = 2 * most, bent = FUM_DEEP_STEPS * knots, mixed = tile->trace_count > 1 ? 2 * bent : 0;
  const int64_t knots_size = fum_deep_curve_size(knots), bent_size = fum_deep_curve_size(bent);
  const int64_t needed = knots_size + TRACES * bent_size + fum_deep_curve_size(mixed);
  if (!grow(&tile->memory, needed, sizeof *tile->memory, &tile->memory_room)) return false;
  fum_deep_curve_place(tile->memory, knots, &out->knots);
  for (int k = 0; k < TRACES; k++)
    fum_deep_curve_place(tile->memory + knots_size + k * bent_size, bent, &out->of[k]);
  fum_deep_curve_place(tile->memory + knots_size + TRACES * bent_size, mixed, &out->mixed);
  return true;
}

static const fum_deep_curve *find_curve(const fum_deep_tile *tile, const fum_face *faces, int32_t pixel, curves *c) {
  const float share = tile->traces[0].weights[pixel];
  const int traces = tile->trace_count > 1 && share < 1.0F ? 2 : 1;
  for (int k = 0; k < traces; k++) {
    c->knots.count = c->of[k].count = 0;
    find_knots(&tile->traces[k], faces, pixel, &c->knots);
    fum_deep_bend(&c->knots, &c->of[k]);
  }
  if (traces == 1) return &c->of[0];
  c->mixed.count = 0;
  const float rest = 1.0F - share;
  const fum_deep_share shares[TRACES] = {{share, {share, share, share}}, {rest, {rest, rest, rest}}};
  fum_deep_mix(TRACES, c->of, shares, &c->mixed);
  return &c->mixed;
}

/* Keeps a copy of the tile's samples that is as large as they are. */
static bool keep(const fum_deep_tile *tile, fum_deep *deep, int64_t index, int64_t count) {
  fum_deep_part *part = &deep->parts[index];
  int32_t status = FUM_OK;
  if (count == 0) return true;
#pragma omp critical
  status = fum_alloc(deep->context, count, sizeof *part->samples, "deep samples", &part->samples);
  if (status != FUM_OK) return false;
  memcpy(part->samples, tile->samples, (size_t)count * sizeof *part->samples);
  part->count = count;
  return true;
}

bool fum_deep_end(fum_deep_tile *tile, const fum_tile_job *job, int64_t index) {
  fum_deep *deep = job->deep;
  const int32_t x0 = (int32_t)(index % deep->columns) * FUM_TILE, y0 = (int32_t)(index / deep->columns) * FUM_TILE;
  const fum_deep_limits limits = {job->deep_tolerance, job->thinnest == 0.0F};
  const bool is_drawn = tile->trace_count > 0;
  curves c;
  int64_t count = 0;
  if (!is_drawn) return true;
  bool has_room = place_curves(tile, &c);
  for (int32_t y = 0; y < FUM_TILE && y0 + y < deep->height && has_room; y++) {
    for (int32_t x = 0; x < FUM_TILE && x0 + x < deep->width && has_room; x++) {
      const fum_deep_curve *curve = find_curve(tile, job->slabs->faces, fum_tile_pixel(x, y), &c);
      has_room = grow(&tile->samples, count + curve->count, sizeof *tile->samples, &tile->sample_room);
      if (!has_room) break;
      const int32_t found = fum_deep_divide(curve, &limits, tile->samples + count);
      deep->counts[(int64_t)(y0 + y) * deep->width + x0 + x] = (uint32_t)found;
      count += found;
    }
  }
  tile->trace_count = 0;
  return has_room && keep(tile, deep, index, count);
}

/* ---- The picture ------------------------------------------------------------------------------------------------- */

int32_t fum_deep_create(fum_context *context, const fum_view *view, fum_deep **out_deep) {
  fum_deep *deep = NULL;
  int32_t status = fum_alloc(context, 1, sizeof *deep, "deep pixels", &deep);
  if (status != FUM_OK) return status;
  *deep = (fum_deep){.context = context,
                     .width = view->width,
                     .height = view->height,
                     .columns = (view->width + FUM_TILE - 1) / FUM_TILE,
                     .rows = (view->height + FUM_TILE - 1) / FUM_TILE};
  status = fum_alloc(context, (int64_t)deep->width * deep->height, sizeof *deep->counts, "deep pixels", &deep->counts);
  if (status == FUM_OK) {
    status = fum_alloc(context, (int64_t)deep->columns * deep->rows, sizeof *deep->parts, "deep pixels", &deep->parts);
  }
  if (status == FUM_OK) {
    *out_deep = deep;
  } else {
    fum_deep_destroy(deep);
  }
  return status;
}

static void free_parts(fum_deep *deep) {
  for (int64_t i = 0; i < (int64_t)deep->columns * deep->rows && deep->parts != NULL; i++)
    fum_free(deep->context, &deep->parts[i].samples);
  fum_free(deep->context, &deep->parts);
}

int32_t fum_deep_gather(fum_deep *deep) {
  int64_t total = 0;
  for (int64_t i = 0; i < (int64_t)deep->columns * deep->rows; i++)
    total += deep->parts[i].count;
  const int32_t status = fum_alloc(deep->context, total, sizeof *deep->samples, "deep samples", &deep->samples);
  if (status != FUM_OK) return status;
  fum_deep_sample *next = deep->samples;
  for (int32_t y = 0; y < deep->height; y++) {
    for (int32_t column = 0; column < deep->columns; column++) {
      fum_deep_part *part = &deep->parts[(int64_t)(y / FUM_TILE) * deep->columns + column];
      const int32_t x0 = column * FUM_TILE;
      int64_t count = 0;
      for (int32_t x = x0; x < x0 + FUM_TILE && x < deep->width; x++)
        count += deep->counts[(int64_t)y * deep->width + x];
      if (count == 0) continue;
      memcpy(next, part->samples + part->taken, (size_t)count * sizeof *next);
      part->taken += count;
      next += count;
    }
  }
  deep->sample_count = total;
  free_parts(deep);
  return FUM_OK;
}

void fum_deep_find_rows(const fum_deep *deep, int64_t *out_firsts) {
  out_firsts[0] = 0;
  for (int32_t y = 0; y < deep->height; y++) {
    out_firsts[y + 1] = out_firsts[y];
    for (int32_t x = 0; x < deep->width; x++)
      out_firsts[y + 1] += deep->counts[(int64_t)y * deep->width + x];
  }
}

int64_t fum_deep_samples(const fum_deep *deep, const uint32_t **out_counts, const fum_deep_sample **out_samples) {
  *out_counts = deep->counts;
  *out_samples = deep->samples;
  return deep->sample_count;
}

void fum_deep_destroy(fum_deep *deep) {
  if (deep == NULL) return;
  fum_context *context = deep->context;
  free_parts(deep);
  fum_free(context, &deep->samples);
  fum_free(context, &deep->counts);
  fum_free(context, &deep);
}
