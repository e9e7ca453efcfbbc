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

void print_settings(const fum_settings *settings) {
  printf("\"tolerance\": %g, \"leaf\": %d, \"subsampling\": %g, ", (double)settings->tolerance, settings->leaf_size,
         (double)settings->subsampling);
}

void print_meter(const fum_render_stats *stats) {
  printf("\"light_points\": %lld, \"refinements\": %lld, \"accuracy_count\": %lld, \"accuracy_rms\": %.3g, "
         "\"accuracy_p95\": %.3g, \"accuracy_worst\": %.3g, \"accuracy_bias\": %.3g, \"meter_s\": %.4f, ",
         (long long)stats->light_points, (long long)stats->refinement_count, (long long)stats->accuracy_count,
         stats->accuracy_rms, stats->accuracy_p95, stats->accuracy_worst, stats->accuracy_bias, stats->meter_s);
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
  if (o.grow != 1.0 || o.dense != 1.0) cloud_scale(&c, o.grow, o.dense);
  fum_context *context = NULL;
  status = fum_context_create(&context) == FUM_OK ? run(context, &o, &c) : bench_fail(NULL);
  fum_context_destroy(context);
  cloud_free(&c);
  return status;
}
