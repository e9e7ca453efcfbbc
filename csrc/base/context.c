/* SPDX-License-Identifier: GPL-3.0-or-later */
#include "base/context.h"

#include <math.h>
#include <stdarg.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>
#include <time.h>

int32_t fum_fail(fum_context *context, int32_t code, const char *format, ...) {
  va_list arguments;
  va_start(arguments, format);
  vsnprintf(context->error, sizeof context->error, format, arguments);
  va_end(arguments);
  return code;
}

void fum_warn(fum_context *context, const char *format, ...) {
  char text[1024];
  va_list arguments;
  va_start(arguments, format);
  vsnprintf(text, sizeof text, format, arguments);
  va_end(arguments);
  for (int32_t i = 0; i < context->warning_count; i++) {
    if (strcmp(context->warnings[i], text) == 0) return;
  }
  char **grown = realloc(context->warnings, (size_t)(context->warning_count + 1) * sizeof *grown);
  if (grown == NULL) return;
  context->warnings = grown;
  char *copy = fum_copy_string(text);
  if (copy != NULL) context->warnings[context->warning_count++] = copy;
}

void fum_progress_begin(fum_context *context) {
  atomic_store(&context->cancelled, 0);
  context->progress_last_stage = -1;
}

int32_t fum_progress_report(fum_context *context, int32_t stage, float fraction, const char *message) {
  const double interval_s = 0.05;
  context->progress_last_fraction = fraction;
  const bool is_new_step =
      stage != context->progress_last_stage || strcmp(message, context->progress_last_message) != 0;
  if (message != context->progress_last_message)
    snprintf(context->progress_last_message, sizeof context->progress_last_message, "%s", message);
  if (context->progress != NULL && !atomic_load(&context->cancelled)) {
    const double now_s = fum_now_s();
    if (is_new_step || now_s - context->progress_last_s >= interval_s) {
      context->progress_last_stage = stage;
      context->progress_last_s = now_s;
      if (context->progress(context->progress_user, stage, fraction, message) != 0) {
        atomic_store(&context->cancelled, 1);
      }
    }
  }
  if (atomic_load(&context->cancelled)) return fum_fail(context, FUM_ERROR_CANCELLED, "the render was cancelled");
  return FUM_OK;
}

void fum_progress_pulse(fum_context *context) {
  if (context->progress_last_stage < 0) return;
  (void)fum_progress_report(context, context->progress_last_stage, context->progress_last_fraction,
                            context->progress_last_message);
}

int32_t fum_thread_count(const fum_context *context) {
  return context->threads > 0 ? context->threads : omp_get_num_procs();
}

double fum_now_s(void) {
  struct timespec now;
  clock_gettime(CLOCK_MONOTONIC, &now);
  return (double)now.tv_sec + 1e-9 * (double)now.tv_nsec;
}

char *fum_copy_string(const char *text) {
  const size_t size = strlen(text) + 1;
  char *copy = malloc(size);
  if (copy != NULL) memcpy(copy, text, size);
  return copy;
}

uint64_t fum_memory_available(void) {
  uint64_t available = UINT64_MAX;
  FILE *file = fopen("/proc/meminfo", "r");
  if (file == NULL) return available;
  char line[256];
  while (fgets(line, sizeof line, file) != NULL) {
    unsigned long long kib;
    if (sscanf(line, "MemAvailable: %llu kB", &kib) == 1) available = (uint64_t)kib * 1024;
  }
  fclose(file);
  return available;
}

/* In front of each block: where it starts and how large it is. */
typedef struct block_header {
  void *base;
  uint64_t bytes;
} block_header;

enum { ALIGNMENT = 64, LARGE_BYTES = 64 << 20 };

int32_t fum_alloc(fum_context *context, int64_t count, size_t size, const char *what, void *out_pointer) {
  void *base = NULL;
  uint64_t bytes;
  const bool overflows = count < 0 || __builtin_mul_overflow((uint64_t)count, (uint64_t)size, &bytes) ||
                         __builtin_add_overflow(bytes, (uint64_t)(2 * ALIGNMENT), &bytes);
  memcpy(out_pointer, &(void *){NULL}, sizeof(void *));
  /* calloc: the pages of a large block arrive zeroed when they are first touched, by the thread that needs them. */
  if (!overflows && (bytes < LARGE_BYTES || bytes < fum_memory_available())) base = calloc(1, bytes);
  if (base == NULL) {
    const double gib = 1024.0 * 1024.0 * 1024.0;
    return fum_fail(context, FUM_ERROR_MEMORY,
                    "%s: %lld entries need %.2f GiB of memory; %.2f GiB are free, enough for %.0f", what,
                    (long long)count, (double)count * (double)size / gib, (double)fum_memory_available() / gib,
                    floor((double)fum_memory_available() / (double)size));
  }
  char *pointer = (char *)base + sizeof(block_header);
  pointer += (ALIGNMENT - (uintptr_t)pointer % ALIGNMENT) % ALIGNMENT;
  const block_header header = {.base = base, .bytes = bytes};
  memcpy(pointer - sizeof header, &header, sizeof header);
  memcpy(out_pointer, &pointer, sizeof pointer);
  const uint64_t now = atomic_fetch_add(&context->memory_bytes, bytes) + bytes;
  uint64_t peak = atomic_load(&context->memory_peak_bytes);
  while (now > peak && !atomic_compare_exchange_weak(&context->memory_peak_bytes, &peak, now)) {
  }
  return FUM_OK;
}

void fum_free(fum_context *context, void *out_pointer) {
  char *pointer;
  memcpy(&pointer, out_pointer, sizeof pointer);
  if (pointer == NULL) return;
  block_header header;
  memcpy(&header, pointer - sizeof header, sizeof header);
  atomic_fetch_sub(&context->memory_bytes, header.bytes);
  free(header.base);
  memcpy(out_pointer, &(void *){NULL}, sizeof(void *));
}
