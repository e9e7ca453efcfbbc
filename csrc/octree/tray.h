/* SPDX-License-Identifier: GPL-3.0-or-later */
/* Particles on their way into the piles of an octree. They wait until they fill a cache line of each of its arrays,
 * which is then written past the caches: memory sees whole lines, and a few pages at a time. */
#ifndef FUM_OCTREE_TRAY_H
#define FUM_OCTREE_TRAY_H

#include "octree/octree.h"

enum { FUM_TRAY_LINE = 16 };

/* What an octree has of a particle. */
typedef struct fum_record {
  float place[3];
  float inverse_sigma, optical_depth; /* not of points */
  uint32_t index;
} fum_record;

/* Of one thread. */
typedef struct fum_tray {
  fum_octree *octree;
  int32_t piles;
  uint32_t *next;                       /* [piles] where each pile continues */
  uint32_t *firsts;                     /* [piles] where it continued at first */
  fum_record (*waiting)[FUM_TRAY_LINE]; /* [piles] */
} fum_tray;

/* Trays that write to the places from next[tray][pile] on, [count][piles]. */
int32_t fum_trays_create(fum_context *context, int count, int32_t piles, uint32_t *next, fum_octree *octree,
                         fum_tray **out_trays);
void fum_trays_free(fum_context *context, fum_tray **trays);

/* Writes the line of a pile that ends before the place where it continues. */
void fum_tray_write(const fum_tray *tray, uint32_t pile);

/* Writes what still waits. */
void fum_tray_finish(const fum_tray *tray);

static inline void fum_tray_put(const fum_tray *tray, uint32_t pile, const fum_record *record) {
  const uint32_t at = tray->next[pile]++;
  tray->waiting[pile][at % FUM_TRAY_LINE] = *record;
  if (at % FUM_TRAY_LINE == FUM_TRAY_LINE - 1) fum_tray_write(tray, pile);
}

#endif
