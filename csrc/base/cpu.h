/* SPDX-License-Identifier: GPL-3.0-or-later */
/* Which of the compiled instruction sets to call. */
#ifndef FUM_BASE_CPU_H
#define FUM_BASE_CPU_H

typedef enum fum_cpu_level { FUM_CPU_PLAIN = 0, FUM_CPU_AVX2 = 1, FUM_CPU_AVX512 = 2 } fum_cpu_level;

/* The best level that this processor and this build have, or a lower one set by fum_cpu_limit. */
fum_cpu_level fum_cpu(void);

/* Lowers the level for the whole process; for tests. */
void fum_cpu_limit(fum_cpu_level level);

/* Of three versions of something, compiled for each level, the one to call. */
#if defined(__x86_64__)
#define FUM_CPU_CHOOSE(plain, avx2, avx512)                                                                            \
  (fum_cpu() == FUM_CPU_AVX512 ? (avx512) : fum_cpu() == FUM_CPU_AVX2 ? (avx2) : (plain))
#else
#define FUM_CPU_CHOOSE(plain, avx2, avx512) (plain)
#endif

const char *fum_cpu_name(fum_cpu_level level);

#endif
