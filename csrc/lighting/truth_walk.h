/* SPDX-License-Identifier: GPL-3.0-or-later */
/* The walk of fum_truth_depth, compiled for each instruction set. */
#ifndef FUM_LIGHTING_TRUTH_WALK_H
#define FUM_LIGHTING_TRUTH_WALK_H

#include "lighting/truth.h"

typedef struct fum_truth_segment {
  double start[3], direction[3]; /* of length 1 */
  double length;                 /* INFINITY towards a sun */
} fum_truth_segment;

typedef double (*fum_truth_walk)(const fum_truth *truth, const fum_truth_segment *segment, double limit);

double fum_truth_walk_plain(const fum_truth *truth, const fum_truth_segment *segment, double limit);
double fum_truth_walk_avx2(const fum_truth *truth, const fum_truth_segment *segment, double limit);
double fum_truth_walk_avx512(const fum_truth *truth, const fum_truth_segment *segment, double limit);

#endif
