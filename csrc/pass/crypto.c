/* SPDX-License-Identifier: GPL-3.0-or-later */
#include "pass/crypto.h"

#include <string.h>

static uint32_t rotated(uint32_t x, int bits) {
  return x << bits | x >> (32 - bits);
}

static uint32_t scrambled(uint32_t block) {
  return rotated(block * 0xcc9e2d51U, 15) * 0x1b873593U;
}

/* MurmurHash3_x86_32 with seed 0 (Appleby, public domain). */
static uint32_t murmur3(const uint8_t *bytes, size_t count) {
  uint32_t hash = 0;
  const size_t whole = count / 4 * 4;
  for (size_t i = 0; i < whole; i += 4) {
    const uint32_t block =
        (uint32_t)bytes[i] | (uint32_t)bytes[i + 1] << 8 | (uint32_t)bytes[i + 2] << 16 | (uint32_t)bytes[i + 3] << 24;
    hash = rotated(hash ^ scrambled(block), 13) * 5 + 0xe6546b64U;
  }
  uint32_t rest = 0;
  for (size_t i = count; i > whole; i--)
    rest = rest << 8 | bytes[i - 1];
  hash ^= scrambled(rest) ^ (uint32_t)count;
  hash = (hash ^ hash >> 16) * 0x85ebca6bU;
  hash = (hash ^ hash >> 13) * 0xc2b2ae35U;
  return hash ^ hash >> 16;
}

uint32_t fum_crypto_hash(const char *name) {
  const uint32_t hash = murmur3((const uint8_t *)name, strlen(name)), exponent = hash >> 23 & 255;
  /* Denormal, infinite and NaN ids wouldn't survive. */
  return exponent == 0 || exponent == 255 ? hash ^ 1U << 23 : hash;
}

static float *place_at(float *const *pairs, int64_t pixel, int32_t rank) {
  return pairs[rank / 2] + 4 * pixel + rank % 2 * 2;
}

/* The rank that the id has, or the one after the last. */
static int32_t rank_of(uint32_t hash, int64_t pixel, int32_t ranks, float *const *pairs) {
  int32_t rank = 0;
  for (; rank < ranks; rank++) {
    uint32_t other;
    const float *place = place_at(pairs, pixel, rank);
    memcpy(&other, place, sizeof other);
    if (place[1] > 0.0F && other == hash) break;
  }
  return rank;
}

void fum_crypto_enter(uint32_t hash, int64_t pixel_count, const float *coverage, int32_t stride, float share,
                      int32_t pair_count, float *const *pairs) {
  float id;
  memcpy(&id, &hash, sizeof id);
  for (int64_t pixel = 0; pixel < pixel_count; pixel++) {
    float entry[2] = {id, share * coverage[pixel * stride]};
    if (!(entry[1] > 0.0F)) continue;
    const int32_t ranks = 2 * pair_count, held = rank_of(hash, pixel, ranks, pairs);
    if (held < ranks) entry[1] += place_at(pairs, pixel, held)[1];
    /* Those from the first that it covers more than on, down to its own place, step back. */
    for (int32_t rank = 0; rank < ranks; rank++) {
      float *place = place_at(pairs, pixel, rank);
      if (rank < held && !(entry[1] > place[1])) continue;
      const float pushed[2] = {place[0], place[1]};
      memcpy(place, entry, sizeof entry);
      memcpy(entry, pushed, sizeof entry);
      if (rank == held) break;
    }
  }
}
