/* SPDX-License-Identifier: GPL-3.0-or-later */
/* The loop of splat_sight.h, to be compiled once for each instruction set: splat_sight_*.c define FUM_LANES and
 * FUM_SIGHT_NAME. In single precision, in terms without differences of large numbers; lanes for which that isn't enough
 * are seen one by one. */
#include "base/simd.h"
#include "billboard/dust.h"
#include "billboard/splat_sight.h"

#include <stddef.h>

/* A splat is written as so many floats; its slabs are two halves of the last one. */
enum { FIELDS = 16 };
_Static_assert(sizeof(fum_splat) == FIELDS * sizeof(float), "a splat is made of FIELDS floats");
_Static_assert(offsetof(fum_splat, last_slab) == offsetof(fum_splat, first_slab) + sizeof(uint16_t),
               "slabs share one of them");
_Static_assert(offsetof(fum_face, range) == 0 && sizeof(fum_face) % sizeof(float) == 0, "ranges are floats apart");

#define FIELD(name) (offsetof(fum_splat, name) / sizeof(float))

/* Particles, one a lane, as Gaussians before the camera. */
typedef struct lanes {
  fum_vi is_bunch;
  fum_vf center[3], range;     /* as in fum_splat */
  fum_vf per_depth;            /* 1 over that before the camera, and some number beside it; orthographic: 1 */
  fum_vf slopes[2], squared;   /* of the way to the centre in the window, and of its length at unit depth; orthographic:
                                  0 and 1 */
  fum_vf inverse_sigma, round; /* of one of a bunch */
  fum_vf sigma, width;         /* as in fum_splat */
  fum_vf across[2], lean;      /* as in fum_stretched */
  fum_vf optical_depth;
} lanes;

/* In double precision, for the camera may be far from the scene. */
static void find_centers(const fum_sight *s, int64_t i, lanes *n) {
  const fum_octree *octree = s->octree;
  const double *m = s->view->camera_from_local;
  float center[3][FUM_LANES];
  for (int half = 0; half < 2; half++) {
    const int lane = half * FUM_DOUBLE_LANES;
    const fum_vd x = fum_vd_load_floats(octree->x + i + lane), y = fum_vd_load_floats(octree->y + i + lane);
    const fum_vd z = fum_vd_load_floats(octree->z + i + lane);
    for (int row = 0; row < 3; row++)
      fum_vd_store_floats(center[row] + lane,
                          m[4 * row] * x + m[4 * row + 1] * y + m[4 * row + 2] * z + m[4 * row + 3]);
  }
  for (int row = 0; row < 3; row++)
    n->center[row] = fum_vf_load(center[row]);
}

static void find_place(const fum_sight *s, int64_t i, lanes *n) {
  find_centers(s, i, n);
  const fum_vf *c = n->center;
  if (s->view->type != FUM_CAMERA_PERSPECTIVE) {
    n->range = -c[2];
    n->per_depth = fum_vf_set(1.0F);
    n->slopes[0] = n->slopes[1] = fum_vf_set(0.0F);
    n->squared = fum_vf_set(1.0F);
    return;
  }
  n->range = fum_vf_sqrt(c[0] * c[0] + c[1] * c[1] + c[2] * c[2]);
  n->per_depth = 1.0F / fum_vf_select(c[2] != 0.0F, -c[2], fum_vf_set(1.0F));
  for (int axis = 0; axis < 2; axis++)
    n->slopes[axis] = c[axis] * n->per_depth;
  n->squared = 1.0F + n->slopes[0] * n->slopes[0] + n->slopes[1] * n->slopes[1];
}

static void find_round(const fum_sight *s, int64_t i, lanes *n) {
  const float pixels = (float)(FUM_MIN_SIGMA_PIXELS * s->pixel);
  const fum_vf least = s->view->type == FUM_CAMERA_PERSPECTIVE ? -n->center[2] * pixels : fum_vf_set(pixels);
  n->is_bunch = (fum_vi){0};
  n->inverse_sigma = fum_vf_load(s->octree->inverse_sigmas + i);
  n->round = n->sigma = 1.0F / n->inverse_sigma;
  n->width = n->across[0] = n->across[1] = fum_vf_max(n->sigma, least);
  n->lean = fum_vf_set(0.0F);
  n->optical_depth = fum_vf_load(s->octree->optical_depths + i);
}

/* Covariance beside that of a round Gaussian, over its sigma squared: camera space. */
static void find_covariance(const fum_sight *s, int64_t i, fum_vf inverse_sigma, fum_vf out[3][3]) {
  const double *m = s->view->camera_from_local;
  const fum_vf per_round = inverse_sigma * inverse_sigma;
  fum_vf held[FUM_STRETCHES], turned[3][3];
  float turn[3][3];
  for (int k = 0; k < FUM_STRETCHES; k++)
    held[k] = fum_vf_load(s->octree->stretches + k * (s->octree->count + FUM_OCTREE_PAD) + i) * per_round;
  const fum_vf local[3][3] = {
      {held[0], held[2], held[3]}, {held[2], held[1], held[4]}, {held[3], held[4], -(held[0] + held[1])}};
  for (int row = 0; row < 3; row++) {
    for (int k = 0; k < 3; k++)
      turn[row][k] = (float)m[4 * row + k];
    for (int k = 0; k < 3; k++)
      turned[row][k] = turn[row][0] * local[0][k] + turn[row][1] * local[1][k] + turn[row][2] * local[2][k];
  }
  for (int row = 0; row < 3; row++) {
    for (int k = row; k < 3; k++)
      out[row][k] = turn[k][0] * turned[row][0] + turn[k][1] * turned[row][1] + turn[k][2] * turned[row][2];
  }
}

static fum_vi load_is_bunch(const fum_sight *s, int64_t i, int32_t count) {
  uint32_t members[FUM_LANES] = {0};
  fum_vi loaded;
  if (count == FUM_LANES) {
    memcpy(members, s->octree->members + i, sizeof members);
  } else {
    memcpy(members, s->octree->members + i, (size_t)count * sizeof *members);
  }
  memcpy(&loaded, members, sizeof loaded);
  return loaded > 1;
}

/* As fum_stretch_find, in units of the round Gaussian. */
static void find_stretched(const fum_sight *s, int64_t i, int32_t count, lanes *n, fum_vf out[3]) {
  const float half_log2_e = FUM_HALF_LOG2_E;
  const fum_vf u = n->slopes[0], v = n->slopes[1], squared = n->squared;
  fum_vf c[3][3];
  find_round(s, i, n);
  n->is_bunch = load_is_bunch(s, i, count);
  find_covariance(s, i, n->inverse_sigma, c);
  const fum_vf along =
      u * u * c[0][0] + v * v * c[1][1] + c[2][2] + 2.0F * (u * v * c[0][1] - u * c[0][2] - v * c[1][2]);
  const fum_vf per_squared = 1.0F / squared, wide = 1.0F + along * per_squared;
  const fum_vf beside[3] = {c[0][0] + u * (2.0F * c[0][2] + u * c[2][2]),
                            c[0][1] + v * c[0][2] + u * (c[1][2] + v * c[2][2]),
                            c[1][1] + v * (2.0F * c[1][2] + v * c[2][2])};
  const fum_vf uu = 1.0F + u * u, vv = 1.0F + v * v;
  const fum_vf xx = uu + beside[0], xy = u * v + beside[1], yy = vv + beside[2];
  const fum_vf per_area = 1.0F / (xx * yy - xy * xy), per_round = per_squared / wide;
  const fum_vf scale = half_log2_e * n->inverse_sigma * n->inverse_sigma, none = fum_vf_set(0.0F);
  out[0] = fum_vf_select(n->is_bunch, scale * (vv * per_round - yy * per_area), none);
  out[1] = fum_vf_select(n->is_bunch, 2.0F * scale * (xy * per_area - u * v * per_round), none);
  out[2] = fum_vf_select(n->is_bunch, scale * (uu * per_round - xx * per_area), none);
  n->sigma = fum_vf_select(n->is_bunch, n->round * fum_vf_sqrt(wide), n->sigma);
  n->across[0] = fum_vf_select(n->is_bunch, n->round * fum_vf_sqrt(xx / uu), n->width);
  n->across[1] = fum_vf_select(n->is_bunch, n->round * fum_vf_sqrt(yy / vv), n->width);
  n->width = fum_vf_select(n->is_bunch, n->sigma, n->width);
  n->lean = fum_vf_select(n->is_bunch, fum_vf_abs(beside[1]) / fum_vf_sqrt(xx * yy), none);
  const fum_vf peak = fum_vf_sqrt(squared * per_area);
  n->optical_depth = fum_vf_select(n->is_bunch, peak * n->optical_depth, n->optical_depth);
}

/* As fum_footprints_end: outside of the end of a Gaussian thinner than 1 lies a share of it of cut over its depth. */
static fum_vf find_ends(const fum_sight *s, lanes *n) {
  const fum_footprints *f = &s->options->footprints;
  const fum_vf depth = n->optical_depth, thin_ends = fum_vf_set((float)f->thin_sigmas);
  const fum_vi is_thin = depth <= (float)f->thin;
  n->optical_depth = depth * (float)f->per_kept;
  if (fum_vi_bits(~is_thin) == 0) return thin_ends;
  const fum_vf ends = fum_vf_sqrt((float)(f->sigmas * f->sigmas) + 2.0F * fum_vf_log(depth));
  const fum_vf spread = fum_vf_select(depth >= 1.0F, depth, depth * (depth / (depth - (float)f->cut)));
  n->optical_depth = fum_vf_select(is_thin, n->optical_depth, spread);
  return fum_vf_select(is_thin, thin_ends, ends);
}

/* Is there a whole number from `first` to `last`? */
static fum_vi has_whole(fum_vf first, fum_vf last) {
  const fum_vf cut = __builtin_convertvector(__builtin_convertvector(last, fum_vi), fum_vf);
  return fum_vf_select(cut > last, cut - 1.0F, cut) >= first;
}

/* The tiles of a box along an axis. */
typedef struct tile_range {
  fum_vi first, more; /* behind the first */
  fum_vf gaps[2];     /* as of fum_splat_gap, of the first and the next */
} tile_range;

static tile_range find_tiles(fum_vf middle, fum_vf half, int32_t count) {
  const fum_vf end = fum_vf_set((float)count - 0.5F), per_half = 1.0F / half;
  const float per_pixel = 1.0F / (float)FUM_TILE;
  const fum_vf from = fum_vf_min(fum_vf_at_least((middle - half) * per_pixel, 0.0F), end);
  const fum_vf to = fum_vf_min(fum_vf_at_least((middle + half) * per_pixel, 0.0F), end);
  tile_range r = {.first = __builtin_convertvector(from, fum_vi)};
  r.more = __builtin_convertvector(to, fum_vi) - r.first;
  for (int k = 0; k < 2; k++) {
    const fum_vf first = __builtin_convertvector((r.first + k) * FUM_TILE, fum_vf);
    const fum_vf gap = fum_vf_max(first - middle, middle - first - (float)(FUM_TILE - 1));
    r.gaps[k] = fum_vf_at_least(gap * per_half, 0.0F);
    r.gaps[k] *= r.gaps[k];
  }
  return r;
}

/* As fum_touched_find, of what is seen. */
static fum_vi find_touched(const fum_view *view, const fum_vf middles[2], const fum_vf halves[2], fum_vf rim) {
  const int32_t columns = fum_tiles_along(view->width), rows = fum_tiles_along(view->height);
  const tile_range x = find_tiles(middles[0], halves[0], columns), y = find_tiles(middles[1], halves[1], rows);
  const fum_vi has_corners = (x.more > 0) & (y.more > 0), is_large = (x.more > 1) | (y.more > 1);
  fum_vi touched = (y.first * columns + x.first) << FUM_TOUCHED_TILE;
  for (int k = 0; k < 4; k++) {
    const fum_vi is_in =
        (x.more >= k % 2) & (y.more >= k / 2) & (~has_corners | (x.gaps[k % 2] + y.gaps[k / 2] <= rim));
    touched |= is_in & (1 << k);
  }
  return (touched & ~is_large) | (is_large & FUM_TOUCHED_MANY);
}

/* Boxes around the outlines and the rims in them, 0 where nothing is seen. True where floats don't do. */
static fum_vi find_boxes(const fum_sight *s, const lanes *n, fum_vf footprint, fum_vf out[FIELDS],
                         fum_vi *out_touched) {
  const fum_view *view = s->view;
  const bool is_perspective = view->type == FUM_CAMERA_PERSPECTIVE;
  const int32_t sides[2] = {view->width, view->height};
  const float beyond = (float)FUM_SIGHT_BEYOND, steep = 9.0F; /* squared: slopes at which digits are lost */
  const fum_vf longest = footprint * fum_vf_max(n->across[0], n->across[1]), front = -n->center[2];
  const fum_vi is_between = (front + longest > (float)view->clip_start) & (front - longest < (float)view->clip_end);
  fum_vi is_seen = is_between, is_odd = (fum_vi){0};
  fum_vf middles[2], halves[2], rim = 1.0F + n->lean;
  for (int axis = 0; axis < 2; axis++) {
    const float edge = (float)view->window[2 * axis], per_unit = (float)s->pixels_per_unit[axis];
    fum_vf middle = n->center[axis], half = footprint * n->across[axis];
    if (is_perspective) {
      const fum_vf slope = n->slopes[axis], ratio = half * n->per_depth, left = (1.0F - ratio) * (1.0F + ratio);
      const fum_vf per_left = 1.0F / left;
      middle = slope * per_left;
      half = ratio * fum_vf_sqrt(slope * slope + left) * per_left;
    }
    middles[axis] = (middle - edge) * per_unit - 0.5F;
    halves[axis] = half * per_unit;
    const fum_vf first = middles[axis] - halves[axis], last = middles[axis] + halves[axis];
    is_seen &= has_whole(first, last) & (last >= 0.0F) & (first <= (float)(sides[axis] - 1));
    is_odd |= (first <= -beyond) | (last >= beyond);
  }
  if (is_perspective) { /* as squared_aspect of splat_sight.c */
    const fum_vf ratio = longest * n->per_depth, squared = ratio * ratio;
    rim *= 2.0F * (n->squared - squared) / (1.0F + n->squared - 2.0F * squared);
    is_odd =
        (is_odd & is_seen) | (is_seen & n->is_bunch & (n->squared > steep)) | (is_between & (front < 2.0F * longest));
  } else {
    is_odd &= is_between;
  }
  for (int axis = 0; axis < 2; axis++) {
    halves[axis] = fum_vf_at_least(halves[axis], 1e-3F);
    out[FIELD(middle_px) + (size_t)axis] = (fum_vf)((fum_vi)middles[axis] & is_seen);
    out[FIELD(half_px) + (size_t)axis] = (fum_vf)((fum_vi)halves[axis] & is_seen);
  }
  *out_touched = find_touched(view, middles, halves, rim) & is_seen;
  out[FIELD(rim)] = (fum_vf)((fum_vi)rim & is_seen);
  return is_odd;
}

/* As fum_slab_at. */
static fum_vi find_slabs(const fum_sight *s, fum_vf range) {
  const fum_slabs *slabs = s->slabs;
  const float *ranges = &slabs->faces[0].range;
  const int32_t stride = sizeof *slabs->faces / sizeof *ranges;
  const fum_vf start = fum_vf_at_least((range - ranges[0]) * (float)slabs->starts_per_metre, 0.0F);
  const fum_vf last = fum_vf_set((float)(FUM_SLAB_STARTS - 1)), from = fum_vf_min(start, last);
  fum_vi slab = __builtin_convertvector(fum_vf_gather(s->slab_starts, __builtin_convertvector(from, fum_vi)), fum_vi);
  for (;;) {
    const fum_vi is_before = (slab + 1 < slabs->count) & (fum_vf_gather(ranges, (slab + 1) * stride) <= range);
    if (fum_vi_bits(is_before) == 0) return slab;
    slab -= is_before;
  }
}

static fum_vf find_span(const fum_sight *s, const lanes *n, fum_vf reach) {
  const fum_vf bend = 8.0F * n->width * n->width / fum_vf_max(n->range, n->width), span = reach + bend;
  const fum_vi first = find_slabs(s, n->range - span), last = find_slabs(s, n->range + span);
  return (fum_vf)(first | last << 16);
}

/* Dust is thinner for being drawn wider than it is; how much, only a series says. */
static void thin_dust(lanes *n) {
  uint32_t dust = fum_vi_bits(n->width > n->sigma);
  for (; dust != 0; dust &= dust - 1) {
    const int lane = __builtin_ctz(dust);
    const double ratio = (double)n->sigma[lane] / (double)n->width[lane];
    n->optical_depth[lane] = (float)fum_dust_widened((double)n->optical_depth[lane], ratio);
  }
}

/* What is found of splats, one a lane. */
typedef struct found {
  fum_vf fields[FIELDS], stretches[3];
  fum_vi touched;
} found;

/* Returns the lanes that are to be seen one by one. */
static uint32_t see(const fum_sight *s, int64_t i, int32_t count, found *f) {
  fum_vf *out = f->fields;
  lanes n;
  find_place(s, i, &n);
  if (s->octree->stretches != NULL) {
    find_stretched(s, i, count, &n, f->stretches);
  } else {
    find_round(s, i, &n);
  }
  const fum_vf least = fum_vf_at_least(n.optical_depth, s->options->thinnest);
  n.optical_depth = fum_vf_select(n.is_bunch, n.optical_depth, least);
  thin_dust(&n);
  const fum_vf footprint = find_ends(s, &n), reach = n.sigma * (float)FUM_SIGHT_ALONG * footprint;
  for (int axis = 0; axis < 3; axis++)
    out[FIELD(center) + (size_t)axis] = n.center[axis];
  out[FIELD(sigma)] = n.sigma;
  out[FIELD(width)] = n.width;
  out[FIELD(optical_depth)] = n.optical_depth;
  out[FIELD(reach)] = reach;
  out[FIELD(range)] = n.range;
  out[FIELD(footprint)] = footprint;
  out[FIELD(self_shade)] = fum_vf_set(1.0F);
  out[FIELD(first_slab)] = find_span(s, &n, reach);
  return fum_vi_bits(find_boxes(s, &n, footprint, out, &f->touched));
}

static inline __attribute__((always_inline)) void store_splats(const fum_vf fields[FIELDS], fum_splat *out) {
  float(*splats)[FIELDS] = (float(*)[FIELDS])out;
  for (int field = 0; field < FIELDS; field += 4) {
    for (int lane = 0; lane < FUM_LANES; lane += 4) {
      fum_quad quads[4];
      for (int k = 0; k < 4; k++)
        memcpy(&quads[k], (const float *)&fields[field + k] + lane, sizeof quads[k]);
      fum_quad_transpose(quads);
      for (int k = 0; k < 4; k++)
        memcpy(&splats[lane + k][field], &quads[k], sizeof quads[k]);
    }
  }
}

static void store_stretches(const fum_vf of[3], fum_stretch *out) {
  for (int lane = 0; lane < FUM_LANES; lane++)
    out[lane] = (fum_stretch){of[0][lane], of[1][lane], of[2][lane]};
}

static void store_all(const found *f, const fum_sight_out *out) {
  store_splats(f->fields, out->splats);
  memcpy(out->touched, &f->touched, sizeof f->touched);
  if (out->stretches != NULL) store_stretches(f->stretches, out->stretches);
}

static void store(const found *f, int32_t count, const fum_sight_out *out) {
  if (count == FUM_LANES) {
    store_all(f, out);
    return;
  }
  fum_splat splats[FUM_LANES];
  fum_stretch stretches[FUM_LANES];
  fum_touched touched[FUM_LANES];
  store_all(f, &(fum_sight_out){splats, out->stretches != NULL ? stretches : NULL, touched});
  memcpy(out->splats, splats, (size_t)count * sizeof *splats);
  memcpy(out->touched, touched, (size_t)count * sizeof *touched);
  if (out->stretches != NULL) memcpy(out->stretches, stretches, (size_t)count * sizeof *stretches);
}

void FUM_SIGHT_NAME(const fum_sight *sight, int64_t begin, int32_t count, const fum_sight_out *out) {
  found f = {0};
  for (int32_t k = 0; k < count; k += FUM_LANES) {
    const int32_t left = count - k < FUM_LANES ? count - k : FUM_LANES;
    const fum_sight_out at = {out->splats + k, out->stretches != NULL ? out->stretches + k : NULL, out->touched + k};
    uint32_t odd = see(sight, begin + k, left, &f) & ((1U << left) - 1);
    store(&f, left, &at);
    for (; odd != 0; odd &= odd - 1) {
      const int lane = __builtin_ctz(odd);
      at.splats[lane] =
          fum_sight_splat(sight, begin + k + lane, NULL, at.stretches != NULL ? &at.stretches[lane] : NULL);
      at.touched[lane] = fum_touched_find(sight->view, &at.splats[lane], false);
    }
  }
}
