/* SPDX-License-Identifier: GPL-3.0-or-later */
#include "billboard/splat_sight.h"

#include "base/cpu.h"
#include "base/vector.h"
#include "billboard/dust.h"

void fum_sight_plain(const fum_sight *sight, int64_t begin, int32_t count, const fum_sight_out *out);
void fum_sight_avx2(const fum_sight *sight, int64_t begin, int32_t count, const fum_sight_out *out);
void fum_sight_avx512(const fum_sight *sight, int64_t begin, int32_t count, const fum_sight_out *out);

fum_sight_fn fum_sight_get(void) {
  return FUM_CPU_CHOOSE(fum_sight_plain, fum_sight_avx2, fum_sight_avx512);
}

void fum_sight_find(const fum_octree *octree, const fum_view *view, const fum_slabs *slabs,
                    const fum_splats_options *options, fum_sight *out) {
  *out = (fum_sight){.octree = octree, .view = view, .slabs = slabs, .options = options};
  out->pixels_per_unit[0] = (double)view->width / (view->window[1] - view->window[0]);
  out->pixels_per_unit[1] = (double)view->height / (view->window[3] - view->window[2]);
  out->pixel = 1.0 / fum_least(out->pixels_per_unit[0], out->pixels_per_unit[1]);
  for (int k = 0; k < FUM_SLAB_STARTS; k++)
    out->slab_starts[k] = (float)slabs->starts[k];
}

/* Square of an ellipse's short axis over the long one: of the cone around a sphere, with its axis at an angle to the
 * view's, cut by the picture. 0 where it is no ellipse. */
static double squared_aspect(const fum_splat *splat, double radius) {
  const double squared = (double)splat->range * (double)splat->range, depth = (double)splat->center[2];
  return fum_most(0.0, (depth * depth - radius * radius) / (squared - radius * radius));
}

/* The ellipsoid out to which a splat is drawn. */
typedef struct outline {
  double radii[2], longest; /* m; along the picture's sides */
  double lean;              /* 0..1, how far its outline lies along the box's diagonal by itself */
} outline;

/* Box around the outline, and the largest ellipse that it may be in it. */
static void find_outline(const fum_sight *sight, const outline *o, fum_splat *splat) {
  const fum_view *view = sight->view;
  const bool is_perspective = view->type == FUM_CAMERA_PERSPECTIVE;
  const int32_t sides[2] = {view->width, view->height};
  const double depth = -(double)splat->center[2];
  if (depth + o->longest <= view->clip_start || depth - o->longest >= view->clip_end) return;
  double middles[2], halves[2], aspect = is_perspective ? squared_aspect(splat, o->longest) : 1.0;
  for (int axis = 0; axis < 2; axis++) {
    const double center = (double)splat->center[axis], *edges = view->window + 2 * axis;
    double ends[2] = {center - o->radii[axis], center + o->radii[axis]};
    if (is_perspective) fum_find_slopes(center, depth, o->radii[axis], ends);
    const double per_unit = sight->pixels_per_unit[axis], beyond = FUM_SIGHT_BEYOND;
    const double first = fum_most((ends[0] - edges[0]) * per_unit - 0.5, -beyond);
    const double last = fum_least((ends[1] - edges[0]) * per_unit - 0.5, beyond);
    if ((last - first < 1.0 && ceil(first) > floor(last)) || last < 0.0 || first > (double)(sides[axis] - 1)) return;
    if (first == -beyond || last == beyond) aspect = 0.0;
    middles[axis] = 0.5 * (first + last);
    halves[axis] = 0.5 * (last - first);
  }
  for (int axis = 0; axis < 2; axis++) {
    splat->middle_px[axis] = (float)middles[axis];
    splat->half_px[axis] = (float)fum_most(halves[axis], 1e-3);
  }
  /* Its tips are farthest out when the long axis lies along the box's diagonal. */
  splat->rim = aspect > 0.0 ? (float)((1.0 + o->lean) * 2.0 / (1.0 + aspect)) : INFINITY;
}

static void find_slabs(const fum_slabs *slabs, float from, float to, fum_splat *s) {
  int32_t last = fum_slab_at(slabs, (double)from);
  s->first_slab = (uint16_t)last;
  while (last + 1 < slabs->count && slabs->faces[last + 1].range <= to)
    last++;
  s->last_slab = (uint16_t)last;
}

static void find_span(const fum_slabs *slabs, fum_splat *s) {
  const float bend = 0.5F * s->width * s->width * 16.0F / fum_max(s->range, s->width), reach = s->reach + bend;
  find_slabs(slabs, s->range - reach, s->range + reach, s);
}

/* A smeared particle's place in the picture. Over all instants and points of the lens the mean of what it hides stays
 * that of the particle; spread thinly, it adds up as that. */
static void smear_splat(const fum_sight *sight, const fum_smear *m, fum_splat *splat, fum_streak *streak) {
  const fum_smears *smears = sight->options->smears;
  const double width = (double)splat->width, radius = (double)splat->footprint * width;
  double box[2][2], ranges[2];
  if (!fum_streak_find(sight->view, smears, m, radius, FUM_SIGHT_BEYOND, box, streak)) return;
  for (int axis = 0; axis < 2; axis++) {
    splat->middle_px[axis] = (float)(0.5 * (box[axis][0] + box[axis][1]));
    splat->half_px[axis] = (float)fum_most(0.5 * (box[axis][1] - box[axis][0]), 1e-3);
  }
  splat->rim = INFINITY;
  fum_streak_ranges(sight->view, smears, m, (double)splat->reach, width, ranges);
  for (int k = 0; k < 2; k++)
    streak->ranges[k] = (float)ranges[k];
  find_slabs(sight->slabs, streak->ranges[0], streak->ranges[1], splat);
  const double share = fum_streak_share(sight->view, smears, m, width), depth = (double)splat->optical_depth;
  if (depth > 0.0) splat->optical_depth = (float)(fum_dust_widened(depth, sqrt(share)) / share);
}

/* Camera space. */
static void find_center(const fum_sight *sight, int64_t i, double out[3]) {
  const fum_octree *octree = sight->octree;
  if (sight->options->smears != NULL) {
    for (int axis = 0; axis < 3; axis++)
      out[axis] = (double)sight->options->smears->items[i].center[axis];
    return;
  }
  const double local[3] = {(double)octree->x[i], (double)octree->y[i], (double)octree->z[i]};
  fum_transform_point(sight->view->camera_from_local, local, out);
}

/* A bunch, which isn't round. */
static void stretch_splat(const fum_sight *sight, int64_t i, fum_splat *splat, fum_stretch *stretch) {
  const fum_stretched s = fum_stretch_find(sight->octree, i, sight->view, splat->center);
  double optical_depth = s.peak * (double)sight->octree->optical_depths[i];
  *stretch = s.of;
  splat->sigma = splat->width = (float)s.width;
  splat->footprint = (float)fum_footprints_end(&sight->options->footprints, &optical_depth);
  splat->optical_depth = (float)optical_depth;
  splat->reach = (float)(s.width * FUM_SIGHT_ALONG * (double)splat->footprint);
  const double footprint = (double)splat->footprint;
  const outline o = {.radii = {footprint * s.across[0], footprint * s.across[1]},
                     .longest = footprint * fum_most(s.across[0], s.across[1]),
                     .lean = s.lean};
  find_outline(sight, &o, splat);
  find_span(sight->slabs, splat);
}

fum_splat fum_sight_splat(const fum_sight *sight, int64_t i, fum_streak *out_streak, fum_stretch *out_stretch) {
  const fum_octree *octree = sight->octree;
  const fum_splats_options *o = sight->options;
  const bool is_perspective = sight->view->type == FUM_CAMERA_PERSPECTIVE;
  double c[3];
  find_center(sight, i, c);
  fum_splat splat = {.center = {(float)c[0], (float)c[1], (float)c[2]}, .self_shade = 1.0F};
  splat.range = (float)(is_perspective ? sqrt(c[0] * c[0] + c[1] * c[1] + c[2] * c[2]) : -c[2]);
  const double sigma = 1.0 / (double)octree->inverse_sigmas[i];
  if (fum_octree_members(octree, i) > 1) {
    stretch_splat(sight, i, &splat, out_stretch);
    return splat;
  }
  const double width =
      fum_most(sigma, FUM_MIN_SIGMA_PIXELS * sight->pixel * (is_perspective ? fum_most(-c[2], 0.0) : 1.0));
  double optical_depth = (double)fum_max(octree->optical_depths[i], o->thinnest);
  if (width > sigma) optical_depth = fum_dust_widened(optical_depth, sigma / width);
  splat.sigma = (float)sigma;
  splat.width = (float)width;
  if (out_streak != NULL)
    out_streak->kind = fum_streak_kind(o->smears, &o->smears->items[i], width, (double)o->least_blur);
  const bool is_smeared = out_streak != NULL && out_streak->kind != FUM_STREAK_NONE;
  splat.footprint = (float)(is_smeared ? fum_footprint(o->footprints.sigmas, optical_depth)
                                       : fum_footprints_end(&o->footprints, &optical_depth));
  splat.optical_depth = (float)optical_depth;
  splat.reach = (float)(sigma * FUM_SIGHT_ALONG * (double)splat.footprint);
  if (is_smeared) {
    smear_splat(sight, &o->smears->items[i], &splat, out_streak);
    return splat;
  }
  const double radius = (double)splat.footprint * width;
  const outline round = {.radii = {radius, radius}, .longest = radius};
  find_outline(sight, &round, &splat);
  find_span(sight->slabs, &splat);
  return splat;
}
