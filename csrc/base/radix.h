/* SPDX-License-Identifier: GPL-3.0-or-later */
/* Stable parallel radix sort. */
#ifndef FUM_BASE_RADIX_H
#define FUM_BASE_RADIX_H

#include "base/context.h"

/* Sorts `keys` ascending by their bits [first_bit, 64) and carries `values` along (NULL: keys only). Equal keys keep
 * their order, so the result doesn't hang on the number of threads. */
int32_t fum_radix_sort(fum_context *context, int64_t count, int first_bit, uint64_t *keys, uint32_t *values);

#endif
