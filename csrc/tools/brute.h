/* SPDX-License-Identifier: GPL-3.0-or-later */
/* Double-precision brute force: what the solvers are measured against. Shares no code with them. */
#ifndef FUM_TOOLS_BRUTE_H
#define FUM_TOOLS_BRUTE_H

#include "tools/cloud.h"

/* Transmittance of the whole cloud between two points: every particle's closed-form optical depth, none left out. */
double brute_transmittance(const cloud *c, const double from[3], const double to[3]);

/* Errors of transmittances, in absolute units of transmittance. */
typedef struct error_summary {
  double rms, p95, worst;
} error_summary;

/* Sorts `errors` (absolute values) in place. */
error_summary summarize(int64_t count, double *errors);

#endif
