/* SPDX-License-Identifier: GPL-3.0-or-later */
#include "lighting/slabs.h"

#include "base/vector.h"

#include <string.h>

/* Smoke at some range, gathered from the leaves there. */
typedef struct bin {
  double mass;          /* optical depth times area: density (2 pi)^(3/2) sigma^3 */
  double inverse_sigma; /* root mean square over the mass, times mass */
  double thickness;     /* extinction times sigma, times mass */
  float lower[2], upper[2];
} bin;

enum { BINS = 2048 };

/* Particles as seen from the camera: a leaf's, or a single one. */
typedef struct seen {
  double range, radius; /* m; of a sphere around all their centres... */
  double reach;         /* ...and how far their smoke reaches out of it */
  double mass, inverse_square, extinction;
  double center[3]; /* camera space */
} seen;

/* What all leaves share. */
typedef struct scan {
  const fum_octree *octree;
  const fum_view *view;
  const fum_smears *smears; /* NULL: none */
  double thinnest;
  double frame_area; /* m^2 of the frame at unit range, in an orthographic view at any */
  double extent[2];
  seen *leaves; /* [node_count] of leaves */
  bin *bins;    /* NULL: only the extent is found */
} scan;

/* Box of all that is seen of the centres of particles that are smeared. Camera space. */
static void find_smeared_box(const scan *s, uint32_t begin, uint32_t count, double lower[3], double upper[3]) {
  for (int axis = 0; axis < 3; axis++) {
    lower[axis] = INFINITY;
    upper[axis] = -INFINITY;
  }
  for (uint32_t i = begin; i < begin + count; i++) {
    const fum_smear *smear = &s->smears->items[i];
    const double slope = s->smears->confusion_per_depth, path = 0.5 * fabs((double)smear->path[2]);
    const double confusion = s->smears->extent * (fabs((double)smear->confusion) + slope * path);
    for (int axis = 0; axis < 3; axis++) {
      const double around = 0.5 * fabs((double)smear->path[axis]) + (axis < 2 ? confusion : 0.0);
      lower[axis] = fum_least(lower[axis], (double)smear->center[axis] - around);
      upper[axis] = fum_most(upper[axis], (double)smear->center[axis] + around);
    }
  }
}

static void see(const scan *s, uint32_t begin, uint32_t count, const double lower[3], const double upper[3],
                seen *out) {
  const fum_octree *octree = s->octree;
  double middle[3], volume = 1.0, squared = 0.0, mean_sigma = 0.0, smeared[2][3];
  *out = (seen){0};
  if (s->smears != NULL) {
    find_smeared_box(s, begin, count, smeared[0], smeared[1]);
    lower = smeared[0];
    upper = smeared[1];
  }
  for (uint32_t i = begin; i < begin + count; i++) {
    const double inverse = (double)octree->inverse_sigmas[i], sigma = 1.0 / inverse;
    const double mass = fum_most((double)octree->optical_depths[i], s->thinnest) * 2.0 * FUM_PI * sigma * sigma;
    mean_sigma += sigma;
    if (!(mass > 0.0)) continue;
    out->mass += mass;
    out->inverse_square += mass * inverse * inverse;
    out->reach = fum_most(out->reach, sigma * fum_footprint(FUM_REACH_SIGMAS, (double)octree->optical_depths[i]));
  }
  for (int axis = 0; axis < 3; axis++) {
    const double side = upper[axis] - lower[axis];
    middle[axis] = 0.5 * (upper[axis] + lower[axis]);
    squared += 0.25 * side * side;
    /* A single Gaussian fills sqrt(2 pi) sigma along each axis at its peak extinction. */
    volume *= side + FUM_SQRT_2PI * mean_sigma / count;
  }
  if (s->smears != NULL) {
    memcpy(out->center, middle, sizeof middle);
  } else {
    fum_transform_point(s->view->camera_from_local, middle, out->center);
  }
  const double *c = out->center;
  out->range = s->view->type == FUM_CAMERA_PERSPECTIVE ? sqrt(c[0] * c[0] + c[1] * c[1] + c[2] * c[2]) : -c[2];
  out->radius = sqrt(squared);
  out->extinction = out->mass / volume;
}

static void fill_bins(scan *s, const seen *of, double reach, const float lower[2], const float upper[2]) {
  const double bins_per_metre = BINS / (s->extent[1] - s->extent[0]);
  const double from = fmax(of->range - reach, s->extent[0]), to = fmin(of->range + reach, s->extent[1]);
  if (!(from < to)) return;
  const int first = (int)fmin(BINS - 1, fmax(0.0, (from - s->extent[0]) * bins_per_metre));
  const int last = (int)fmin(BINS - 1, fmax(0.0, (to - s->extent[0]) * bins_per_metre));
  /* Only what is in the frame counts: a fog around the scene must not outweigh the scene. */
  const double distance = s->view->type == FUM_CAMERA_PERSPECTIVE ? 0.5 * (from + to) : 1.0;
  const double area = fmin(1.0, s->frame_area * distance * distance / (4.0 * reach * reach));
  const double share = area * (to - from) / (2.0 * reach) / (last - first + 1),
               sigma = sqrt(of->mass / of->inverse_square);
  const double mass = of->mass * share, inverse = of->inverse_square * share, thickness = mass * of->extinction * sigma;
  for (bin *b = s->bins + first; b <= s->bins + last; b++) {
    b->mass += mass;
    b->inverse_sigma += inverse;
    b->thickness += thickness;
    for (int axis = 0; axis < 2; axis++) {
      b->lower[axis] = fum_min(b->lower[axis], lower[axis]);
      b->upper[axis] = fum_max(b->upper[axis], upper[axis]);
    }
  }
}

/* Takes in what is between the sides of the frame and in front of the camera. */
static void take(scan *s, const seen *of) {
  const double reach = of->radius + of->reach;
  float lower[2], upper[2];
  if (!(of->mass > 0.0) || -of->center[2] + reach < s->view->clip_start) return;
  fum_view_cover(s->view, of->center, reach, lower, upper);
  if (lower[0] >= upper[0] || lower[1] >= upper[1]) return;
  if (s->bins != NULL) {
    fill_bins(s, of, reach, lower, upper);
    return;
  }
  s->extent[0] = fmin(s->extent[0], of->range - reach);
  s->extent[1] = fmax(s->extent[1], of->range + reach);
}

static void see_leaf(const scan *s, const fum_octree_node *node, seen *out) {
  double lower[3], upper[3];
  for (int axis = 0; axis < 3; axis++) {
    lower[axis] = (double)node->lower[axis];
    upper[axis] = (double)node->upper[axis];
  }
  see(s, node->begin, node->count, lower, upper, out);
}

static int32_t see_leaves(fum_context *context, scan *s) {
  const fum_octree *octree = s->octree;
  const int32_t status = fum_alloc(context, octree->node_count, sizeof *s->leaves, "slabs", &s->leaves);
  if (status != FUM_OK) return status;
#pragma omp parallel for num_threads(fum_thread_count(context)) schedule(static)
  for (int64_t n = 0; n < octree->node_count; n++) {
    if (octree->nodes[n].children == 0) see_leaf(s, &octree->nodes[n], &s->leaves[n]);
  }
  return FUM_OK;
}

/* Goes through leaves; those that are large against their particles, particle by particle. */
static void scan_leaves(scan *s, int64_t begin, int64_t end) {
  const double sparse = 8.0;
  for (int64_t n = begin; n < end; n++) {
    const fum_octree_node *node = &s->octree->nodes[n];
    const seen *leaf = &s->leaves[n];
    if (node->children != 0) continue;
    if (leaf->radius * leaf->radius * leaf->inverse_square <= sparse * sparse * leaf->mass) {
      take(s, leaf);
      continue;
    }
    for (uint32_t i = node->begin; i < node->begin + node->count; i++) {
      const double at[3] = {(double)s->octree->x[i], (double)s->octree->y[i], (double)s->octree->z[i]};
      seen of;
      see(s, i, 1, at, at, &of);
      take(s, &of);
    }
  }
}

/* Leaves are gone through in so many parts, whatever the number of threads: sums must not depend on it. */
enum { PARTS = 16 };

/* `bins`: [PARTS][BINS], NULL where only the extents are looked for; `extents`: NULL once they are known. */
static void scan_parts(fum_context *context, const scan *s, bin *bins, double extents[PARTS][2]) {
  const int64_t nodes = s->octree->node_count;
#pragma omp parallel for num_threads(fum_thread_count(context)) schedule(dynamic)
  for (int part = 0; part < PARTS; part++) {
    scan of = *s;
    of.bins = bins != NULL ? bins + part * BINS : NULL;
    scan_leaves(&of, nodes * part / PARTS, nodes * (part + 1) / PARTS);
    if (extents != NULL) memcpy(extents[part], of.extent, sizeof of.extent);
  }
}

/* Adds the bins of all parts to the first ones'. */
static void add_parts(bin *bins) {
  for (int k = BINS; k < PARTS * BINS; k++) {
    bin *sum = &bins[k % BINS];
    sum->mass += bins[k].mass;
    sum->inverse_sigma += bins[k].inverse_sigma;
    sum->thickness += bins[k].thickness;
    for (int axis = 0; axis < 2; axis++) {
      sum->lower[axis] = fum_min(sum->lower[axis], bins[k].lower[axis]);
      sum->upper[axis] = fum_max(sum->upper[axis], bins[k].upper[axis]);
    }
  }
}

/* Longest (u, v, -1) of the frame. */
static double longest_ray(const fum_view *view) {
  if (view->type != FUM_CAMERA_PERSPECTIVE) return 1.0;
  const double *w = view->window;
  return hypot(1.0, hypot(fmax(fabs(w[0]), fabs(w[1])), fmax(fabs(w[2]), fabs(w[3]))));
}

static void find_extent(fum_context *context, scan *s) {
  double extents[PARTS][2];
  s->extent[0] = INFINITY;
  s->extent[1] = -INFINITY;
  scan_parts(context, s, NULL, extents);
  for (int part = 0; part < PARTS; part++) {
    s->extent[0] = fmin(s->extent[0], extents[part][0]);
    s->extent[1] = fmax(s->extent[1], extents[part][1]);
  }
  s->extent[0] = fmax(s->extent[0], s->view->clip_start);
  s->extent[1] = fmin(s->extent[1], s->view->clip_end * longest_ray(s->view));
}

/* Steps in sigmas that keep the error of the picture below the tolerance, fitted to measurements against brute force
 * (docs/ACCURACY.md). Slabs, with light and extinction bent inside of them: 1.2 % sqrt(K sigma) step^4. Light sampled
 * on a square lattice with splines through it: 1.05 % (K sigma)^(2/3) step^5, above K sigma = 1 with its root. Wide
 * steps lose less than that, for Gaussians have little detail left there: by 1 / (1 + (step / 2)^6), which is nearly
 * what the transfer functions of B-splines say of their spectrum. Each gets half of the tolerance. */
static double slab_step(double thickness, double tolerance) {
  return fmin(2.0, fmax(0.06, sqrt(sqrt(0.5 * tolerance / (0.012 * sqrt(thickness))))));
}

static double light_step(double thickness, double tolerance) {
  const double unit = 0.0105 * fmin(sqrt(thickness), cbrt(thickness * thickness));
  const double step = pow(0.5 * tolerance / unit, 0.2);
  return fmin(2.0, fmax(0.10, step + 0.004 * pow(step, 7.0))); /* solved for the step, about */
}

static double thickness_of(const bin *b) {
  return fmax(1e-6, b->thickness / b->mass);
}

static double sigma_of(const bin *b) {
  return sqrt(b->mass / b->inverse_sigma);
}

static fum_face make_face(const bin *b, double range, double light_tolerance) {
  fum_face face = {.range = (float)range, .lower = {INFINITY, INFINITY}, .upper = {-INFINITY, -INFINITY}};
  if (!(b->mass > 0.0)) return face;
  face.spacing = (float)(light_step(thickness_of(b), light_tolerance) * sigma_of(b));
  for (int axis = 0; axis < 2; axis++) {
    face.lower[axis] = b->lower[axis];
    face.upper[axis] = b->upper[axis];
  }
  return face;
}

/* Slabs a metre in every bin. Where the view begins amid smoke, nothing in front hides what the first slabs are off by:
 * they are half as long. When slabs would be too many, all are stretched alike. */
static void find_frequencies(const bin *bins, double metres_per_bin, bool begins_in_smoke, double tolerance,
                             double *out) {
  double wanted = 0.0;
  for (int b = 0; b < BINS; b++) {
    out[b] = bins[b].mass > 0.0 ? 1.0 / (slab_step(thickness_of(&bins[b]), tolerance) * sigma_of(&bins[b])) : 0.0;
    if (begins_in_smoke && b * metres_per_bin * out[b] < 1.0) out[b] *= 2.0;
    wanted += out[b] * metres_per_bin;
  }
  const double most = FUM_MAX_SLABS - BINS; /* the rest is for the ends of gaps */
  for (int b = 0; b < BINS && wanted > most; b++)
    out[b] *= most / wanted;
}

/* The next face behind `range`: a slab away, or where a gap begins or ends. */
static double next_range(const double *frequencies, double start, double metres_per_bin, double range) {
  int b = (int)fmin(BINS - 1, fmax(0.0, (range - start) / metres_per_bin));
  double left = 1.0;
  if (!(frequencies[b] > 0.0)) {
    while (b < BINS && !(frequencies[b] > 0.0))
      b++;
    return start + b * metres_per_bin;
  }
  for (; b < BINS && frequencies[b] > 0.0; b++) {
    const double end = start + (b + 1) * metres_per_bin, slabs = fmax(0.0, end - range) * frequencies[b];
    if (slabs >= left) return range + left / frequencies[b];
    left -= slabs;
    range = fmax(range, end);
  }
  return range;
}

static int32_t place_faces(const bin *bins, const double extent[2], bool begins_in_smoke, float tolerance,
                           float light_tolerance, double *frequencies, fum_face *faces) {
  const double metres_per_bin = (extent[1] - extent[0]) / BINS;
  double range = extent[0];
  int32_t count = 0;
  find_frequencies(bins, metres_per_bin, begins_in_smoke, (double)tolerance, frequencies);
  while (range < extent[1] && count < FUM_MAX_SLABS) {
    const int b = (int)fmin(BINS - 1, fmax(0.0, (range - extent[0]) / metres_per_bin));
    faces[count] = make_face(&bins[b], range, (double)light_tolerance);
    /* Ranges are held in single precision: no two faces may fall together. */
    range = fmax(next_range(frequencies, extent[0], metres_per_bin, range),
                 (double)nextafterf(faces[count].range, INFINITY));
    count++;
  }
  faces[count] = (fum_face){(float)fmax(range, extent[1]), 0.0F, {INFINITY, INFINITY}, {-INFINITY, -INFINITY}};
  return count;
}

static double mean_thickness(const bin *bins) {
  double thickness = 0.0, mass = 0.0;
  for (int b = 0; b < BINS; b++) {
    thickness += bins[b].thickness;
    mass += bins[b].mass;
  }
  return mass > 0.0 ? thickness / mass : 0.0;
}

static double whole_depth(const scan *s) {
  const fum_octree_node *root = &s->octree->nodes[0];
  double mass = 0.0, inverse_square = 0.0, sides[3], area = INFINITY;
  for (int64_t n = 0; n < s->octree->node_count; n++) {
    if (s->octree->nodes[n].children != 0) continue;
    mass += s->leaves[n].mass;
    inverse_square += s->leaves[n].inverse_square;
  }
  for (int axis = 0; axis < 3; axis++)
    sides[axis] = (double)root->upper[axis] - (double)root->lower[axis];
  for (int axis = 0; axis < 3; axis++)
    area = fmin(area, 0.25 * FUM_PI * sides[axis] * sides[(axis + 1) % 3]);
  return mass > 0.0 ? mass / (area + 2.0 * FUM_PI * mass / inverse_square) : 0.0;
}

static void find_starts(const double extent[2], fum_slabs *slabs) {
  slabs->starts_per_metre = FUM_SLAB_STARTS / (extent[1] - extent[0]);
  int32_t slab = 0;
  for (int32_t k = 0; k < FUM_SLAB_STARTS; k++) {
    /* A little before, for rounding: the search goes on from there. */
    const double range = (double)slabs->faces[0].range + ((double)k - 0.01) / slabs->starts_per_metre;
    while (slab + 1 < slabs->count && (double)slabs->faces[slab + 1].range <= range)
      slab++;
    slabs->starts[k] = (uint16_t)slab;
  }
}

int32_t fum_slabs_find(fum_context *context, const fum_octree *octree, const fum_view *view, const fum_smears *smears,
                       float tolerance, float light_tolerance, float thinnest, fum_slabs *out_slabs) {
  bin *bins = NULL;
  fum_face *faces = NULL;
  double *frequencies = NULL;
  const double *w = view->window;
  scan s = {.octree = octree,
            .view = view,
            .smears = smears,
            .thinnest = (double)thinnest,
            .frame_area = (w[1] - w[0]) * (w[3] - w[2])};
  *out_slabs = (fum_slabs){0};
  int32_t status = see_leaves(context, &s);
  if (status != FUM_OK) goto done;
  find_extent(context, &s);
  if (!(s.extent[0] < s.extent[1])) goto done;
  status = fum_alloc(context, PARTS * BINS, sizeof *bins, "slabs", &bins);
  if (status == FUM_OK) status = fum_alloc(context, FUM_MAX_SLABS + 1, sizeof *faces, "slabs", &faces);
  if (status == FUM_OK) status = fum_alloc(context, BINS, sizeof *frequencies, "slabs", &frequencies);
  if (status != FUM_OK) goto done;
  for (int b = 0; b < PARTS * BINS; b++) {
    for (int axis = 0; axis < 2; axis++) {
      bins[b].lower[axis] = INFINITY;
      bins[b].upper[axis] = -INFINITY;
    }
  }
  scan_parts(context, &s, bins, NULL);
  add_parts(bins);
  out_slabs->count =
      place_faces(bins, s.extent, s.extent[0] <= view->clip_start, tolerance, light_tolerance, frequencies, faces);
  out_slabs->thickness = mean_thickness(bins);
  out_slabs->depth = whole_depth(&s);
  out_slabs->faces = faces;
  faces = NULL;
  find_starts(s.extent, out_slabs);
done:
  fum_free(context, &frequencies);
  fum_free(context, &faces);
  fum_free(context, &bins);
  fum_free(context, &s.leaves);
  return status;
}

void fum_slabs_free(fum_context *context, fum_slabs *slabs) {
  fum_free(context, &slabs->faces);
}
