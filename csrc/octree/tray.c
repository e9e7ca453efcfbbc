/* SPDX-License-Identifier: GPL-3.0-or-later */
#include "octree/tray.h"

#include "base/simd.h"

static const char *const WHAT = "density octree";

int32_t fum_trays_create(fum_context *context, int count, int32_t piles, uint32_t *next, fum_octree *octree,
                         fum_tray **out_trays) {
  fum_tray *trays = NULL;
  uint32_t *firsts = NULL;
  fum_record(*waiting)[FUM_TRAY_LINE] = NULL;
  const int64_t all = (int64_t)count * piles;
  int32_t status = fum_alloc(context, count, sizeof *trays, WHAT, &trays);
  if (status == FUM_OK) status = fum_alloc(context, all, sizeof *firsts, WHAT, &firsts);
  if (status == FUM_OK) status = fum_alloc(context, all, sizeof *waiting, WHAT, &waiting);
  if (status != FUM_OK) {
    fum_free(context, &firsts);
    fum_free(context, &trays);
    return status;
  }
  memcpy(firsts, next, (size_t)all * sizeof *firsts);
  for (int i = 0; i < count; i++) {
    const int64_t first = (int64_t)i * piles;
    trays[i] = (fum_tray){octree, piles, next + first, firsts + first, waiting + first};
  }
  *out_trays = trays;
  return FUM_OK;
}

void fum_trays_free(fum_context *context, fum_tray **trays) {
  if (*trays == NULL) return;
  fum_free(context, &(*trays)->waiting);
  fum_free(context, &(*trays)->firsts);
  fum_free(context, trays);
}

/* Four records as a vector of each of their fields. */
typedef struct columns {
  fum_quad x, y, z, inverse_sigmas, optical_depths, indices;
} columns;

static inline columns find_columns(const fum_record r[4]) {
  fum_quad head[4], tail[2];
  for (int i = 0; i < 4; i++)
    memcpy(&head[i], &r[i], sizeof *head);
  for (int i = 0; i < 4; i++)
    memcpy((float *)tail + 2 * i, &r[i].optical_depth, 2 * sizeof(float));
  fum_quad_transpose(head);
  return (columns){.x = head[0],
                   .y = head[1],
                   .z = head[2],
                   .inverse_sigmas = head[3],
                   .optical_depths = __builtin_shufflevector(tail[0], tail[1], 0, 2, 4, 6),
                   .indices = __builtin_shufflevector(tail[0], tail[1], 1, 3, 5, 7)};
}

static void write_line(const fum_record line[FUM_TRAY_LINE], uint32_t begin, fum_octree *octree) {
  for (uint32_t i = 0; i < FUM_TRAY_LINE; i += 4) {
    const columns c = find_columns(line + i);
    const size_t at = begin + i;
    fum_quad_stream(octree->indices + at, c.indices);
    fum_quad_stream(octree->x + at, c.x);
    fum_quad_stream(octree->y + at, c.y);
    fum_quad_stream(octree->z + at, c.z);
    if (octree->inverse_sigmas == NULL) continue;
    fum_quad_stream(octree->inverse_sigmas + at, c.inverse_sigmas);
    fum_quad_stream(octree->optical_depths + at, c.optical_depths);
  }
}

static void write_some(const fum_record line[FUM_TRAY_LINE], uint32_t begin, uint32_t end, fum_octree *octree) {
  for (uint32_t at = begin; at < end; at++) {
    const fum_record *r = &line[at % FUM_TRAY_LINE];
    octree->indices[at] = r->index;
    octree->x[at] = r->place[0];
    octree->y[at] = r->place[1];
    octree->z[at] = r->place[2];
    if (octree->inverse_sigmas == NULL) continue;
    octree->inverse_sigmas[at] = r->inverse_sigma;
    octree->optical_depths[at] = r->optical_depth;
  }
}

void fum_tray_write(const fum_tray *tray, uint32_t pile) {
  const uint32_t end = tray->next[pile], begin = end - FUM_TRAY_LINE, first = tray->firsts[pile];
  if (end >= first + FUM_TRAY_LINE) {
    write_line(tray->waiting[pile], begin, tray->octree);
  } else {
    write_some(tray->waiting[pile], first, end, tray->octree);
  }
}

void fum_tray_finish(const fum_tray *tray) {
  for (int32_t pile = 0; pile < tray->piles; pile++) {
    const uint32_t end = tray->next[pile], line = end - end % FUM_TRAY_LINE, first = tray->firsts[pile];
    write_some(tray->waiting[pile], line > first ? line : first, end, tray->octree);
  }
  fum_quad_stream_end();
}
