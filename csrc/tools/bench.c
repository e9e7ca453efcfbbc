/* SPDX-License-Identifier: GPL-3.0-or-later */
/* fumarole-bench: times and errors as JSON lines on standard output. */
#include "tools/bench.h"

#include <stdio.h>
#include <string.h>
#include <sys/resource.h>

int bench_fail(const fum_context *context) {
  fprintf(stderr, "fumarole-bench: %s\n", fum_last_error(context));
  return 1;
}

int bench_no_memory(void) {
  fprintf(stderr, "fumarole-bench: no memory for the picture\n");
  return 1;
}

double peak_rss_mb(void) {
  struct rusage usage;
  getrusage(RUSAGE_SELF, &usage);
  return (double)usage.ru_maxrss / 1024.0;
}

double processor_seconds(void) {
  struct rusage usage;
  getrusage(RUSAGE_SELF, &usage);
  return (double)(usage.ru_utime.tv_sec + usage.ru_stime.tv_sec) +
         1e-6 * (double)(usage.ru_utime.tv_usec + usage.ru_stime.tv_usec);
}

static int run(fum_context *context, const options *o, const cloud *c) {
  if (fum_context_set_threads(context, o->threads) != FUM_OK) return bench_fail(context);
  if (strcmp(o->command, "lighting") == 0) return bench_lighting(context, o, c);
  if (strcmp(o->command, "frame") == 0) return bench_frame(context, o, c);
  if (strcmp(o->command, "reference") == 0) return bench_reference(context, o, c);
  return bench_image(context, o, c);
}

int main(int argc, char **argv) {
  options o;
  int status = options_parse(argc, argv, &o);
  if (status != 0) return status == 1 ? 0 : status;
  char error[256] = "";
  cloud c = {0};
  status = o.file != NULL ? cloud_read_ply(o.file, &c, error)
                          : cloud_make(o.scene, o.particles, o.depth, o.overlap, &c, error);
  if (status != 0) {
    fprintf(stderr, "fumarole-bench: %s\n", error);
    return 1;
  }
  fum_context *context = NULL;
  status = fum_context_create(&context) == FUM_OK ? run(context, &o, &c) : bench_fail(NULL);
  fum_context_destroy(context);
  cloud_free(&c);
  return status;
}
