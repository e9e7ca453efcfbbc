/* SPDX-License-Identifier: GPL-3.0-or-later */
#include "lighting/lattice_groups.h"

#include "lighting/receivers.h"

#include <string.h>

/* Faces that share groups: about as far apart as samples are on them, so that groups of 4 x 4 samples on each are about
 * as deep as wide. A light may come from any side. */
enum { DEEP = 4 };

/* A block of 8 x 8 samples of a face, some of them marked. */
typedef struct block {
  int64_t word;
  int32_t face;
} block;

/* Blocks of a few faces, sorted by the blocks of one of them that they are in front of or behind. */
typedef struct stack {
  const fum_marks *marks;
  const fum_lattice *lattice;
  int32_t begin, end; /* faces */
  int32_t base;       /* the face with most blocks */
  int64_t cell_count; /* its blocks */
  int64_t *cells;     /* [cell_count + 1] where the blocks of each begin */
  block *blocks;
} stack;

static int64_t block_count(const fum_marks *m, int32_t face) {
  return m->firsts[face + 1] - m->firsts[face];
}

static stack begin_stack(const fum_marks *m, const fum_lattice *lattice, int64_t index, int64_t *cells, block *blocks) {
  stack s = {.marks = m, .lattice = lattice, .begin = (int32_t)index * DEEP, .cells = cells, .blocks = blocks};
  s.end = s.begin + DEEP < lattice->face_count ? s.begin + DEEP : lattice->face_count;
  s.base = s.begin;
  for (int32_t f = s.begin + 1; f < s.end; f++) {
    if (block_count(m, f) > block_count(m, s.base)) s.base = f;
  }
  s.cell_count = block_count(m, s.base);
  return s;
}

/* The block of the base before or behind the middle of a block, along one axis. */
static int64_t cell_along(const fum_lattice_face *base, const fum_lattice_face *grid, int axis, int64_t at,
                          int64_t count) {
  const float middle = grid->origin[axis] + grid->spacing[axis] * ((float)(8 * at) + 3.5F);
  const float cell = (middle - base->origin[axis]) / (8.0F * base->spacing[axis]);
  return cell < 0.0F ? 0 : cell < (float)count ? (int64_t)cell : count - 1;
}

static int64_t cell_of(const stack *s, int32_t face, int64_t at) {
  const fum_lattice_face *base = &s->lattice->faces[s->base], *grid = &s->lattice->faces[face];
  const int64_t across = fum_blocks_across(grid), base_across = fum_blocks_across(base);
  return cell_along(base, grid, 1, at / across, s->cell_count / base_across) * base_across +
         cell_along(base, grid, 0, at % across, base_across);
}

/* Puts blocks with marks where their cells begin; `places` NULL: counts them. */
static void visit_blocks(const stack *s, block *places) {
  for (int32_t f = s->begin; f < s->end; f++) {
    const int64_t first = s->marks->firsts[f];
    for (int64_t w = first; w < s->marks->firsts[f + 1]; w++) {
      if (s->marks->words[w] == 0) continue;
      int64_t *cell = &s->cells[cell_of(s, f, w - first)];
      if (places == NULL) {
        cell[1]++;
      } else {
        places[(*cell)++] = (block){w, f};
      }
    }
  }
}

/* Counting sort. */
static void sort_blocks(const stack *s) {
  memset(s->cells, 0, ((size_t)s->cell_count + 1) * sizeof *s->cells);
  visit_blocks(s, NULL);
  for (int64_t k = 0; k < s->cell_count; k++)
    s->cells[k + 1] += s->cells[k];
  visit_blocks(s, s->blocks);
  for (int64_t k = s->cell_count; k > 0; k--)
    s->cells[k] = s->cells[k - 1];
  s->cells[0] = 0;
}

/* Groups that are written down, or only counted. */
typedef struct writer {
  int64_t sample_count, group_count;
  uint32_t *samples, *begins; /* NULL: counted */
} writer;

static void begin_group(writer *w) {
  if (w->begins != NULL) w->begins[w->group_count] = (uint32_t)w->sample_count;
  w->group_count++;
}

static void write_marks(const stack *s, const block *b, uint64_t marks, writer *w) {
  const fum_lattice_face *grid = &s->lattice->faces[b->face];
  const int64_t at = b->word - s->marks->firsts[b->face], across = fum_blocks_across(grid);
  const int64_t first = grid->first + at / across * 8 * grid->columns + at % across * 8;
  if (w->samples == NULL) {
    w->sample_count += __builtin_popcountll(marks);
    return;
  }
  for (; marks != 0; marks &= marks - 1) {
    const int bit = __builtin_ctzll(marks);
    w->samples[w->sample_count++] = (uint32_t)(first + bit / 8 * grid->columns + bit % 8);
  }
}

/* Makes one group of what is marked in a part of the blocks, or two of its halves, where that are too many. */
static void group_part(const stack *s, const block *blocks, int64_t count, uint64_t part, writer *w) {
  const uint64_t rows = UINT64_C(0x00000000ffffffff), columns = UINT64_C(0x0f0f0f0f0f0f0f0f);
  int64_t marked = 0, in_group = FUM_GROUP_SIZE;
  for (int64_t k = 0; k < count; k++)
    marked += __builtin_popcountll(s->marks->words[blocks[k].word] & part);
  if (marked > FUM_GROUP_SIZE && __builtin_popcountll(part) > 16) {
    const uint64_t half = (part & rows) != part && (part & rows) != 0 ? rows : columns;
    group_part(s, blocks, count, part & half, w);
    group_part(s, blocks, count, part & ~half, w);
    return;
  }
  for (int64_t k = 0; k < count; k++) {
    const uint64_t marks = s->marks->words[blocks[k].word] & part;
    const int n = __builtin_popcountll(marks);
    if (n == 0) continue;
    if (in_group + n > FUM_GROUP_SIZE) {
      begin_group(w);
      in_group = 0;
    }
    in_group += n;
    write_marks(s, &blocks[k], marks, w);
  }
}

static void group_stack(const stack *s, writer *w) {
  sort_blocks(s);
  for (int64_t k = 0; k < s->cell_count; k++)
    group_part(s, s->blocks + s->cells[k], s->cells[k + 1] - s->cells[k], ~UINT64_C(0), w);
}

/* Room for the largest stack, for each thread. */
typedef struct room {
  int64_t most_cells, most_blocks;
  int64_t *cells;
  block *blocks;
} room;

static int32_t begin_room(fum_context *context, const fum_marks *m, const fum_lattice *lattice, int64_t stacks,
                          room *out) {
  const char *what = "lattice of light";
  const int32_t threads = fum_thread_count(context);
  for (int64_t k = 0; k < stacks; k++) {
    const stack s = begin_stack(m, lattice, k, NULL, NULL);
    const int64_t blocks = m->firsts[s.end] - m->firsts[s.begin];
    out->most_cells = s.cell_count > out->most_cells ? s.cell_count : out->most_cells;
    out->most_blocks = blocks > out->most_blocks ? blocks : out->most_blocks;
  }
  const int32_t status = fum_alloc(context, threads * (out->most_cells + 1), sizeof *out->cells, what, &out->cells);
  return status == FUM_OK ? fum_alloc(context, threads * out->most_blocks, sizeof *out->blocks, what, &out->blocks)
                          : status;
}

static void group_all(fum_context *context, const fum_marks *m, const fum_lattice *lattice, const room *r,
                      int64_t stacks, writer *writers) {
#pragma omp parallel for num_threads(fum_thread_count(context)) schedule(dynamic)
  for (int64_t k = 0; k < stacks; k++) {
    const int64_t thread = omp_get_thread_num();
    const stack s =
        begin_stack(m, lattice, k, r->cells + thread * (r->most_cells + 1), r->blocks + thread * r->most_blocks);
    group_stack(&s, &writers[k]);
  }
}

/* Gives each stack its places in the lists. */
static int32_t begin_writing(fum_context *context, int64_t stacks, writer *writers, fum_lattice *lattice) {
  const char *what = "lattice of light";
  writer all = {0};
  for (int64_t k = 0; k < stacks; k++) {
    const writer counted = writers[k];
    writers[k].sample_count = all.sample_count;
    writers[k].group_count = all.group_count;
    all.sample_count += counted.sample_count;
    all.group_count += counted.group_count;
  }
  lattice->lit_count = all.sample_count;
  lattice->group_count = all.group_count;
  int32_t status = fum_alloc(context, all.sample_count, sizeof *all.samples, what, &lattice->samples);
  if (status == FUM_OK)
    status = fum_alloc(context, all.group_count + 1, sizeof *all.begins, what, &lattice->group_begins);
  if (status != FUM_OK) return status;
  lattice->group_begins[all.group_count] = (uint32_t)all.sample_count;
  for (int64_t k = 0; k < stacks; k++) {
    writers[k].samples = lattice->samples;
    writers[k].begins = lattice->group_begins;
  }
  return FUM_OK;
}

int32_t fum_lattice_group(fum_context *context, const fum_marks *m, fum_lattice *lattice) {
  const int64_t stacks = (lattice->face_count + DEEP - 1) / DEEP;
  writer *writers = NULL;
  room r = {0};
  int32_t status = begin_room(context, m, lattice, stacks, &r);
  if (status == FUM_OK) status = fum_alloc(context, stacks, sizeof *writers, "lattice of light", &writers);
  if (status == FUM_OK) {
    group_all(context, m, lattice, &r, stacks, writers);
    status = begin_writing(context, stacks, writers, lattice);
  }
  if (status == FUM_OK) group_all(context, m, lattice, &r, stacks, writers);
  fum_free(context, &writers);
  fum_free(context, &r.blocks);
  fum_free(context, &r.cells);
  return status;
}
