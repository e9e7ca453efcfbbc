/* SPDX-License-Identifier: GPL-3.0-or-later */
#include "reference/smoke.h"

#include "base/hash.h"
#include "base/radix.h"
#include "base/vector.h"

#include <stdlib.h>
#include <string.h>

enum { CELL_SIZE = 32, AXIS_BITS = 19 };

static double dot(const double a[3], const double b[3]) {
  return a[0] * b[0] + a[1] * b[1] + a[2] * b[2];
}

static const float *color_of(const float *many, const float one[3], int64_t index) {
  return many != NULL ? many + 3 * index : one;
}

static bool matters(const fum_particles *set, int64_t i) {
  const float *glow = color_of(set->emissions, set->emission, i);
  return set->densities[i] > 0.0F || glow[0] > 0.0F || glow[1] > 0.0F || glow[2] > 0.0F;
}

static fum_gaussian make_gaussian(const fum_scene *scene, int32_t s, int64_t i, double lost) {
  const fum_particles *set = &scene->particles[s];
  fum_gaussian g = {.sigma = (double)set->sigmas[i], .density = (double)set->densities[i], .index = i, .set = s};
  for (int axis = 0; axis < 3; axis++)
    g.centre[axis] = (double)set->positions[3 * i + axis] - scene->origin[axis];
  const float *tint = color_of(set->tints, set->tint, i);
  for (int c = 0; c < 3; c++)
    g.tint[c] = (double)tint[c];
  const double most = fmax(g.tint[0], fmax(g.tint[1], g.tint[2])), depth = most * g.density * g.sigma * FUM_SQRT_2PI;
  const double edge = set->map != NULL ? (double)set->map->edge : 1.0;
  g.cut = g.sigma * sqrt(2.0 * log(edge * fmax(depth, 1.0) / lost));
  return g;
}

/* Codes that sort the particles by size, in powers of two, and then along a Morton curve. */
static void make_keys(const fum_smoke *smoke, uint64_t *keys) {
  double lower[3] = {INFINITY, INFINITY, INFINITY}, side = 0.0;
  for (int64_t i = 0; i < smoke->count; i++) {
    for (int axis = 0; axis < 3; axis++)
      lower[axis] = fmin(lower[axis], smoke->gaussians[i].centre[axis]);
  }
  for (int64_t i = 0; i < smoke->count; i++) {
    for (int axis = 0; axis < 3; axis++)
      side = fmax(side, smoke->gaussians[i].centre[axis] - lower[axis]);
  }
  const double cells = (double)((1 << AXIS_BITS) - 1), scale = side > 0.0 ? cells / side : 0.0;
  for (int64_t i = 0; i < smoke->count; i++) {
    const fum_gaussian *g = &smoke->gaussians[i];
    const int octave = (int)fmin(63.0, fmax(0.0, floor(log2(g->sigma / smoke->smallest_sigma))));
    uint64_t key = (uint64_t)octave;
    for (int bit = AXIS_BITS - 1; bit >= 0; bit--) {
      for (int axis = 0; axis < 3; axis++) {
        key = key << 1 | ((uint64_t)((g->centre[axis] - lower[axis]) * scale) >> bit & 1);
      }
    }
    keys[i] = key;
  }
}

static fum_smoke_cell make_cell(const fum_smoke *smoke, int64_t begin, int64_t end) {
  fum_smoke_cell cell = {.begin = begin, .end = end};
  double lower[3] = {INFINITY, INFINITY, INFINITY}, upper[3] = {-INFINITY, -INFINITY, -INFINITY};
  for (int64_t i = begin; i < end; i++) {
    for (int axis = 0; axis < 3; axis++) {
      lower[axis] = fmin(lower[axis], smoke->gaussians[i].centre[axis]);
      upper[axis] = fmax(upper[axis], smoke->gaussians[i].centre[axis]);
    }
  }
  for (int axis = 0; axis < 3; axis++)
    cell.centre[axis] = 0.5 * (lower[axis] + upper[axis]);
  for (int64_t i = begin; i < end; i++) {
    const fum_gaussian *g = &smoke->gaussians[i];
    const double d[3] = {g->centre[0] - cell.centre[0], g->centre[1] - cell.centre[1], g->centre[2] - cell.centre[2]};
    cell.radius = fmax(cell.radius, (sqrt(dot(d, d)) + g->cut) * (1.0 + 1e-12));
  }
  return cell;
}

/* Sorts the Gaussians and cuts them into cells. */
static int32_t make_cells(fum_context *context, fum_smoke *smoke) {
  uint64_t *keys = NULL;
  uint32_t *order = NULL;
  fum_gaussian *sorted = NULL;
  const int64_t n = smoke->count;
  int32_t status = fum_alloc(context, n, sizeof *keys, "reference", &keys);
  if (status == FUM_OK) status = fum_alloc(context, n, sizeof *order, "reference", &order);
  if (status == FUM_OK) status = fum_alloc(context, n, sizeof *sorted, "reference", &sorted);
  if (status == FUM_OK)
    status = fum_alloc(context, n / CELL_SIZE + 1, sizeof *smoke->cells, "reference", &smoke->cells);
  if (status != FUM_OK) goto done;
  make_keys(smoke, keys);
  for (int64_t i = 0; i < n; i++)
    order[i] = (uint32_t)i;
  status = fum_radix_sort(context, n, 0, keys, order);
  if (status != FUM_OK) goto done;
  for (int64_t i = 0; i < n; i++)
    sorted[i] = smoke->gaussians[order[i]];
  fum_free(context, &smoke->gaussians);
  smoke->gaussians = sorted;
  sorted = NULL;
  for (int64_t i = 0; i < n; i += CELL_SIZE) {
    smoke->cells[smoke->cell_count++] = make_cell(smoke, i, i + CELL_SIZE < n ? i + CELL_SIZE : n);
  }
done:
  fum_free(context, &sorted);
  fum_free(context, &order);
  fum_free(context, &keys);
  return status;
}

int32_t fum_smoke_init(fum_scene *scene, double lost, fum_smoke *out_smoke) {
  *out_smoke = (fum_smoke){.scene = scene, .smallest_sigma = INFINITY};
  fum_smoke *smoke = out_smoke;
  const int32_t status =
      fum_alloc(scene->context, scene->particle_count, sizeof *smoke->gaussians, "reference", &smoke->gaussians);
  if (status != FUM_OK) return status;
  for (int32_t s = 0; s < scene->particles_count; s++) {
    const fum_particles *set = &scene->particles[s];
    for (int64_t i = 0; i < set->count; i++) {
      if (!matters(set, i)) continue;
      const fum_gaussian g = make_gaussian(scene, s, i, lost);
      smoke->smallest_sigma = fmin(smoke->smallest_sigma, g.sigma);
      smoke->gaussians[smoke->count++] = g;
    }
  }
  return make_cells(scene->context, smoke);
}

void fum_smoke_free(fum_smoke *smoke) {
  fum_free(smoke->scene->context, &smoke->gaussians);
  fum_free(smoke->scene->context, &smoke->cells);
  fum_free(smoke->scene->context, &smoke->maps);
}

int32_t fum_smoke_look(fum_smoke *smoke, const fum_view *view) {
  const fum_scene *scene = smoke->scene;
  int32_t status = fum_alloc(scene->context, scene->particles_count, sizeof *smoke->maps, "reference", &smoke->maps);
  for (int32_t s = 0; s < scene->particles_count && status == FUM_OK; s++) {
    if (scene->particles[s].map != NULL)
      status = fum_reference_map_make(scene->context, scene->particles[s].map, &smoke->maps[s]);
  }
  smoke->view = view;
  return status;
}

double fum_gaussian_integral(double sigma, double a, double b) {
  const double root_half = 0.70710678118654752440, nothing_beyond = 6.0; /* erfc(6) is below half an epsilon */
  const double low = a / sigma * root_half, high = b / sigma * root_half;
  double share;
  if (low > 0.0) {
    share = erfc(low) - erfc(high);
  } else if (high < 0.0) {
    share = erfc(-high) - erfc(-low);
  } else {
    share = 2.0 - (low > -nothing_beyond ? erfc(-low) : 0.0) - (high < nothing_beyond ? erfc(high) : 0.0);
  }
  return 0.5 * FUM_SQRT_2PI * sigma * share;
}

static bool is_cell_near(const fum_smoke_cell *cell, const fum_way *way) {
  const double d[3] = {cell->centre[0] - way->start[0], cell->centre[1] - way->start[1],
                       cell->centre[2] - way->start[2]};
  const double s = fmin(fmax(dot(d, way->direction), 0.0), way->length);
  double squared = 0.0;
  for (int axis = 0; axis < 3; axis++) {
    const double offset = d[axis] - s * way->direction[axis];
    squared += offset * offset;
  }
  return squared <= cell->radius * cell->radius;
}

/* Where the way passes the particle nearest; false if it isn't heard on the way. */
static inline bool pass(const fum_gaussian *g, const fum_way *way, double *out_along, double *out_squared) {
  const double d[3] = {g->centre[0] - way->start[0], g->centre[1] - way->start[1], g->centre[2] - way->start[2]};
  const double s = dot(d, way->direction);
  if (s < -g->cut || s - g->cut > way->length) return false;
  double squared = 0.0;
  for (int axis = 0; axis < 3; axis++) {
    const double offset = d[axis] - s * way->direction[axis];
    squared += offset * offset;
  }
  *out_along = s;
  *out_squared = squared;
  return squared < g->cut * g->cut;
}

void fum_smoke_depth(const fum_smoke *smoke, const fum_way *way, uint64_t shadow_sets, double out_depths[3]) {
  double rgb[3] = {0.0}, s, squared;
  for (int64_t n = 0; n < smoke->cell_count && fmin(rgb[0], fmin(rgb[1], rgb[2])) < FUM_DARK_DEPTH; n++) {
    if (!is_cell_near(&smoke->cells[n], way)) continue;
    for (int64_t i = smoke->cells[n].begin; i < smoke->cells[n].end; i++) {
      const fum_gaussian *g = &smoke->gaussians[i];
      if (!fum_has_set(shadow_sets, smoke->scene->particles[g->set].shadow_set)) continue;
      if (!pass(g, way, &s, &squared)) continue;
      const double density = g->density * exp(-0.5 * squared / (g->sigma * g->sigma));
      const double depth = density * fum_gaussian_integral(g->sigma, -s, way->length - s);
      for (int c = 0; c < 3; c++)
        rgb[c] += depth * g->tint[c];
    }
  }
  memcpy(out_depths, rgb, sizeof rgb);
}

/* What the particle's map says along a ray of the camera. */
static void read_map(const fum_smoke *smoke, const fum_gaussian *g, const fum_way *way, double squared,
                     double out_factors[4]) {
  const fum_particles *set = &smoke->scene->particles[g->set];
  for (int c = 0; c < 4; c++)
    out_factors[c] = 1.0;
  if (set->map == NULL || smoke->view == NULL) return;
  const uint64_t id = set->ids != NULL ? set->ids[g->index] : (uint64_t)g->index;
  fum_reference_map_read(&smoke->maps[g->set], smoke->view, g->centre, g->sigma, 2.0 * FUM_PI * fum_hash_unit(id),
                         way->start, way->direction, sqrt(squared), out_factors);
}

static bool append(const fum_smoke *smoke, const fum_gaussian *g, const fum_way *way, double along, double squared,
                   fum_heard_list *list) {
  if (list->count == list->capacity) {
    const int64_t capacity = 2 * list->capacity + 64;
    fum_heard *grown = realloc(list->items, (size_t)capacity * sizeof *grown);
    if (grown == NULL) return false;
    list->items = grown;
    list->capacity = capacity;
  }
  const fum_particles *set = &smoke->scene->particles[g->set];
  const float *albedo = color_of(set->albedos, set->albedo, g->index);
  const float *glow = color_of(set->emissions, set->emission, g->index);
  const double there = exp(-0.5 * squared / (g->sigma * g->sigma));
  double map[4];
  read_map(smoke, g, way, squared, map);
  fum_heard h = {along, g->sigma, g->cut, g->density * there * map[3], {0.0}, {0.0}, {0.0}, g->set};
  for (int c = 0; c < 3; c++) {
    h.tint[c] = g->tint[c];
    h.scattering[c] = (double)albedo[c] * (g->density * there) * map[c] * h.tint[c];
    h.glow[c] = (double)glow[c] * there * map[c];
  }
  list->items[list->count++] = h;
  return true;
}

static int compare_begin(const void *a, const void *b) {
  const fum_heard *x = a, *y = b;
  const double p = x->along - x->cut, q = y->along - y->cut;
  return (p > q) - (p < q);
}

bool fum_smoke_listen(const fum_smoke *smoke, const fum_way *way, fum_heard_list *list) {
  double s, squared;
  list->count = 0;
  for (int64_t c = 0; c < smoke->cell_count; c++) {
    if (!is_cell_near(&smoke->cells[c], way)) continue;
    for (int64_t i = smoke->cells[c].begin; i < smoke->cells[c].end; i++) {
      const fum_gaussian *g = &smoke->gaussians[i];
      if (!smoke->scene->particles[g->set].is_visible_to_camera) continue;
      if (pass(g, way, &s, &squared) && !append(smoke, g, way, s, squared, list)) return false;
    }
  }
  if (list->count > 1) qsort(list->items, (size_t)list->count, sizeof *list->items, compare_begin);
  return true;
}
