/* SPDX-License-Identifier: GPL-3.0-or-later */
/* Slabs: the camera's view of the smoke cut by faces of equal range, close enough together that light and optical depth
 * run smoothly from one to the next. Range is the distance along a ray, in an orthographic view the depth. */
#ifndef FUM_LIGHTING_SLABS_H
#define FUM_LIGHTING_SLABS_H

#include "lighting/smears.h"

enum { FUM_MAX_SLABS = 4096, FUM_SLAB_STARTS = 1024 };

/* A face: where it is, how closely light must be sampled on it, and which part of it has smoke near. */
typedef struct fum_face {
  float range;    /* m */
  float spacing;  /* m between samples of light */
  float lower[2]; /* in the view's window: left and bottom... */
  float upper[2]; /* ...right and top of the smoke near this face; empty when lower > upper */
} fum_face;

typedef struct fum_slabs {
  int32_t count;    /* slabs; 0 when no smoke is in view */
  double thickness; /* extinction times sigma, mean over the smoke in view */
  double depth;    /* optical depth of all smoke where it is thickest, about: spread evenly over its smallest outline */
  bool has_holes;  /* the camera sees through some particles where these are thick */
  fum_face *faces; /* [count + 1], nearest first */
  double starts_per_metre;
  uint16_t starts[FUM_SLAB_STARTS]; /* slabs at even distances from face 0 on, where searches begin */
} fum_slabs;

/* Sigmas around a thin particle within which its smoke is looked at. */
static const double FUM_REACH_SIGMAS = 4.0;

/* The footprint, in sigmas, of a particle of this optical depth, when `sigmas` is that of a thin one: whatever it is,
 * the same optical depth lies outside. */
static inline double fum_footprint(double sigmas, double optical_depth) {
  if (!(optical_depth > 1.0)) return sigmas;
  return sqrt(sigmas * sigmas + 2.0 * log(optical_depth));
}

/* Of `tolerance`, a relative error of the picture, the steps of slabs may cause half, of `light_tolerance` the steps
 * between samples of light. `thinnest` is the optical depth that a particle counts at least (above 0 where it may glow
 * without absorbing). `smears`: particles are where these are; NULL: where they stand. */
int32_t fum_slabs_find(fum_context *context, const fum_octree *octree, const fum_view *view, const fum_smears *smears,
                       float tolerance, float light_tolerance, float thinnest, fum_slabs *out_slabs);
void fum_slabs_free(fum_context *context, fum_slabs *slabs);

/* Range of a face; beyond the first and the last one, as if the slabs there went on. */
static inline float fum_slabs_range(const fum_slabs *slabs, int32_t face) {
  const fum_face *f = slabs->faces;
  if (face < 0) return 2.0F * f[0].range - f[1].range;
  if (face > slabs->count) return 2.0F * f[slabs->count].range - f[slabs->count - 1].range;
  return f[face].range;
}

/* The slab that holds the range, the first or last one if none does. */
static inline int32_t fum_slab_at(const fum_slabs *slabs, double range) {
  const double start = (range - (double)slabs->faces[0].range) * slabs->starts_per_metre;
  int32_t slab = slabs->starts[!(start > 0.0) ? 0 : start < FUM_SLAB_STARTS ? (int32_t)start : FUM_SLAB_STARTS - 1];
  while (slab + 1 < slabs->count && (double)slabs->faces[slab + 1].range <= range)
    slab++;
  return slab;
}

#endif
