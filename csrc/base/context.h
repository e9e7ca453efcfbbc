/* SPDX-License-Identifier: GPL-3.0-or-later */
/* What every step of a render shares: errors, warnings, threads, progress and memory. */
#ifndef FUM_BASE_CONTEXT_H
#define FUM_BASE_CONTEXT_H

#include "fumarole.h"

#include <omp.h>
#include <stdatomic.h>
#include <stdbool.h>

struct fum_gl;

struct fum_context {
  char error[1024];
  char **warnings;
  int32_t warning_count;
  int32_t threads; /* 0: all cores */
  fum_progress_fn progress;
  void *progress_user;
  double progress_last_s;
  int32_t progress_last_stage; /* -1: none yet in this call */
  float progress_last_fraction;
  char progress_last_message[96]; /* a copy: the caller's may be gone when it is said again */
  atomic_int cancelled;
  atomic_uint_least64_t memory_bytes, memory_peak_bytes;
  struct fum_gl *gl; /* owned by billboard/gl, made on the first draw */
};

/* Notes why the call fails and returns `code`, so that `return fum_fail(...)` reads as one step. */
int32_t fum_fail(fum_context *context, int32_t code, const char *format, ...) __attribute__((format(printf, 3, 4)));

/* Notes a warning once; the same text again is dropped. */
void fum_warn(fum_context *context, const char *format, ...) __attribute__((format(printf, 2, 3)));

/* Clears the cancel flag and the progress throttle at the start of a public call. */
void fum_progress_begin(fum_context *context);

/* Reports progress: each new stage or message, and at most 20 times a second within one. Only on the thread that called
 * the library. `message` (below 96 characters) is copied. Returns FUM_OK, or fails with FUM_ERROR_CANCELLED. */
int32_t fum_progress_report(fum_context *context, int32_t stage, float fraction, const char *message);

/* Reports the last progress again, so that the user can cancel in the middle of a long step. Only on the thread that
 * called the library. */
void fum_progress_pulse(fum_context *context);

/* True once the user has cancelled; for worker threads, which must not call fum_progress_report. */
static inline bool fum_is_cancelled(const fum_context *context) {
  return atomic_load_explicit(&context->cancelled, memory_order_relaxed) != 0;
}

/* In a loop over many items: a pulse at every `stride`-th (a power of two) of the calling thread. True if cancelled. */
static inline bool fum_progress_in_loop(fum_context *context, int64_t item, int64_t stride) {
  if ((item & (stride - 1)) == 0 && omp_get_thread_num() == 0) fum_progress_pulse(context);
  return fum_is_cancelled(context);
}

/* Threads to use. */
int32_t fum_thread_count(const fum_context *context);

/* Seconds of a monotonic clock. */
double fum_now_s(void);

/* Zeroed memory for `count` items of `size` bytes, 64-byte aligned, counted in the context. On failure *out is NULL
 * and the error names `what` and how much it needed. A count of 0 gives a valid pointer. */
int32_t fum_alloc(fum_context *context, int64_t count, size_t size, const char *what, void *out_pointer);

/* Frees what fum_alloc gave; NULL is allowed. `pointer` is the variable, which becomes NULL. */
void fum_free(fum_context *context, void *out_pointer);

/* A copy to be freed with free(), NULL without memory. Not strdup: a host may replace malloc, libc's own functions then
 * allocate with the host's, while a library loaded with RTLD_DEEPBIND frees with libc's. */
char *fum_copy_string(const char *text);

/* Bytes of memory the system can still give without swapping, or UINT64_MAX when unknown. */
uint64_t fum_memory_available(void);

#endif
