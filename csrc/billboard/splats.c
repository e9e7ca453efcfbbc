/* SPDX-License-Identifier: GPL-3.0-or-later */
#include "billboard/splats.h"

#include "base/vector.h"
#include "billboard/dust.h"

/* Reach along the view over the footprint's sigmas: what lies beyond isn't lost, it is taken to be at the ends. */
static const double ALONG_SHARE = 0.72;

/* Pixels beyond which outlines aren't followed. */
static const double BEYOND = 1e5;

/* Square of an ellipse's short axis over the long one: of the cone around a sphere, with its axis at an angle to the
 * view's, cut by the picture. 0 where it is no ellipse. */
static double squared_aspect(const fum_splat *splat, double radius) {
  const double squared = (double)splat->range * (double)splat->range, depth = (double)splat->center[2];
  return fum_most(0.0, (depth * depth - radius * radius) / (squared - radius * radius));
}

/* What all particles are seen by. */
typedef struct lens {
  const fum_octree *octree;
  const fum_view *view;
  const fum_slabs *slabs;
  const fum_splats_options *options;
  double pixels_per_unit[2]; /* of the window */
  double pixel;              /* width of the wider side of a pixel at unit depth */
} lens;

static lens make_lens(const fum_octree *octree, const fum_view *view, const fum_slabs *slabs,
                      const fum_splats_options *options) {
  lens l = {octree, view, slabs, options, {0.0, 0.0}, 0.0};
  l.pixels_per_unit[0] = (double)view->width / (view->window[1] - view->window[0]);
  l.pixels_per_unit[1] = (double)view->height / (view->window[3] - view->window[2]);
  l.pixel = 1.0 / fum_least(l.pixels_per_unit[0], l.pixels_per_unit[1]);
  return l;
}

/* Box around the outline of a sphere, and the largest ellipse that the outline may be in it. */
static void find_outline(const lens *l, double footprint_m, fum_splat *splat) {
  const fum_view *view = l->view;
  const bool is_perspective = view->type == FUM_CAMERA_PERSPECTIVE;
  const int32_t sides[2] = {view->width, view->height};
  const double depth = -(double)splat->center[2];
  if (depth + footprint_m <= view->clip_start || depth - footprint_m >= view->clip_end) return;
  double middles[2], halves[2], aspect = is_perspective ? squared_aspect(splat, footprint_m) : 1.0;
  for (int axis = 0; axis < 2; axis++) {
    const double center = (double)splat->center[axis], *edges = view->window + 2 * axis;
    double ends[2] = {center - footprint_m, center + footprint_m};
    if (is_perspective) fum_find_slopes(center, depth, footprint_m, ends);
    const double per_unit = l->pixels_per_unit[axis], beyond = BEYOND;
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
  splat->rim = aspect > 0.0 ? (float)(2.0 / (1.0 + aspect)) : INFINITY;
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

/* What isn't cut off a Gaussian that ends so many sigmas from its middle. */
static double kept_within(double sigmas) {
  return 1.0 - exp(-0.5 * sigmas * sigmas);
}

fum_footprints fum_footprints_find(double sigmas, double thin_sigmas) {
  return (fum_footprints){.sigmas = sigmas,
                          .thin_sigmas = thin_sigmas,
                          .thin = exp(0.5 * (thin_sigmas * thin_sigmas - sigmas * sigmas)),
                          .per_kept = 1.0 / kept_within(thin_sigmas)};
}

/* Where a particle ends. What is cut off a thin one is seen nowhere but adds up where there are many: it is spread over
 * what is left. */
static double end_splat(const fum_footprints *f, double *optical_depth) {
  if (*optical_depth <= f->thin) {
    *optical_depth *= f->per_kept;
    return f->thin_sigmas;
  }
  if (*optical_depth >= 1.0) return fum_footprint(f->sigmas, *optical_depth);
  const double end = sqrt(f->sigmas * f->sigmas + 2.0 * log(*optical_depth));
  *optical_depth /= kept_within(end);
  return end;
}

/* A smeared particle's place in the picture. Over all instants and points of the lens the mean of what it hides stays
 * that of the particle; spread thinly, it adds up as that. */
static void smear_splat(const lens *l, const fum_smear *m, fum_splat *splat, fum_streak *streak) {
  const fum_smears *smears = l->options->smears;
  const double width = (double)splat->width, radius = (double)splat->footprint * width;
  double box[2][2], ranges[2];
  if (!fum_streak_find(l->view, smears, m, radius, BEYOND, box, streak)) return;
  for (int axis = 0; axis < 2; axis++) {
    splat->middle_px[axis] = (float)(0.5 * (box[axis][0] + box[axis][1]));
    splat->half_px[axis] = (float)fum_most(0.5 * (box[axis][1] - box[axis][0]), 1e-3);
  }
  splat->rim = INFINITY;
  fum_streak_ranges(l->view, smears, m, (double)splat->reach, width, ranges);
  for (int k = 0; k < 2; k++)
    streak->ranges[k] = (float)ranges[k];
  find_slabs(l->slabs, streak->ranges[0], streak->ranges[1], splat);
  const double share = fum_streak_share(l->view, smears, m, width), depth = (double)splat->optical_depth;
  if (depth > 0.0) splat->optical_depth = (float)(fum_dust_widened(depth, sqrt(share)) / share);
}

/* Camera space. */
static void find_center(const lens *l, int64_t i, double out[3]) {
  const fum_octree *octree = l->octree;
  if (l->options->smears != NULL) {
    for (int axis = 0; axis < 3; axis++)
      out[axis] = (double)l->options->smears->items[i].center[axis];
    return;
  }
  const double local[3] = {(double)octree->x[i], (double)octree->y[i], (double)octree->z[i]};
  fum_transform_point(l->view->camera_from_local, local, out);
}

static fum_splat see(const lens *l, int64_t i, fum_streak *out_streak) {
  const fum_octree *octree = l->octree;
  const fum_splats_options *o = l->options;
  const bool is_perspective = l->view->type == FUM_CAMERA_PERSPECTIVE;
  double c[3];
  find_center(l, i, c);
  fum_splat splat = {.center = {(float)c[0], (float)c[1], (float)c[2]}, .self_shade = 1.0F};
  const double sigma = 1.0 / (double)octree->inverse_sigmas[i];
  const double width = fum_most(sigma, FUM_MIN_SIGMA_PIXELS * l->pixel * (is_perspective ? fum_most(-c[2], 0.0) : 1.0));
  double optical_depth = (double)fum_max(octree->optical_depths[i], o->thinnest);
  if (width > sigma) optical_depth = fum_dust_widened(optical_depth, sigma / width);
  splat.sigma = (float)sigma;
  splat.width = (float)width;
  if (out_streak != NULL)
    out_streak->kind = fum_streak_kind(o->smears, &o->smears->items[i], width, (double)o->least_blur);
  const bool is_smeared = out_streak != NULL && out_streak->kind != FUM_STREAK_NONE;
  splat.footprint = (float)(is_smeared ? fum_footprint(o->footprints.sigmas, optical_depth)
                                       : end_splat(&o->footprints, &optical_depth));
  splat.optical_depth = (float)optical_depth;
  splat.range = (float)(is_perspective ? sqrt(c[0] * c[0] + c[1] * c[1] + c[2] * c[2]) : -c[2]);
  splat.reach = (float)(sigma * ALONG_SHARE * (double)splat.footprint);
  if (is_smeared) {
    smear_splat(l, &o->smears->items[i], &splat, out_streak);
    return splat;
  }
  find_outline(l, (double)splat.footprint * width, &splat);
  find_span(l->slabs, &splat);
  return splat;
}

static bool is_seen(const fum_splat *s) {
  return s->half_px[0] > 0.0F;
}

/* First and last tile that the splat's box touches along an axis. */
static void find_tiles(const fum_splat *s, int axis, int32_t count, int32_t out[2]) {
  const float first = s->middle_px[axis] - s->half_px[axis], last = s->middle_px[axis] + s->half_px[axis];
  const float end = (float)count;
  const float tiles[2] = {first / (float)FUM_TILE, last / (float)FUM_TILE};
  out[0] = tiles[0] > 0.0F ? (int32_t)tiles[0] : 0;
  out[1] = tiles[1] < end ? (int32_t)tiles[1] : count - 1;
}

/* Counts every wanted tile (NULL: all are) that the splat touches, or writes it down at the place that was counted. */
static void touch_tiles(const fum_splats *s, int64_t i, const uint8_t *wanted, int64_t *cursors, uint32_t *out) {
  const fum_splat *splat = &s->splats[i];
  if (!is_seen(splat)) return;
  int32_t columns[2], rows[2];
  const bool is_streak = s->streaks != NULL && s->streaks[i].kind != FUM_STREAK_NONE;
  const fum_streak *streak = is_streak ? &s->streaks[i] : NULL;
  find_tiles(splat, 0, s->columns, columns);
  find_tiles(splat, 1, s->rows, rows);
  const bool has_corners = columns[0] < columns[1] && rows[0] < rows[1];
  for (int32_t row = rows[0]; row <= rows[1]; row++) {
    const float y0 = (float)(row * FUM_TILE), gap = fum_splat_gap(splat, 1, y0, y0 + (float)(FUM_TILE - 1));
    for (int32_t column = columns[0]; column <= columns[1]; column++) {
      const float x0 = (float)(column * FUM_TILE);
      if (has_corners && gap + fum_splat_gap(splat, 0, x0, x0 + (float)(FUM_TILE - 1)) > splat->rim) continue;
      const float half = 0.5F * (float)(FUM_TILE - 1), diagonal = 1.4143F * half;
      if (has_corners && streak != NULL && !fum_streak_touches(streak, x0 + half, y0 + half, diagonal)) continue;
      const int64_t tile = (int64_t)row * s->columns + column;
      if (wanted != NULL && !wanted[tile]) continue;
      const int64_t at = cursors[tile]++;
      if (out != NULL) out[at] = (uint32_t)i;
    }
  }
}

/* Counting sort: each block of particles counts its tiles, then writes to places of its own, so that every tile's
 * splats stay in order whatever the number of threads. */
static int32_t sort_into_tiles(fum_context *context, const uint8_t *wanted, fum_splats *s) {
  const int64_t tiles = (int64_t)s->columns * s->rows;
  const int blocks = fum_thread_count(context);
  int64_t *cursors = NULL;
  int32_t status = fum_alloc(context, blocks * tiles, sizeof *cursors, "tiles", &cursors);
  if (status == FUM_OK) status = fum_alloc(context, tiles + 1, sizeof *s->tile_begins, "tiles", &s->tile_begins);
  if (status != FUM_OK) goto done;
#pragma omp parallel for num_threads(blocks) schedule(static, 1)
  for (int block = 0; block < blocks; block++) {
    const int64_t end = s->count * (block + 1) / blocks;
    for (int64_t i = s->count * block / blocks; i < end; i++)
      touch_tiles(s, i, wanted, cursors + block * tiles, NULL);
  }
  int64_t total = 0;
  for (int64_t tile = 0; tile < tiles; tile++) {
    s->tile_begins[tile] = total;
    for (int block = 0; block < blocks; block++) {
      const int64_t n = cursors[block * tiles + tile];
      cursors[block * tiles + tile] = total;
      total += n;
    }
  }
  s->tile_begins[tiles] = total;
  status = fum_alloc(context, total, sizeof *s->tile_splats, "tiles", &s->tile_splats);
  if (status != FUM_OK) goto done;
#pragma omp parallel for num_threads(blocks) schedule(static, 1)
  for (int block = 0; block < blocks; block++) {
    const int64_t end = s->count * (block + 1) / blocks;
    for (int64_t i = s->count * block / blocks; i < end; i++) {
      touch_tiles(s, i, wanted, cursors + block * tiles, s->tile_splats);
    }
  }
done:
  fum_free(context, &cursors);
  return status;
}

int32_t fum_splats_find(fum_context *context, const fum_octree *octree, const fum_view *view, const fum_slabs *slabs,
                        const fum_splats_options *options, fum_splats *out_splats) {
  fum_splats s = {.count = octree->count,
                  .columns = (view->width + FUM_TILE - 1) / FUM_TILE,
                  .rows = (view->height + FUM_TILE - 1) / FUM_TILE};
  const lens l = make_lens(octree, view, slabs, options);
  int64_t seen = 0;
  int32_t status = fum_alloc(context, s.count, sizeof *s.splats, "splats", &s.splats);
  if (status == FUM_OK && options->smears != NULL)
    status = fum_alloc(context, s.count, sizeof *s.streaks, "splats", &s.streaks);
  if (status != FUM_OK) goto done;
#pragma omp parallel for num_threads(fum_thread_count(context)) schedule(static) reduction(+ : seen)
  for (int64_t i = 0; i < s.count; i++) {
    if (fum_progress_in_loop(context, i, 1 << 16)) continue;
    s.splats[i] = see(&l, i, s.streaks != NULL ? &s.streaks[i] : NULL);
    seen += is_seen(&s.splats[i]);
  }
  s.seen_count = seen;
  status = fum_progress_report(context, FUM_STAGE_SORTING, 0.5F, "Sorting particles into tiles");
  if (status == FUM_OK) status = sort_into_tiles(context, NULL, &s);
done:
  if (status == FUM_OK) {
    *out_splats = s;
  } else {
    fum_splats_free(context, &s);
  }
  return status;
}

/* Only its place in the picture is another one, unless it was widened. */
static void see_again(const lens *l, const fum_splats_again *again, int64_t i, fum_splat *s) {
  if (again->is_asked == NULL || s->width > s->sigma) {
    *s = see(l, i, NULL);
    return;
  }
  for (int axis = 0; axis < 2; axis++) {
    s->middle_px[axis] = s->middle_px[axis] * again->scale + again->shift[axis];
    s->half_px[axis] *= again->scale;
  }
}

int32_t fum_splats_see_again(fum_context *context, const fum_octree *octree, const fum_view *view,
                             const fum_slabs *slabs, const fum_splats_options *options, const fum_splats_again *again,
                             fum_splats *splats) {
  const lens l = make_lens(octree, view, slabs, options);
  int64_t seen = 0;
  fum_free(context, &splats->tile_begins);
  fum_free(context, &splats->tile_splats);
  splats->columns = (view->width + FUM_TILE - 1) / FUM_TILE;
  splats->rows = (view->height + FUM_TILE - 1) / FUM_TILE;
#pragma omp parallel for num_threads(fum_thread_count(context)) schedule(static) reduction(+ : seen)
  for (int64_t i = 0; i < splats->count; i++) {
    fum_splat *s = &splats->splats[i];
    if (fum_progress_in_loop(context, i, 1 << 16) || !is_seen(s)) continue;
    if (again->is_asked == NULL || again->is_asked(again->user, s)) {
      see_again(&l, again, i, s);
    } else {
      s->half_px[0] = 0.0F;
    }
    seen += is_seen(s);
  }
  splats->seen_count = seen;
  return fum_is_cancelled(context) ? FUM_ERROR_CANCELLED : sort_into_tiles(context, again->wanted, splats);
}

void fum_splats_free(fum_context *context, fum_splats *splats) {
  fum_free(context, &splats->splats);
  fum_free(context, &splats->streaks);
  fum_free(context, &splats->tile_begins);
  fum_free(context, &splats->tile_splats);
}
