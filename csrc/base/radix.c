/* SPDX-License-Identifier: GPL-3.0-or-later */
#include "base/radix.h"

#include <omp.h>
#include <string.h>

/* Passes over digits that together tell apart most keys; the few that they don't are sorted among themselves. */
enum { DIGIT_BITS = 11, BUCKETS = 1 << DIGIT_BITS, PASSES = 3, CHECK_STRIDE = 1 << 18 };

/* Keys up to which insertion beats a pass. */
enum { SHORT_RUN = 48 };

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

/* The highest bit in which keys differ, -1 if they are all the same. */
static int highest_difference(fum_context *context, int64_t count, const uint64_t *keys) {
  uint64_t differences = 0;
#pragma omp parallel for num_threads(fum_thread_count(context)) schedule(static) reduction(| : differences)
  for (int64_t i = 0; i < count; i++)
    differences |= keys[i] ^ keys[0];
  return differences != 0 ? 63 - __builtin_clzll(differences) : -1;
}

/* Sorts by bits [shift, shift + PASSES * DIGIT_BITS). */
static int32_t sort_digits(fum_context *context, int64_t count, int shift, uint64_t *keys, uint32_t *values) {
  const int64_t serial_below = 1 << 14;
  const int blocks = count < serial_below ? 1 : fum_thread_count(context);
  buffers from = {keys, values}, to = {NULL, NULL};
  int64_t(*counts)[BUCKETS] = NULL;
  int32_t status = fum_alloc(context, blocks, sizeof *counts, "sort", &counts);
  if (status == FUM_OK) status = fum_alloc(context, count, sizeof *keys, "sort", &to.keys);
  if (status == FUM_OK && values != NULL) status = fum_alloc(context, count, sizeof *values, "sort", &to.values);
  buffers scratch = to;
  if (status != FUM_OK) goto done;
  for (int pass = 0; pass < PASSES && shift < 64; pass++, shift += DIGIT_BITS) {
    if (fum_is_cancelled(context)) break;
    if (!sort_digit(context, count, shift, from, to, counts, blocks)) continue;
    const buffers swap = from;
    from = to;
    to = swap;
  }
  if (fum_is_cancelled(context)) {
    status = FUM_ERROR_CANCELLED;
  } else if (from.keys != keys) {
#pragma omp parallel for num_threads(blocks) schedule(static)
    for (int block = 0; block < blocks; block++) {
      const int64_t begin = block_begin(count, block, blocks), left = block_begin(count, block + 1, blocks) - begin;
      memcpy(keys + begin, from.keys + begin, (size_t)left * sizeof *keys);
      if (values != NULL) memcpy(values + begin, from.values + begin, (size_t)left * sizeof *values);
    }
  }
done:
  fum_free(context, &scratch.values);
  fum_free(context, &scratch.keys);
  fum_free(context, &counts);
  return status;
}

static void insert(int64_t count, int first_bit, uint64_t *keys, uint32_t *values) {
  for (int64_t i = 1; i < count; i++) {
    const uint64_t key = keys[i];
    const uint32_t value = values != NULL ? values[i] : 0;
    int64_t at = i;
    for (; at > 0 && keys[at - 1] >> first_bit > key >> first_bit; at--) {
      keys[at] = keys[at - 1];
      if (values != NULL) values[at] = values[at - 1];
    }
    keys[at] = key;
    if (values != NULL) values[at] = value;
  }
}

static int64_t run_end(int64_t begin, int64_t count, int shift, const uint64_t *keys) {
  int64_t end = begin + 1;
  while (end < count && keys[end] >> shift == keys[begin] >> shift)
    end++;
  return end;
}

/* Sorts the short ones of the runs from `begin` to `end`. True if there are long ones as well. */
static bool insert_short_runs(int64_t begin, int64_t end, int first_bit, int shift, uint64_t *keys, uint32_t *values) {
  bool has_long = false;
  for (int64_t next = begin; begin < end; begin = next) {
    next = run_end(begin, end, shift, keys);
    has_long = has_long || next - begin > SHORT_RUN;
    if (next - begin <= SHORT_RUN)
      insert(next - begin, first_bit, keys + begin, values != NULL ? values + begin : NULL);
  }
  return has_long;
}

/* Puts keys in order that agree in the bits from `shift` on. */
static int32_t sort_runs(fum_context *context, int64_t count, int first_bit, int shift, uint64_t *keys,
                         uint32_t *values) {
  enum { BLOCKS = 64 };
  int64_t begins[BLOCKS + 1] = {0};
  bool has_long = false;
  for (int block = 1; block <= BLOCKS; block++) {
    const int64_t at = block_begin(count, block, BLOCKS), last = at > begins[block - 1] ? at : begins[block - 1];
    begins[block] = last > 0 ? run_end(last - 1, count, shift, keys) : 0;
  }
#pragma omp parallel for num_threads(fum_thread_count(context)) schedule(static) reduction(|| : has_long)
  for (int block = 0; block < BLOCKS; block++)
    has_long |= insert_short_runs(begins[block], begins[block + 1], first_bit, shift, keys, values);
  int32_t status = FUM_OK;
  for (int64_t begin = 0, end = 0; has_long && begin < count && status == FUM_OK; begin = end) {
    end = run_end(begin, count, shift, keys);
    if (end - begin <= SHORT_RUN) continue;
    status = fum_radix_sort(context, end - begin, first_bit, keys + begin, values != NULL ? values + begin : NULL);
  }
  return status;
}

int32_t fum_radix_sort(fum_context *context, int64_t count, int first_bit, uint64_t *keys, uint32_t *values) {
  const int highest = highest_difference(context, count, keys), wanted = highest + 1 - PASSES * DIGIT_BITS;
  if (highest < first_bit) return FUM_OK;
  const int shift = wanted > first_bit ? wanted : first_bit;
  const int32_t status = sort_digits(context, count, shift, keys, values);
  return status == FUM_OK && shift > first_bit ? sort_runs(context, count, first_bit, shift, keys, values) : status;
}
