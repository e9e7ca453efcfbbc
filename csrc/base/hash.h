/* SPDX-License-Identifier: GPL-3.0-or-later */
/* Hashes that turn stable identities into stable random numbers. */
#ifndef FUM_BASE_HASH_H
#define FUM_BASE_HASH_H

#include <stdint.h>

/* Finaliser of SplitMix64 (Steele, Lea, Flood 2014, "Fast splittable pseudorandom number generators"). */
static inline uint64_t fum_hash64(uint64_t x) {
  x += 0x9e3779b97f4a7c15u;
  x = (x ^ (x >> 30)) * 0xbf58476d1ce4e5b9u;
  x = (x ^ (x >> 27)) * 0x94d049bb133111ebu;
  return x ^ (x >> 31);
}

/* Of a string: FNV-1a (Fowler, Noll, Vo). */
static inline uint64_t fum_hash_text(const char *text) {
  uint64_t hash = 0xcbf29ce484222325u;
  for (; *text != 0; text++)
    hash = (hash ^ (uint8_t)*text) * 0x100000001b3u;
  return fum_hash64(hash);
}

/* Uniform in [0, 1), 53 bits. */
static inline double fum_hash_unit(uint64_t x) {
  return (double)(fum_hash64(x) >> 11) * 0x1p-53;
}

#endif
