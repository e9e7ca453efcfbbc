/* SPDX-License-Identifier: GPL-3.0-or-later */
#include "lighting/slabs.h"

#include "base/vector.h"

/* Smoke at some range, gathered from the leaves there. */
typedef struct bin {
  double mass;          /* optical depth times area: density (2 pi)^(3/2) sigma^3 */
  double inverse_sigma; /* root mean square over the mass, times mass */
  double thickness;     /* extinction times sigma, times mass */
  float lower[2], upper[2];
} bin;

enum { BINS = 2048, MAX_SLABS = 4096 };

/* A leaf as seen from the camera. */
typedef struct seen_leaf {
  double range, radius; /* m; of a sphere around all its particles' centres */
  double sigma_max, mass, inverse_square, extinction;
  double center[3]; /* camera space */
} seen_leaf;

static seen_leaf see_leaf(const fum_octree *octree, const fum_octree_node *node, const fum_view *view, float thinnest) {
  seen_leaf leaf = {0};
  double middle[3], volume = 1.0, squared = 0.0, mean_sigma = 0.0;
  for (uint32_t i = node->begin; i < node->begin + node->count; i++) {
    const double sigma = 1.0 / (double)octree->inverse_sigmas[i];
    const double mass = (double)fmaxf(octree->optical_depths[i], thinnest) * 2.0 * FUM_PI * sigma * sigma;
    leaf.mass += mass;
    leaf.inverse_square += mass / (sigma * sigma);
    leaf.sigma_max = fmax(leaf.sigma_max, sigma);
    mean_sigma += sigma / node->count;
  }
  for (int axis = 0; axis < 3; axis++) {
    const double side = (double)node->upper[axis] - (double)node->lower[axis];
    middle[axis] = 0.5 * ((double)node->upper[axis] + (double)node->lower[axis]);
    squared += 0.25 * side * side;
    /* A single Gaussian fills sqrt(2 pi) sigma along each axis at its peak extinction. */
    volume *= side + FUM_SQRT_2PI * mean_sigma;
  }
  fum_transform_point(view->camera_from_local, middle, leaf.center);
  const double *c = leaf.center;
  leaf.range = view->type == FUM_CAMERA_PERSPECTIVE ? sqrt(c[0] * c[0] + c[1] * c[1] + c[2] * c[2]) : -c[2];
  leaf.radius = sqrt(squared);
  leaf.extinction = leaf.mass / volume;
  return leaf;
}

/* Is a sphere of this radius between the sides of the frame and in front of the camera? */
static bool is_in_view(const fum_view *view, const seen_leaf *leaf, double radius) {
  if (-leaf->center[2] + radius < view->clip_start || leaf->range - radius > view->clip_end * 8.0) return false;
  float lower[2], upper[2];
  fum_view_cover(view, leaf->center, radius, lower, upper);
  return lower[0] < upper[0] && lower[1] < upper[1];
}

/* Sigmas around a particle within which it is looked at. */
static const double REACH_SIGMAS = 4.0;

static void find_extent(const fum_octree *octree, const fum_view *view, float thinnest, double extent[2]) {
  extent[0] = INFINITY;
  extent[1] = -INFINITY;
  for (int64_t n = 0; n < octree->node_count; n++) {
    if (octree->nodes[n].children != 0) continue;
    const seen_leaf leaf = see_leaf(octree, &octree->nodes[n], view, thinnest);
    const double reach = leaf.radius + REACH_SIGMAS * leaf.sigma_max;
    if (!(leaf.mass > 0.0) || !is_in_view(view, &leaf, reach)) continue;
    extent[0] = fmin(extent[0], leaf.range - reach);
    extent[1] = fmax(extent[1], leaf.range + reach);
  }
  extent[0] = fmax(extent[0], view->clip_start);
}

static void fill_bins(const fum_octree *octree, const fum_view *view, float thinnest, const double extent[2], bin *bins) {
  const double bins_per_metre = BINS / (extent[1] - extent[0]);
  for (int64_t n = 0; n < octree->node_count; n++) {
    if (octree->nodes[n].children != 0) continue;
    const seen_leaf leaf = see_leaf(octree, &octree->nodes[n], view, thinnest);
    const double reach = leaf.radius + REACH_SIGMAS * leaf.sigma_max;
    if (!(leaf.mass > 0.0) || !is_in_view(view, &leaf, reach)) continue;
    float lower[2], upper[2];
    fum_view_cover(view, leaf.center, reach, lower, upper);
    const int first = (int)fmin(BINS - 1, fmax(0.0, (leaf.range - reach - extent[0]) * bins_per_metre));
    const int last = (int)fmin(BINS - 1, fmax(0.0, (leaf.range + reach - extent[0]) * bins_per_metre));
    const double share = 1.0 / (last - first + 1), sigma = sqrt(leaf.mass / leaf.inverse_square);
    for (int b = first; b <= last; b++) {
      bins[b].mass += leaf.mass * share;
      bins[b].inverse_sigma += leaf.inverse_square * share;
      bins[b].thickness += leaf.mass * share * leaf.extinction * sigma;
      for (int axis = 0; axis < 2; axis++) {
        bins[b].lower[axis] = fminf(bins[b].lower[axis], lower[axis]);
        bins[b].upper[axis] = fmaxf(bins[b].upper[axis], upper[axis]);
      }
    }
  }
}

/* Steps in sigmas that keep the error of the picture below the tolerance, fitted to measurements against brute force
 * (docs/ACCURACY.md): 1.6 % sqrt(K sigma) step^2 for the slabs, 2 % sqrt(K sigma) step^3 for light sampled on a
 * square lattice and interpolated cubically. Each gets half of the tolerance. */
static double slab_step(double thickness, double tolerance) {
  return fmin(3.0, fmax(0.25, sqrt(0.5 * tolerance / (0.016 * sqrt(thickness)))));
}

static double light_step(double thickness, double tolerance) {
  return fmin(2.0, fmax(0.25, cbrt(0.5 * tolerance / (0.020 * sqrt(thickness)))));
}

static fum_face make_face(const bin *b, double range, double tolerance, double *out_step) {
  fum_face face = {.range = (float)range, .lower = {INFINITY, INFINITY}, .upper = {-INFINITY, -INFINITY}};
  if (!(b->mass > 0.0)) return face;
  const double sigma = sqrt(b->mass / b->inverse_sigma), thickness = fmax(1e-6, b->thickness / b->mass);
  *out_step = slab_step(thickness, tolerance) * sigma;
  face.spacing = (float)(light_step(thickness, tolerance) * sigma);
  for (int axis = 0; axis < 2; axis++) {
    face.lower[axis] = b->lower[axis];
    face.upper[axis] = b->upper[axis];
  }
  return face;
}

static int32_t place_faces(const bin *bins, const double extent[2], float tolerance, fum_face *faces) {
  const double metres_per_bin = (extent[1] - extent[0]) / BINS;
  double range = extent[0];
  int32_t count = 0;
  while (range < extent[1] && count < MAX_SLABS) {
    const int b = (int)fmin(BINS - 1, fmax(0.0, (range - extent[0]) / metres_per_bin));
    double step = metres_per_bin;
    faces[count++] = make_face(&bins[b], range, (double)tolerance, &step);
    range += fmax(step, (extent[1] - extent[0]) / (MAX_SLABS - 1));
    /* One slab for a stretch without smoke. */
    if (bins[b].mass > 0.0) continue;
    for (int next = b + 1; next < BINS && !(bins[next].mass > 0.0); next++) {
      range = extent[0] + (next + 1) * metres_per_bin;
    }
  }
  faces[count] = (fum_face){(float)fmax(range, extent[1]), 0.0F, {INFINITY, INFINITY}, {-INFINITY, -INFINITY}};
  return count;
}

int32_t fum_slabs_find(fum_context *context, const fum_octree *octree, const fum_view *view, float tolerance,
                       float thinnest, fum_slabs *out_slabs) {
  bin *bins = NULL;
  fum_face *faces = NULL;
  double extent[2];
  find_extent(octree, view, thinnest, extent);
  *out_slabs = (fum_slabs){0};
  if (!(extent[0] < extent[1])) return FUM_OK;
  int32_t status = fum_alloc(context, BINS, sizeof *bins, "slabs", &bins);
  if (status == FUM_OK) status = fum_alloc(context, MAX_SLABS + 1, sizeof *faces, "slabs", &faces);
  if (status != FUM_OK) goto done;
  for (int b = 0; b < BINS; b++) {
    for (int axis = 0; axis < 2; axis++) {
      bins[b].lower[axis] = INFINITY;
      bins[b].upper[axis] = -INFINITY;
    }
  }
  fill_bins(octree, view, thinnest, extent, bins);
  out_slabs->count = place_faces(bins, extent, tolerance, faces);
  out_slabs->faces = faces;
  faces = NULL;
done:
  fum_free(context, &faces);
  fum_free(context, &bins);
  return status;
}

void fum_slabs_free(fum_context *context, fum_slabs *slabs) { fum_free(context, &slabs->faces); }
