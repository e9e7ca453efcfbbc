/* SPDX-License-Identifier: GPL-3.0-or-later */
#include "octree/pile.h"

#include <string.h>

/* Keys up to which insertion beats dealing. */
enum { SHORT_RUN = 48, MOST_DIGIT_BITS = 10 };

/* Words hold the number of a particle in their lower half, bits of its code in the upper one. Numbers break ties. */
static bool is_before(const uint64_t *codes, uint64_t a, uint64_t b) {
  if (a >> 32 != b >> 32) return a < b;
  const uint64_t code_a = codes[(uint32_t)a], code_b = codes[(uint32_t)b];
  return code_a != code_b ? code_a < code_b : a < b;
}

static void insert(const uint64_t *codes, int64_t count, uint64_t *words) {
  for (int64_t i = 1; i < count; i++) {
    const uint64_t word = words[i];
    int64_t at = i;
    for (; at > 0 && is_before(codes, word, words[at - 1]); at--)
      words[at] = words[at - 1];
    words[at] = word;
  }
}

/* Sorts by the highest 2 * bits bits. */
static void sort_digits(int64_t count, int bits, uint64_t *words, uint64_t *spare) {
  uint32_t next[2][1 << MOST_DIGIT_BITS] = {{0}}, sums[2] = {0};
  const uint32_t mask = (1U << bits) - 1;
  const int low = 64 - 2 * bits, high = 64 - bits;
  for (int64_t i = 0; i < count; i++) {
    next[0][(words[i] >> low) & mask]++;
    next[1][words[i] >> high]++;
  }
  for (uint32_t k = 0; k <= mask; k++) {
    for (int digit = 0; digit < 2; digit++) {
      const uint32_t n = next[digit][k];
      next[digit][k] = sums[digit];
      sums[digit] += n;
    }
  }
  for (int64_t i = 0; i < count; i++)
    spare[next[0][(words[i] >> low) & mask]++] = words[i];
  for (int64_t i = 0; i < count; i++)
    words[next[1][spare[i] >> high]++] = spare[i];
}

/* Sorts words whose lower halves ascend; their upper halves are filled in with the first bits in which codes differ. */
static void sort_words(const uint64_t *codes, int64_t count, uint64_t *words, uint64_t *spare) {
  uint64_t differences = 0;
  for (int64_t i = 0; i < count; i++)
    differences |= codes[(uint32_t)words[i]] ^ codes[(uint32_t)words[0]];
  if (differences == 0) return;
  const int same = __builtin_clzll(differences);
  for (int64_t i = 0; i < count; i++)
    words[i] = (codes[(uint32_t)words[i]] << same >> 32 << 32) | (uint32_t)words[i];
  if (count <= SHORT_RUN) {
    insert(codes, count, words);
    return;
  }
  /* A few more cells than particles: most are alone then. */
  const int wanted = (63 - __builtin_clzll((uint64_t)count) + 5) / 2;
  const int bits = wanted < MOST_DIGIT_BITS ? wanted : MOST_DIGIT_BITS, shift = 64 - 2 * bits;
  sort_digits(count, bits, words, spare);
  for (int64_t begin = 0, end; begin < count; begin = end) {
    for (end = begin + 1; end < count && words[end] >> shift == words[begin] >> shift;)
      end++;
    if (end - begin <= SHORT_RUN) {
      insert(codes, end - begin, words + begin);
    } else {
      sort_words(codes, end - begin, words + begin, spare);
    }
  }
}

/* Puts values of 4 bytes each, whatever they are, in the order of numbers. */
static void arrange(int64_t count, const uint32_t *restrict numbers, void *restrict spare, void *restrict values) {
  enum { SIZE = 4 };
  for (int64_t i = 0; i < count; i++)
    memcpy((char *)spare + SIZE * i, (const char *)values + SIZE * (size_t)numbers[i], SIZE);
  memcpy(values, spare, SIZE * (size_t)count);
}

void fum_pile_sort(const fum_cube *cube, int shift, int64_t begin, int64_t count, uint64_t *room, fum_octree *octree,
                   uint8_t *levels) {
  const float *places[3] = {octree->x + begin, octree->y + begin, octree->z + begin};
  uint64_t *codes = room, *words = room + count, *spare = words + count;
  fum_cube_find_codes(cube, shift, count, places, codes);
  for (int64_t i = 0; i < count; i++)
    words[i] = (uint64_t)i;
  sort_words(codes, count, words, spare);
  for (int64_t i = 1; i < count; i++)
    levels[begin + i] = fum_pile_level(codes[(uint32_t)words[i]] ^ codes[(uint32_t)words[i - 1]]);
  uint32_t *numbers = (uint32_t *)spare;
  for (int64_t i = 0; i < count; i++)
    numbers[i] = (uint32_t)words[i];
  arrange(count, numbers, codes, octree->indices + begin);
  arrange(count, numbers, codes, octree->x + begin);
  arrange(count, numbers, codes, octree->y + begin);
  arrange(count, numbers, codes, octree->z + begin);
  if (octree->inverse_sigmas == NULL) return;
  arrange(count, numbers, codes, octree->inverse_sigmas + begin);
  arrange(count, numbers, codes, octree->optical_depths + begin);
}
