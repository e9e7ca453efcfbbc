/* SPDX-License-Identifier: GPL-3.0-or-later */
#include "octree/deal.h"

#include "octree/tray.h"

static const char *const WHAT = "density octree";

int32_t fum_deal_begin(fum_context *context, const fum_cube *cube, int above, int64_t count, fum_deal *d) {
  /* So that piles fit into a cache, and trays too: smoke fills a small part of its cube. */
  const int most = count < 1 << 14 ? 2 : count < 1 << 18 ? 3 : 4, levels = most < above ? most : above;
  *d = (fum_deal){.cube = cube, .band = {above - levels, levels}, .piles = 1 << (3 * levels)};
  d->blocks = fum_source_blocks(context, count);
  const int32_t status = fum_alloc(context, (int64_t)d->blocks * d->piles, sizeof *d->next, WHAT, &d->next);
  return status == FUM_OK ? fum_alloc(context, d->piles + 1, sizeof *d->begins, WHAT, &d->begins) : status;
}

void fum_deal_end(fum_context *context, fum_deal *d) {
  fum_free(context, &d->begins);
  fum_free(context, &d->next);
}

/* Turns each block's counts of particles for each pile into where they go. */
static void place_piles(int64_t first, fum_deal *d) {
  uint32_t at = (uint32_t)first;
  for (int32_t pile = 0; pile < d->piles; pile++) {
    d->begins[pile] = at;
    for (int block = 0; block < d->blocks; block++) {
      uint32_t *next = &d->next[(int64_t)block * d->piles + pile];
      const uint32_t count = *next;
      *next = at;
      at += count;
    }
  }
  d->begins[d->piles] = at;
}

/* What is dealt at a time: at most FUM_CUBE_STEP. */
typedef struct hand {
  int64_t count;
  const uint32_t *indices;
  const float *places[3], *inverse_sigmas, *optical_depths; /* the last two NULL: points */
} hand;

static void count_hand(const fum_deal *d, const hand *h, uint32_t *counts) {
  uint32_t piles[FUM_CUBE_STEP];
  fum_cube_find_short_codes(d->cube, d->band, h->count, h->places, piles);
  for (int64_t i = 0; i < h->count; i++)
    counts[piles[i]]++;
}

static void deal_hand(const fum_deal *d, const hand *h, const fum_tray *tray) {
  uint32_t piles[FUM_CUBE_STEP];
  fum_cube_find_short_codes(d->cube, d->band, h->count, h->places, piles);
  for (int64_t i = 0; i < h->count; i++) {
    fum_record r = {.place = {h->places[0][i], h->places[1][i], h->places[2][i]}, .index = h->indices[i]};
    if (h->inverse_sigmas != NULL) {
      r.inverse_sigma = h->inverse_sigmas[i];
      r.optical_depth = h->optical_depths[i];
    }
    fum_tray_put(tray, piles[i], &r);
  }
}

/* What is dealt out: all of a source or, where that is NULL, of an octree. */
typedef struct supply {
  const fum_source *source;
  const fum_octree *octree;
} supply;

static hand hand_of(const fum_octree *octree, int64_t begin, int64_t end) {
  const int64_t left = end - begin, count = left < FUM_CUBE_STEP ? left : FUM_CUBE_STEP;
  hand h = {count, octree->indices + begin, {octree->x + begin, octree->y + begin, octree->z + begin}, NULL, NULL};
  if (octree->inverse_sigmas == NULL) return h;
  h.inverse_sigmas = octree->inverse_sigmas + begin;
  h.optical_depths = octree->optical_depths + begin;
  return h;
}

static void count_block(fum_context *context, const supply *s, const fum_deal *d, int block) {
  uint32_t *counts = d->next + (int64_t)block * d->piles;
  if (s->source != NULL) {
    fum_source_reader r;
    fum_source_begin(s->source, block, d->blocks, &r);
    while (fum_source_read(context, &r))
      count_hand(d, &(hand){.count = r.count, .places = {r.places[0], r.places[1], r.places[2]}}, counts);
    return;
  }
  const int64_t end = fum_block_begin(s->octree->count, block + 1, d->blocks);
  for (int64_t i = fum_block_begin(s->octree->count, block, d->blocks); i < end; i += FUM_CUBE_STEP) {
    const hand h = hand_of(s->octree, i, end);
    count_hand(d, &h, counts);
  }
}

static void deal_source(fum_context *context, const fum_source *source, const fum_deal *d, int block,
                        const fum_tray *tray) {
  uint32_t indices[FUM_SOURCE_STRETCH];
  float inverse_sigmas[FUM_SOURCE_STRETCH], optical_depths[FUM_SOURCE_STRETCH];
  fum_source_reader r;
  fum_source_begin(source, block, d->blocks, &r);
  while (fum_source_read(context, &r)) {
    hand h = {.count = r.count, .indices = indices, .places = {r.places[0], r.places[1], r.places[2]}};
    fum_source_describe(&r, indices, inverse_sigmas, optical_depths);
    if (r.set != NULL) h.inverse_sigmas = inverse_sigmas;
    if (r.set != NULL) h.optical_depths = optical_depths;
    deal_hand(d, &h, tray);
  }
}

static void deal_block(fum_context *context, const supply *s, const fum_deal *d, int block, const fum_tray *tray) {
  if (s->source != NULL) {
    deal_source(context, s->source, d, block, tray);
  } else {
    const int64_t end = fum_block_begin(s->octree->count, block + 1, d->blocks);
    for (int64_t i = fum_block_begin(s->octree->count, block, d->blocks); i < end; i += FUM_CUBE_STEP) {
      const hand h = hand_of(s->octree, i, end);
      deal_hand(d, &h, tray);
    }
  }
  fum_tray_finish(tray);
}

static int32_t deal(fum_context *context, const supply *s, int64_t begin, fum_deal *d, fum_octree *octree) {
  fum_tray *trays = NULL;
#pragma omp parallel for num_threads(d->blocks) schedule(static, 1)
  for (int block = 0; block < d->blocks; block++)
    count_block(context, s, d, block);
  fum_progress_pulse(context);
  if (fum_is_cancelled(context)) return FUM_ERROR_CANCELLED;
  place_piles(begin, d);
  const int32_t status = fum_trays_create(context, d->blocks, d->piles, d->next, octree, &trays);
  if (status != FUM_OK) return status;
#pragma omp parallel for num_threads(d->blocks) schedule(static, 1)
  for (int block = 0; block < d->blocks; block++)
    deal_block(context, s, d, block, &trays[block]);
  fum_trays_free(context, &trays);
  return fum_is_cancelled(context) ? FUM_ERROR_CANCELLED : FUM_OK;
}

int32_t fum_deal_source(fum_context *context, const fum_source *source, fum_deal *d, fum_octree *octree) {
  return deal(context, &(supply){.source = source}, 0, d, octree);
}

int32_t fum_deal_octree(fum_context *context, const fum_octree *from, int64_t begin, fum_deal *d, fum_octree *octree) {
  return deal(context, &(supply){.octree = from}, begin, d, octree);
}
