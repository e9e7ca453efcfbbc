/* SPDX-License-Identifier: GPL-3.0-or-later */
#include "base/radix.h"

#include <omp.h>
#include <string.h>

enum { DIGIT_BITS = 8, BUCKETS = 1 << DIGIT_BITS, CHECK_STRIDE = 1 << 18 };

typedef struct buffers {
  uint64_t *keys;
  uint32_t *values;
} buffers;

static int64_t block_begin(int64_t count, int block, int blocks) {
  return count * block / blocks;
}

/* True if all keys share the digit, so that the pass would move nothing. */
static bool is_uniform(int64_t count, int64_t counts[][BUCKETS], int blocks) {
  for (int bucket = 0; bucket < BUCKETS; bucket++) {
    int64_t sum = 0;
    for (int block = 0; block < blocks; block++)
      sum += counts[block][bucket];
    if (sum == count) return true;
  }
  return false;
}

static void counts_to_offsets(int64_t counts[][BUCKETS], int blocks) {
  int64_t offset = 0;
  for (int bucket = 0; bucket < BUCKETS; bucket++) {
    for (int block = 0; block < blocks; block++) {
      const int64_t n = counts[block][bucket];
      counts[block][bucket] = offset;
      offset += n;
    }
  }
}

/* One pass; returns false if nothing had to move. */
static bool sort_digit(fum_context *context, int64_t count, int shift, buffers from, buffers to,
                       int64_t counts[][BUCKETS], int blocks) {
#pragma omp parallel for num_threads(blocks) schedule(static, 1)
  for (int block = 0; block < blocks; block++) {
    int64_t *mine = counts[block];
    memset(mine, 0, sizeof counts[0]);
    const int64_t end = block_begin(count, block + 1, blocks);
    for (int64_t i = block_begin(count, block, blocks); i < end; i++)
      mine[(from.keys[i] >> shift) & (BUCKETS - 1)]++;
  }
  fum_progress_pulse(context);
  if (is_uniform(count, counts, blocks)) return false;
  counts_to_offsets(counts, blocks);
#pragma omp parallel for num_threads(blocks) schedule(static, 1)
  for (int block = 0; block < blocks; block++) {
    int64_t *offsets = counts[block];
    const int64_t end = block_begin(count, block + 1, blocks);
    for (int64_t i = block_begin(count, block, blocks); i < end; i++) {
      if (fum_progress_in_loop(context, i, CHECK_STRIDE)) break;
      const int64_t target = offsets[(from.keys[i] >> shift) & (BUCKETS - 1)]++;
      to.keys[target] = from.keys[i];
      if (from.values != NULL) to.values[target] = from.values[i];
    }
  }
  return true;
}

int32_t fum_radix_sort(fum_context *context, int64_t count, int first_bit, uint64_t *keys, uint32_t *values) {
  const int64_t serial_below = 1 << 14;
  const int blocks = count < serial_below ? 1 : fum_thread_count(context);
  buffers from = {keys, values}, to = {NULL, NULL};
  int64_t(*counts)[BUCKETS] = NULL;
  int32_t status = fum_alloc(context, blocks, sizeof *counts, "sort", &counts);
  if (status == FUM_OK) status = fum_alloc(context, count, sizeof *keys, "sort", &to.keys);
  if (status == FUM_OK && values != NULL) status = fum_alloc(context, count, sizeof *values, "sort", &to.values);
  buffers scratch = to;
  if (status != FUM_OK) goto done;
  for (int shift = first_bit; shift < 64; shift += DIGIT_BITS) {
    if (fum_is_cancelled(context)) break;
    if (!sort_digit(context, count, shift, from, to, counts, blocks)) continue;
    const buffers swap = from;
    from = to;
    to = swap;
  }
  if (fum_is_cancelled(context)) {
    status = FUM_ERROR_CANCELLED;
  } else if (from.keys != keys) {
    memcpy(keys, from.keys, (size_t)count * sizeof *keys);
    if (values != NULL) memcpy(values, from.values, (size_t)count * sizeof *values);
  }
done:
  fum_free(context, &scratch.values);
  fum_free(context, &scratch.keys);
  fum_free(context, &counts);
  return status;
}
