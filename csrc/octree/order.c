/* SPDX-License-Identifier: GPL-3.0-or-later */
#include "octree/order.h"

#include "base/vector.h"
#include "octree/deal.h"
#include "octree/pile.h"
#include "octree/thin.h"

static const char *const WHAT = "density octree";

/* Box of the particles of a block, and how many they are. */
typedef struct extent {
  float lower[3], upper[3];
  int64_t count;
} extent;

static extent measure_block(fum_context *context, const fum_source *source, int block, int blocks) {
  extent e = {{INFINITY, INFINITY, INFINITY}, {-INFINITY, -INFINITY, -INFINITY}, 0};
  fum_source_reader r;
  fum_source_begin(source, block, blocks, &r);
  while (fum_source_read(context, &r)) {
    e.count += r.count;
    for (int32_t i = 0; i < r.count; i++) {
      for (int axis = 0; axis < 3; axis++) {
        e.lower[axis] = fum_min(r.places[axis][i], e.lower[axis]);
        e.upper[axis] = fum_max(r.places[axis][i], e.upper[axis]);
      }
    }
  }
  return e;
}

int32_t fum_order_measure(fum_context *context, const fum_source *source, int64_t *out_count, fum_cube *out_cube) {
  const int blocks = fum_source_blocks(context, fum_source_count(source));
  extent *extents = NULL;
  const int32_t status = fum_alloc(context, blocks, sizeof *extents, WHAT, &extents);
  if (status != FUM_OK) return status;
#pragma omp parallel for num_threads(blocks) schedule(static, 1)
  for (int block = 0; block < blocks; block++)
    extents[block] = measure_block(context, source, block, blocks);
  double side = 0.0;
  *out_count = 0;
  for (int block = 0; block < blocks; block++)
    *out_count += extents[block].count;
  for (int axis = 0; axis < 3; axis++) {
    float lower = INFINITY, upper = -INFINITY;
    for (int block = 0; block < blocks; block++) {
      lower = fum_min(lower, extents[block].lower[axis]);
      upper = fum_max(upper, extents[block].upper[axis]);
    }
    out_cube->lower[axis] = lower;
    side = fum_most(side, (double)upper - (double)lower);
  }
  out_cube->cells_per_metre = side > 0.0 ? (double)(1 << FUM_CUBE_LEVELS) / side : 0.0;
  fum_free(context, &extents);
  return fum_is_cancelled(context) ? FUM_ERROR_CANCELLED : FUM_OK;
}

/* An octree in the making. */
typedef struct sorter {
  fum_context *context;
  const fum_cube *cube;
  fum_octree *octree;
  uint8_t *levels; /* [count] */
  int64_t most_in_pile;
  uint64_t *rooms; /* [threads][FUM_PILE_WORDS most_in_pile] */
} sorter;

/* Of particles in one cell 2^shift of the finest wide: find the smallest that has them all, 2^(what is returned) wide.
 */
static int find_shift(const sorter *s, int shift, int64_t begin, int64_t count) {
  const float *const places[3] = {s->octree->x + begin, s->octree->y + begin, s->octree->z + begin};
  uint64_t first, differences = 0;
  fum_cube_find_codes(s->cube, shift, 1, places, &first);
#pragma omp parallel for num_threads(fum_thread_count(s->context)) schedule(static) reduction(| : differences)
  for (int64_t i = 0; i < count; i += FUM_CUBE_STEP) {
    const int64_t left = count - i, step = left < FUM_CUBE_STEP ? left : FUM_CUBE_STEP;
    uint64_t codes[FUM_CUBE_STEP];
    fum_cube_find_codes(s->cube, shift, step, (const float *const[3]){places[0] + i, places[1] + i, places[2] + i},
                        codes);
    for (int64_t k = 0; k < step; k++)
      differences |= codes[k] ^ first;
  }
  return fum_pile_level(differences);
}

static int32_t sort_piles(sorter *s, const fum_deal *d);

/* Deals a pile that doesn't fit into a cache out once more, below the first level at which its cells differ. */
static int32_t sort_large_pile(sorter *s, int shift, int64_t begin, int64_t count) {
  const int above = find_shift(s, shift, begin, count);
  if (above == 0) return FUM_OK;
  fum_deal d = {0};
  fum_octree *copy = NULL;
  int32_t status = fum_deal_begin(s->context, s->cube, above, count, &d);
  if (status == FUM_OK)
    status = fum_octree_create(s->context, s->octree->origin, count, s->octree->inverse_sigmas != NULL, &copy);
  if (status == FUM_OK) {
#pragma omp parallel for num_threads(d.blocks) schedule(static, 1)
    for (int block = 0; block < d.blocks; block++) {
      const int64_t first = fum_block_begin(count, block, d.blocks), end = fum_block_begin(count, block + 1, d.blocks);
      fum_octree_copy(s->octree, (uint32_t)(begin + first), (uint32_t)(end - first), copy, (uint32_t)first);
    }
    status = fum_deal_octree(s->context, copy, begin, &d, s->octree);
  }
  fum_octree_destroy(s->context, copy);
  if (status == FUM_OK) status = sort_piles(s, &d);
  fum_deal_end(s->context, &d);
  return status;
}

static int32_t sort_piles(sorter *s, const fum_deal *d) {
  const int shift = d->band.shift;
#pragma omp parallel for num_threads(d->blocks) schedule(dynamic, 1)
  for (int32_t pile = 0; pile < d->piles; pile++) {
    const int64_t begin = d->begins[pile], count = d->begins[pile + 1] - begin;
    if (fum_progress_in_loop(s->context, pile, 16) || count == 0 || count > s->most_in_pile) continue;
    uint64_t *room = s->rooms + FUM_PILE_WORDS * s->most_in_pile * omp_get_thread_num();
    fum_pile_sort(s->cube, shift, begin, count, room, s->octree, s->levels);
  }
  int32_t status = fum_is_cancelled(s->context) ? FUM_ERROR_CANCELLED : FUM_OK;
  for (int32_t pile = 0, last = -1; pile < d->piles && status == FUM_OK; pile++) {
    const int64_t begin = d->begins[pile], count = d->begins[pile + 1] - begin;
    if (count == 0) continue;
    if (last >= 0) s->levels[begin] = fum_pile_level((uint64_t)(pile ^ last) << (3 * shift));
    if (count > s->most_in_pile) status = sort_large_pile(s, shift, begin, count);
    last = pile;
  }
  return status;
}

int32_t fum_order_fill(fum_context *context, const fum_source *source, const fum_cube *cube, fum_octree *octree,
                       uint8_t **out_levels) {
  const int64_t count = octree->count, most = count < FUM_PILE_MOST ? count : FUM_PILE_MOST;
  sorter s = {.context = context, .cube = cube, .octree = octree, .most_in_pile = most};
  fum_deal d = {0};
  int32_t status = fum_deal_begin(context, cube, FUM_CUBE_LEVELS, fum_source_count(source), &d);
  if (status == FUM_OK) status = fum_deal_source(context, source, &d, octree);
  if (status == FUM_OK) status = fum_progress_report(context, FUM_STAGE_OCTREE, 0.4F, "Sorting particles in space");
  if (status == FUM_OK) status = fum_alloc(context, count, sizeof *s.levels, WHAT, &s.levels);
  if (status == FUM_OK)
    status = fum_alloc(context, FUM_PILE_WORDS * most * fum_thread_count(context), sizeof *s.rooms, WHAT, &s.rooms);
  if (status == FUM_OK) status = sort_piles(&s, &d);
  if (status == FUM_OK) {
    *out_levels = s.levels;
    s.levels = NULL;
  }
  fum_free(context, &s.rooms);
  fum_free(context, &s.levels);
  fum_deal_end(context, &d);
  return status;
}
