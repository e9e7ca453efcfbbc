/* SPDX-License-Identifier: GPL-3.0-or-later */
/* Receivers: the points that a solver lights, in spatial order and in groups of neighbours that share a beam. */
#ifndef FUM_LIGHTING_RECEIVERS_H
#define FUM_LIGHTING_RECEIVERS_H

#include "octree/octree.h"

enum { FUM_GROUP_SIZE = 64 };

typedef struct fum_receivers {
  const fum_octree *octree; /* borrowed: the points in Morton order */
  int64_t group_count;
  uint32_t *group_begins; /* [group_count + 1] at most FUM_GROUP_SIZE points each; NULL: not known yet */
} fum_receivers;

/* Finds the groups, unless they are known. */
int32_t fum_receivers_group(fum_context *context, fum_receivers *receivers);
void fum_receivers_free(fum_context *context, fum_receivers *receivers);

#endif
