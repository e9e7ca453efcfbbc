/* SPDX-License-Identifier: GPL-3.0-or-later */
#include "lighting/lattice.h"

#include "lighting/lattice_groups.h"
#include "lighting/lattice_spline.h"

#include <stdlib.h>
#include <string.h>

/* Samples that cubic interpolation wants beyond a point on either side, and one for rounding. */
enum { MARGIN = 3 };

/* Samples stand at multiples of their spacing, so that a small change of the smoke's bounds moves none. Closer than
 * pixels there is nothing to see: then they stand on the pixels' centres. Returns how many there are along the axis. */
static int32_t lay_axis(const fum_view *view, const fum_face *face, int axis, double wanted, fum_lattice_face *grid) {
  const double pixel =
      (view->window[2 * axis + 1] - view->window[2 * axis]) / (double)(axis == 0 ? view->width : view->height);
  const bool on_pixels = wanted < pixel;
  grid->is_on_pixels = grid->is_on_pixels || on_pixels;
  const double spacing = on_pixels ? pixel : wanted, phase = on_pixels ? view->window[2 * axis] + 0.5 * pixel : 0.0;
  const double first = floor(((double)face->lower[axis] - phase) / spacing) - MARGIN;
  const double last = ceil(((double)face->upper[axis] - phase) / spacing) + MARGIN;
  grid->spacing[axis] = (float)spacing;
  grid->origin[axis] = (float)(phase + first * spacing);
  return (int32_t)(last - first) + 1;
}

static int32_t lay_faces(fum_context *context, const fum_view *view, const fum_slabs *slabs, fum_lattice *lattice) {
  lattice->face_count = slabs->count + 1;
  int32_t status = fum_alloc(context, lattice->face_count, sizeof *lattice->faces, "lattice of light", &lattice->faces);
  if (status != FUM_OK) return status;
  const bool is_perspective = view->type == FUM_CAMERA_PERSPECTIVE;
  for (int32_t f = 0; f < lattice->face_count; f++) {
    const fum_face *face = &slabs->faces[f];
    fum_lattice_face *grid = &lattice->faces[f];
    grid->first = lattice->sample_count;
    if (!(face->lower[0] < face->upper[0] && face->lower[1] < face->upper[1] && face->spacing > 0.0F)) continue;
    /* Half a unit of the window at most: farther apart, rays near a wide view's edge bunch together. */
    const double spacing = (double)face->spacing, range = (double)face->range;
    const double wanted = is_perspective ? spacing / fmax(range, 2.0 * spacing) : spacing;
    int32_t counts[2];
    for (int axis = 0; axis < 2; axis++)
      counts[axis] = lay_axis(view, face, axis, wanted, grid);
    grid->columns = counts[0];
    grid->rows = counts[1];
    lattice->sample_count += (int64_t)grid->columns * grid->rows;
  }
  return FUM_OK;
}

/* Optical depth that nothing is seen through: more would only swing in the interpolation. */
static const float OPAQUE = 20.0F;

int32_t fum_lattice_place(fum_context *context, const fum_octree *octree, const fum_view *view, const fum_slabs *slabs,
                          float footprint_sigmas, float tolerance, fum_lattice *out_lattice) {
  fum_lattice lattice = {0};
  fum_marks marks = {0};
  int32_t status = lay_faces(context, view, slabs, &lattice);
  if (status == FUM_OK && lattice.sample_count > UINT32_MAX - 64) {
    status = fum_fail(context, FUM_ERROR_MEMORY, "lattice of light: %lld samples are too many; raise the tolerance",
                      (long long)lattice.sample_count);
  }
  const fum_mark_task task = {octree, view, slabs, &lattice, footprint_sigmas};
  if (status == FUM_OK) status = fum_marks_begin(context, &lattice, &marks);
  if (status == FUM_OK) status = fum_marks_set(context, &task, &marks);
  if (status == FUM_OK)
    status = fum_hidden_find(context, octree, view, slabs, lattice.faces, tolerance, &lattice.hidden);
  if (status == FUM_OK) fum_marks_unset_hidden(context, &lattice, &marks);
  if (status == FUM_OK) status = fum_lattice_group(context, &marks, &lattice);
  if (status == FUM_OK) {
    *out_lattice = lattice;
    lattice = (fum_lattice){0};
  }
  fum_marks_end(context, &marks);
  fum_lattice_free(context, &lattice);
  return status;
}

/* The face of a sample: the last one that begins at it or before and has any. */
static int32_t face_of(const fum_lattice *lattice, uint32_t sample) {
  int32_t low = 0, high = lattice->face_count - 1;
  while (low < high) {
    const int32_t middle = (low + high + 1) / 2;
    if (lattice->faces[middle].first <= sample) {
      low = middle;
    } else {
      high = middle - 1;
    }
  }
  return low;
}

/* Where the samples of a group are. */
static void place_group(const fum_view *view, const fum_slabs *slabs, const fum_lattice *lattice, int64_t group,
                        fum_octree *points) {
  const uint32_t begin = lattice->group_begins[group], end = lattice->group_begins[group + 1];
  int32_t f = face_of(lattice, lattice->samples[begin]);
  for (uint32_t n = begin; n < end; n++) {
    const uint32_t sample = lattice->samples[n];
    while (f + 1 < lattice->face_count && lattice->faces[f + 1].first <= sample)
      f++;
    const fum_lattice_face *grid = &lattice->faces[f];
    const uint32_t i = sample - (uint32_t)grid->first, columns = (uint32_t)grid->columns;
    const float u = grid->origin[0] + grid->spacing[0] * (float)(i % columns);
    const float v = grid->origin[1] + grid->spacing[1] * (float)(i / columns);
    double local[3];
    fum_view_point(view, (double)u, (double)v, (double)slabs->faces[f].range, local);
    points->indices[n] = n;
    points->x[n] = (float)local[0];
    points->y[n] = (float)local[1];
    points->z[n] = (float)local[2];
  }
  points->nodes[group] = (fum_octree_node){.begin = begin, .count = end - begin};
}

/* The samples as an octree of points that has leaves alone: the groups. */
static int32_t place_samples(fum_context *context, const double origin[3], const fum_view *view, const fum_slabs *slabs,
                             const fum_lattice *lattice, fum_octree **out_points) {
  fum_octree *points = NULL;
  int32_t status = fum_octree_create(context, origin, lattice->lit_count, false, &points);
  if (status == FUM_OK)
    status = fum_alloc(context, lattice->group_count, sizeof *points->nodes, "lattice of light", &points->nodes);
  if (status != FUM_OK) {
    fum_octree_destroy(context, points);
    return status;
  }
  points->node_count = lattice->group_count;
#pragma omp parallel for num_threads(fum_thread_count(context)) schedule(static)
  for (int64_t group = 0; group < lattice->group_count; group++)
    place_group(view, slabs, lattice, group, points);
  fum_octree_bound(context, points);
  *out_points = points;
  return FUM_OK;
}

/* Keeps what was found of a lamp at the points. */
static void keep_values(fum_context *context, const fum_octree *points, const fum_lamp *lamp, const float *depths,
                        const float *visible, fum_lattice *lattice) {
  const int64_t base_index = lamp->index * lattice->sample_count;
  const bool is_per_metre = fum_lattice_is_per_metre(lamp);
#pragma omp parallel for num_threads(fum_thread_count(context)) schedule(static)
  for (int64_t i = 0; i < points->count; i++) {
    const int64_t at = base_index + lattice->samples[points->indices[i]];
    const fum_vec3 point = {points->x[i], points->y[i], points->z[i]};
    const float distance = is_per_metre ? fum_length(fum_sub(lamp->position, point)) : 1.0F;
    lattice->depths[at] = fum_min(depths[i], OPAQUE) / fum_max(distance, 1e-20F);
    if (visible != NULL) lattice->visible[at] = visible[i];
  }
}

/* `points` are the samples, `receivers` made of them. */
static int32_t light_points(const fum_gathering *g, const fum_octree *points, const fum_lamps *lamps,
                            fum_lattice *lattice) {
  fum_context *context = g->context;
  const int64_t count = points->count;
  float *depths = NULL, *visible = NULL;
  const float total = (float)fum_lamps_sample_count(lamps);
  const int32_t most_alike = fum_lamps_most_alike(lamps);
  int32_t done_samples = 0;
  int32_t status = fum_alloc(context, most_alike * count, sizeof *depths, "lattice of light", &depths);
  if (status == FUM_OK && lattice->visible != NULL)
    status = fum_alloc(context, most_alike * count, sizeof *visible, "lattice of light", &visible);
  for (int32_t l = 0, alike; l < lamps->count && status == FUM_OK; l += alike) {
    const fum_lamp *lamp = &lamps->items[l];
    const float from = (float)done_samples / total;
    done_samples += lamp->sample_count;
    const float progress[2] = {from, (float)done_samples / total};
    alike = fum_lamps_alike(lamps, l);
    if (!lamp->lights_smoke) continue;
    status = lamp->environment != NULL ? fum_gather_around(g, lamp, alike, progress, depths, visible)
                                       : fum_gather_depths(g, lamp, progress, depths, visible);
    for (int32_t k = 0; k < alike && status == FUM_OK; k++)
      keep_values(context, points, &lamp[k], depths + k * count, visible != NULL ? visible + k * count : NULL, lattice);
  }
  fum_free(context, &visible);
  fum_free(context, &depths);
  return status;
}

/* Where the camera doesn't see, because a solid is before it. */
static bool is_behind_solid(const fum_gathering *g, const double local[3]) {
  const fum_vec3 point = {(float)local[0], (float)local[1], (float)local[2]};
  const fum_vec3 to_viewer = fum_direction_to_viewer(g->viewpoint, point);
  const float far = g->viewpoint->is_directional ? 1e30F : fum_length(fum_sub(g->viewpoint->position, point));
  fum_solid_point unused;
  return fum_solids_see(g->solids, point, to_viewer, 0.0F, far, &unused) < far;
}

/* No light from all around gets into a solid, and none would be left close to it between samples outside and inside:
 * those inside get what is nearest to them on the face before. */
static void carry_into_solids(const fum_gathering *g, const fum_view *view, const fum_slabs *slabs,
                              const fum_lamp *lamp, fum_lattice *lattice) {
  const float blocked = 1.0F - g->solid_shadow_intensity + 1e-4F;
  float *depths = lattice->depths + lamp->index * lattice->sample_count;
  float *visible = lattice->visible + lamp->index * lattice->sample_count;
  for (int32_t f = 1; f < lattice->face_count; f++) {
    const fum_lattice_face *grid = &lattice->faces[f], *before = &lattice->faces[f - 1];
    const int64_t count = before->columns > 0 ? (int64_t)grid->columns * grid->rows : 0;
#pragma omp parallel for num_threads(fum_thread_count(g->context)) schedule(static)
    for (int64_t i = 0; i < count; i++) {
      const int64_t at = grid->first + i;
      if (isnan(depths[at]) || visible[at] > blocked) continue;
      const float u = grid->origin[0] + grid->spacing[0] * (float)(i % grid->columns);
      const float v = grid->origin[1] + grid->spacing[1] * (float)(i / grid->columns);
      const int64_t column = lroundf((u - before->origin[0]) / before->spacing[0]);
      const int64_t row = lroundf((v - before->origin[1]) / before->spacing[1]);
      if (column < 0 || row < 0 || column >= before->columns || row >= before->rows) continue;
      const int64_t from = before->first + row * before->columns + column;
      double local[3];
      if (isnan(depths[from]) || visible[from] <= blocked) continue;
      fum_view_point(view, (double)u, (double)v, (double)slabs->faces[f].range, local);
      if (!is_behind_solid(g, local)) continue;
      depths[at] = depths[from];
      visible[at] = visible[from];
    }
  }
}

static int32_t allocate_values(const fum_gathering *g, fum_lattice *lattice) {
  const int64_t values = lattice->sample_count * lattice->lamp_count;
  int32_t status = fum_alloc(g->context, values, sizeof *lattice->depths, "lattice of light", &lattice->depths);
  if (status != FUM_OK) return status;
#pragma omp parallel for num_threads(fum_thread_count(g->context)) schedule(static)
  for (int64_t i = 0; i < values; i++)
    lattice->depths[i] = NAN;
  if (status == FUM_OK && g->solids != NULL)
    status = fum_alloc(g->context, values, sizeof *lattice->visible, "lattice of light", &lattice->visible);
  return status;
}

int32_t fum_lattice_light(const fum_gathering *gathering, const fum_view *view, const fum_slabs *slabs,
                          const fum_lamps *lamps, fum_lattice *lattice) {
  fum_context *context = gathering->context;
  const double *origin = gathering->media->items[0].octree->origin;
  fum_gathering g = *gathering;
  fum_octree *points = NULL;
  lattice->lamp_count = lamps->count;
  int32_t status = allocate_values(&g, lattice);
  if (status == FUM_OK) status = place_samples(context, origin, view, slabs, lattice, &points);
  fum_receivers receivers = {.octree = points};
  g.receivers = &receivers;
  if (status == FUM_OK) status = light_points(&g, points, lamps, lattice);
  for (int32_t l = 0; l < lamps->count && status == FUM_OK; l++) {
    const fum_lamp *lamp = &lamps->items[l];
    if (lamp->environment != NULL && lamp->lights_smoke && lattice->visible != NULL && g.viewpoint != NULL)
      carry_into_solids(&g, view, slabs, lamp, lattice);
  }
  if (status == FUM_OK) status = fum_lattice_fit(context, lattice);
  fum_receivers_free(context, &receivers);
  fum_octree_destroy(context, points);
  return status;
}

void fum_lattice_forget(fum_context *context, fum_lattice *lattice) {
  fum_free(context, &lattice->depths);
  fum_free(context, &lattice->visible);
}

void fum_lattice_settle(fum_context *context, fum_lattice *lattice) {
  fum_hidden_free(context, &lattice->hidden);
  fum_free(context, &lattice->group_begins);
  fum_free(context, &lattice->samples);
}

void fum_lattice_free(fum_context *context, fum_lattice *lattice) {
  fum_lattice_forget(context, lattice);
  fum_lattice_settle(context, lattice);
  fum_free(context, &lattice->faces);
}
