/* SPDX-License-Identifier: GPL-3.0-or-later */
/* Optical depth along one segment in double precision, by loops of its own: what the meter compares with. It shares the
 * octree with the exact solver, but neither its walk nor its sums. */
#ifndef FUM_LIGHTING_TRUTH_H
#define FUM_LIGHTING_TRUTH_H

#include "lighting/exact.h"

/* Of the octree's nodes, each [node_count], readable up to a child's seven siblings further. */
typedef struct fum_truth_nodes {
  double *middle[3], *half[3]; /* box of the centres */
  double *sigmas;              /* largest of the node's particles */
} fum_truth_nodes;

typedef struct fum_truth {
  const fum_octree *octree; /* borrowed */
  double sigma_scale, depth_scale;
  fum_truth_nodes nodes;
  double cutoff; /* a particle farther away than sqrt(2 cutoff) sigmas is left out */
} fum_truth;

/* The cutoff at which all that is left out of a segment adds up to less than `error` of its transmittance, whatever the
 * particles, if it ends at an optical depth of fum_truth_dark. */
double fum_truth_cutoff(const fum_medium *medium, double error);
double fum_truth_dark(double error);

/* Of the medium only what it consists of is used, none of its limits. */
int32_t fum_truth_begin(fum_context *context, const fum_medium *medium, double cutoff, fum_truth *out_truth);
void fum_truth_end(fum_context *context, fum_truth *truth);

/* Gives up as soon as it exceeds `limit`, and returns something larger then. */
double fum_truth_depth(const fum_truth *truth, const double from[3], const fum_emitter *emitter, double limit);

#endif
