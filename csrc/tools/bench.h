/* SPDX-License-Identifier: GPL-3.0-or-later */
/* The commands of the benchmark. Each prints its rows and returns 0, or says why not and returns nonzero. */
#ifndef FUM_TOOLS_BENCH_H
#define FUM_TOOLS_BENCH_H

#include "tools/cloud.h"
#include "tools/options.h"

int bench_lighting(fum_context *context, const options *o, const cloud *c);
int bench_frame(fum_context *context, const options *o, const cloud *c);
int bench_reference(fum_context *context, const options *o, const cloud *c);
int bench_image(fum_context *context, const options *o, const cloud *c);

/* Says on standard error what failed last. Returns 1. */
int bench_fail(const fum_context *context);

/* The same where a picture's memory is missing. */
int bench_no_memory(void);

/* Parts of a row: what was asked for, and what the meter of the light's accuracy found. */
void print_settings(const fum_settings *settings);
void print_meter(const fum_render_stats *stats);

double peak_rss_mb(void);

/* Processor time of this program so far, over all its threads. */
double processor_seconds(void);

#endif
