/* SPDX-License-Identifier: GPL-3.0-or-later */
#include "base/cpu.h"

#include <stdatomic.h>

static atomic_int limit = FUM_CPU_AVX512;

static fum_cpu_level supported(void) {
#if defined(__x86_64__)
  __builtin_cpu_init();
  if (__builtin_cpu_supports("avx512f") && __builtin_cpu_supports("avx512dq") && __builtin_cpu_supports("avx512vl") &&
      __builtin_cpu_supports("avx512bw")) {
    return FUM_CPU_AVX512;
  }
  if (__builtin_cpu_supports("avx2") && __builtin_cpu_supports("fma")) return FUM_CPU_AVX2;
#endif
  return FUM_CPU_PLAIN;
}

fum_cpu_level fum_cpu(void) {
  const int allowed = atomic_load(&limit);
  const fum_cpu_level best = supported();
  return (int)best < allowed ? best : (fum_cpu_level)allowed;
}

void fum_cpu_limit(fum_cpu_level level) {
  atomic_store(&limit, (int)level);
}

const char *fum_cpu_name(fum_cpu_level level) {
  switch (level) {
  case FUM_CPU_AVX512:
    return "AVX-512";
  case FUM_CPU_AVX2:
    return "AVX2";
  default:
    return "plain";
  }
}
