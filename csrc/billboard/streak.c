/* SPDX-License-Identifier: GPL-3.0-or-later */
#include "billboard/streak.h"

#include "billboard/bokeh.h"

/* Tangents are kept as directions, so that a disc across the camera's plane needs no division. */
void fum_find_slopes(double lateral, double depth, double radius, double out[2]) {
  const double squared = lateral * lateral + (depth - radius) * (depth + radius);
  out[0] = -INFINITY;
  out[1] = INFINITY;
  if (squared <= 0.0) return; /* the camera is in the disc */
  const double tangent = sqrt(squared);
  const double low_x = depth * tangent + lateral * radius, high_x = depth * tangent - lateral * radius;
  if (low_x <= 0.0 && high_x <= 0.0) {
    out[0] = INFINITY;
    out[1] = -INFINITY;
    return;
  }
  if (low_x > 0.0) out[0] = (lateral * tangent - depth * radius) / low_x;
  if (high_x > 0.0) out[1] = (lateral * tangent + depth * radius) / high_x;
}

/* One end of a path. */
typedef struct path_end {
  double at[3];  /* camera space */
  double radius; /* of all that is seen around it */
  double confusion;
} path_end;

static path_end find_end(const fum_smears *smears, const fum_smear *smear, double share, double radius) {
  path_end end;
  for (int axis = 0; axis < 3; axis++)
    end.at[axis] = (double)smear->center[axis] + share * (double)smear->path[axis];
  end.confusion = fabs(fum_smear_confusion(smears, smear, -share * (double)smear->path[2]));
  end.radius = radius + smears->extent * end.confusion;
  return end;
}

int32_t fum_streak_kind(const fum_smears *smears, const fum_smear *smear, double width, double least) {
  const float *p = smear->path;
  const double path = sqrt((double)(p[0] * p[0] + p[1] * p[1] + p[2] * p[2]));
  const double confusion =
      fmax(find_end(smears, smear, -0.5, 0.0).confusion, find_end(smears, smear, 0.5, 0.0).confusion);
  const double defocus = smears->aperture_deviation * confusion;
  if (path * path / 12.0 + defocus * defocus <= least * least * width * width) return FUM_STREAK_NONE;
  return confusion <= (double)FUM_BOKEH_LEAST * width ? FUM_STREAK_SWEPT : FUM_STREAK_BOKEH;
}

double fum_streak_share(const fum_view *view, const fum_smears *smears, const fum_smear *smear, double width) {
  const double defocus = smears->aperture_deviation * (double)smear->confusion;
  double across[2], squared = 0.0;
  for (int axis = 0; axis < 2; axis++) {
    const double slope = (double)smear->center[axis] / fmax(-(double)smear->center[2], width);
    const bool is_perspective = view->type == FUM_CAMERA_PERSPECTIVE;
    across[axis] = (double)smear->path[axis] + (is_perspective ? slope * (double)smear->path[2] : 0.0);
    squared += across[axis] * across[axis];
  }
  const double variance = width * width + defocus * defocus;
  return width * width / sqrt(variance * (variance + squared / 12.0));
}

/* The part of a path, -1/2 .. 1/2, on which the particle reaches between the clip planes. */
static bool clip(const fum_view *view, const fum_smear *smear, double radius, double out_shares[2]) {
  const double depth = -(double)smear->center[2], pace = -(double)smear->path[2];
  const double low = view->clip_start - radius - depth, high = view->clip_end + radius - depth;
  out_shares[0] = -0.5;
  out_shares[1] = 0.5;
  if (pace > 0.0) {
    out_shares[0] = fmax(-0.5, low / pace);
    out_shares[1] = fmin(0.5, high / pace);
  } else if (pace < 0.0) {
    out_shares[0] = fmax(-0.5, high / pace);
    out_shares[1] = fmin(0.5, low / pace);
  }
  return (low < 0.0 || pace != 0.0) && (high > 0.0 || pace != 0.0) && out_shares[0] <= out_shares[1];
}

/* How near a path passes the camera, seen along one of the other two axes. */
static double nearest_pass(const path_end ends[2], int axis) {
  const double dx = ends[1].at[axis] - ends[0].at[axis], dz = ends[1].at[2] - ends[0].at[2];
  const double squared = dx * dx + dz * dz;
  double share = squared > 0.0 ? -(ends[0].at[axis] * dx + ends[0].at[2] * dz) / squared : 0.0;
  share = fmin(1.0, fmax(0.0, share));
  return hypot(ends[0].at[axis] + share * dx, ends[0].at[2] + share * dz);
}

/* Slopes, or in an orthographic view metres, between which each end is seen. */
static void find_extents(const fum_view *view, const path_end ends[2], int axis, double out[2][2]) {
  const bool is_perspective = view->type == FUM_CAMERA_PERSPECTIVE;
  const bool is_around = is_perspective && nearest_pass(ends, axis) <= fmax(ends[0].radius, ends[1].radius);
  for (int end = 0; end < 2; end++) {
    const path_end *e = &ends[end];
    out[end][0] = e->at[axis] - e->radius;
    out[end][1] = e->at[axis] + e->radius;
    if (is_perspective) fum_find_slopes(e->at[axis], -e->at[2], e->radius, out[end]);
    if (is_around || !(out[end][0] <= out[end][1])) {
      out[end][0] = -INFINITY;
      out[end][1] = INFINITY;
    }
  }
}

/* Square of the short axis over the long one of the ellipse that an end looks like, where pixels are square; else 0.
 * The squares of both axes add up to those of its box. */
static double squared_aspect(const fum_view *view, const path_end *end) {
  const double *w = view->window, wide = (w[1] - w[0]) / view->width, high = (w[3] - w[2]) / view->height;
  const double aside = end->at[0] * end->at[0] + end->at[1] * end->at[1], depth = end->at[2] * end->at[2];
  const double radius = end->radius * end->radius;
  if (fabs(wide - high) > 1e-6 * wide) return 0.0;
  if (view->type != FUM_CAMERA_PERSPECTIVE) return 1.0;
  return depth > radius ? (depth - radius) / (aside + depth - radius) : 0.0;
}

bool fum_streak_find(const fum_view *view, const fum_smears *smears, const fum_smear *smear, double radius,
                     double beyond, double out_box[2][2], fum_streak *out) {
  const int32_t sides[2] = {view->width, view->height};
  double shares[2], squared[2] = {0.0, 0.0};
  if (!clip(view, smear, radius, shares)) return false;
  const path_end ends[2] = {find_end(smears, smear, shares[0], radius), find_end(smears, smear, shares[1], radius)};
  const double aspect[2] = {squared_aspect(view, &ends[0]), squared_aspect(view, &ends[1])};
  bool is_whole = false; /* too near to the camera for a streak: its box is looked at as a whole */
  for (int axis = 0; axis < 2; axis++) {
    const double *edges = view->window + 2 * axis, per_unit = (double)sides[axis] / (edges[1] - edges[0]);
    double extents[2][2], px[2][2];
    find_extents(view, ends, axis, extents);
    for (int end = 0; end < 2; end++) {
      for (int k = 0; k < 2; k++) {
        px[end][k] = fmin(beyond, fmax(-beyond, (extents[end][k] - edges[0]) * per_unit - 0.5));
        is_whole = is_whole || fabs(px[end][k]) == beyond;
      }
      out->ends_px[end][axis] = (float)(0.5 * (px[end][0] + px[end][1]));
      const double half = 0.5 * (px[end][1] - px[end][0]);
      squared[end] += half * half / (1.0 + aspect[end]);
    }
    const double first = fmin(px[0][0], px[1][0]), last = fmax(px[0][1], px[1][1]);
    if ((last - first < 1.0 && ceil(first) > floor(last)) || last < 0.0 || first > (double)(sides[axis] - 1))
      return false;
    out_box[axis][0] = first;
    out_box[axis][1] = last;
  }
  out->radius_px = is_whole ? INFINITY : (float)sqrt(fmax(squared[0], squared[1]));
  return true;
}

void fum_streak_ranges(const fum_view *view, const fum_smears *smears, const fum_smear *smear, double reach,
                       double width, double out[2]) {
  const bool is_perspective = view->type == FUM_CAMERA_PERSPECTIVE;
  out[0] = INFINITY;
  out[1] = -INFINITY;
  for (int k = 0; k < 2; k++) {
    const path_end end = find_end(smears, smear, k - 0.5, 0.0);
    const double *at = end.at, aside = hypot(at[0], at[1]), depth = -at[2];
    double range = depth, around = reach;
    if (is_perspective) {
      range = hypot(aside, depth);
      /* Rays through the image have depths alike, but not ranges; those that pass a Gaussian at a distance meet it
       * before its centre. */
      const double slopes = depth > 0.0 ? (aside + end.radius) / fmax(depth, 1e-6 * range) : 0.0;
      around += end.radius * fmin(slopes, 1.0) + 8.0 * width * width / fmax(range, width);
    }
    out[0] = fmin(out[0], range - around);
    out[1] = fmax(out[1], range + around);
  }
}
