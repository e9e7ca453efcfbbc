/* SPDX-License-Identifier: GPL-3.0-or-later */
#include "lighting/lattice.h"

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

/* A bit for each sample: a word holds a block of 8 x 8 samples of a face, bit 8 row + column, so that what a particle
 * needs is in a few words. */
typedef struct marks {
  _Atomic uint64_t *words;
  int64_t *firsts; /* [face_count + 1] of each face */
} marks;

static int64_t blocks_across(const fum_lattice_face *grid) {
  return (grid->columns + 7) / 8;
}

static int32_t begin_marks(fum_context *context, const fum_lattice *lattice, marks *m) {
  const char *what = "lattice of light";
  int32_t status = fum_alloc(context, lattice->face_count + 1, sizeof *m->firsts, what, &m->firsts);
  if (status != FUM_OK) return status;
  for (int32_t f = 0; f < lattice->face_count; f++) {
    const fum_lattice_face *grid = &lattice->faces[f];
    m->firsts[f + 1] = m->firsts[f] + blocks_across(grid) * ((grid->rows + 7) / 8);
  }
  return fum_alloc(context, m->firsts[lattice->face_count], sizeof *m->words, what, &m->words);
}

static void end_marks(fum_context *context, marks *m) {
  fum_free(context, &m->words);
  fum_free(context, &m->firsts);
}

static void mark_word(marks *m, int64_t word, uint64_t bits) {
  if ((atomic_load_explicit(&m->words[word], memory_order_relaxed) & bits) != bits)
    atomic_fetch_or_explicit(&m->words[word], bits, memory_order_relaxed);
}

/* Those of 0..7 that are from `first` to `last` beyond `base`, as bits. */
static uint64_t bits_within(int32_t base, int32_t first, int32_t last) {
  const int32_t low = first > base ? first - base : 0, high = last < base + 7 ? last - base : 7;
  return (UINT64_C(2) << high) - (UINT64_C(1) << low);
}

/* Eight bits to the lowest ones of eight bytes. */
static uint64_t spread_rows(uint64_t bits) {
  const uint64_t nibbles = (bits | bits << 28) & UINT64_C(0x0000000f0000000f);
  const uint64_t pairs = (nibbles | nibbles << 14) & UINT64_C(0x0003000300030003);
  return (pairs | pairs << 7) & UINT64_C(0x0101010101010101);
}

static int32_t clamp(float value, int32_t high) {
  return value < 0.0F ? 0 : value > (float)high ? high : (int32_t)value;
}

/* Marks the samples of one face that interpolation needs in a rectangle of the window. */
static void mark_face(const fum_lattice_face *grid, int64_t first_word, const float lower[2], const float upper[2],
                      marks *m) {
  if (grid->columns == 0) return;
  const float per_column = 1.0F / grid->spacing[0], per_row = 1.0F / grid->spacing[1];
  const int32_t c0 = clamp((lower[0] - grid->origin[0]) * per_column - 1.5F, grid->columns - 1);
  const int32_t c1 = clamp((upper[0] - grid->origin[0]) * per_column + 2.5F, grid->columns - 1);
  const int32_t r0 = clamp((lower[1] - grid->origin[1]) * per_row - 1.5F, grid->rows - 1);
  const int32_t r1 = clamp((upper[1] - grid->origin[1]) * per_row + 2.5F, grid->rows - 1);
  for (int32_t row = r0 & ~7; row <= r1; row += 8) {
    const uint64_t rows = spread_rows(bits_within(row, r0, r1));
    const int64_t word = first_word + row / 8 * blocks_across(grid);
    for (int32_t column = c0 & ~7; column <= c1; column += 8)
      mark_word(m, word + column / 8, rows * bits_within(column, c0, c1));
  }
}

/* Where a particle's footprint is in the window, as a whole and in parts. */
typedef struct outline {
  float center[2], half[2]; /* of all of it */
  float lower[2], upper[2]; /* within the window */
  bool is_close;            /* around the camera: no part of it is known to be smaller */
} outline;

/* False if it isn't in the frame. */
static bool find_outline(const fum_view *view, const double center[3], double reach, outline *out) {
  const bool is_perspective = view->type == FUM_CAMERA_PERSPECTIVE;
  const double depth = is_perspective ? -center[2] : 1.0, per_depth = 1.0 / depth;
  const double near = is_perspective ? 1.0 / (depth - reach) : 1.0;
  fum_view_cover(view, center, reach, out->lower, out->upper);
  out->is_close = is_perspective && depth <= 1.01 * reach;
  for (int axis = 0; axis < 2; axis++) {
    out->center[axis] = (float)(center[axis] * per_depth);
    out->half[axis] = (float)((fabs(center[axis]) + reach) * near - fabs(center[axis]) * per_depth);
  }
  return out->lower[0] < out->upper[0] && out->lower[1] < out->upper[1];
}

/* Marks what a sphere in the particle, `share` of its radius, needs on a face. The outline of a sphere grows at least
 * in proportion to its radius. */
static void mark_part(const outline *o, float share, const fum_lattice_face *grid, int64_t first_word, marks *m) {
  float lower[2], upper[2];
  for (int axis = 0; axis < 2; axis++) {
    const float half = o->half[axis] * share;
    const float low = o->center[axis] - half, high = o->center[axis] + half;
    lower[axis] = o->is_close || low < o->lower[axis] ? o->lower[axis] : low;
    upper[axis] = o->is_close || high > o->upper[axis] ? o->upper[axis] : high;
  }
  if (lower[0] < upper[0] && lower[1] < upper[1]) mark_face(grid, first_word, lower, upper, m);
}

static void mark_particle(const fum_octree *octree, const fum_view *view, const fum_slabs *slabs,
                          float footprint_sigmas, const fum_lattice *lattice, int64_t i, marks *m) {
  const double local[3] = {(double)octree->x[i], (double)octree->y[i], (double)octree->z[i]};
  const double reach =
      fum_footprint((double)footprint_sigmas, (double)octree->optical_depths[i]) / (double)octree->inverse_sigmas[i];
  double c[3];
  outline o;
  fum_transform_point(view->camera_from_local, local, c);
  const bool is_perspective = view->type == FUM_CAMERA_PERSPECTIVE;
  const double range = is_perspective ? sqrt(c[0] * c[0] + c[1] * c[1] + c[2] * c[2]) : -c[2];
  if (-c[2] + reach < view->clip_start || !(octree->optical_depths[i] > 0.0F)) return;
  if (!find_outline(view, c, reach, &o)) return;
  const fum_face *faces = slabs->faces;
  const float middle = (float)range, radius = (float)reach, per_radius = 1.0F / radius;
  for (int32_t f = fum_slab_at(slabs, range - reach); f <= slabs->count; f++) {
    /* Light on a face serves the slabs on both of its sides. */
    const float before = faces[f > 0 ? f - 1 : f].range, next = faces[f < slabs->count ? f + 1 : f].range;
    const float gap = before > middle ? before - middle : next < middle ? middle - next : 0.0F;
    const float along = gap * per_radius;
    if (along <= 1.0F) mark_part(&o, sqrtf(1.0F - along * along), &lattice->faces[f], m->firsts[f], m);
    if (faces[f].range > middle + radius) break;
  }
}

static int32_t mark_samples(fum_context *context, const fum_octree *octree, const fum_view *view,
                            const fum_slabs *slabs, float footprint_sigmas, const fum_lattice *lattice, marks *m) {
#pragma omp parallel for num_threads(fum_thread_count(context)) schedule(static)
  for (int64_t i = 0; i < octree->count; i++) {
    if (fum_progress_in_loop(context, i, 1 << 12)) continue;
    mark_particle(octree, view, slabs, footprint_sigmas, lattice, i, m);
  }
  return fum_progress_report(context, FUM_STAGE_LIGHTING, 0.0F, "Placing samples of light");
}

/* The sample of a bit; its column and row as well. */
static int64_t sample_of(const fum_lattice_face *grid, int64_t block, int bit, int64_t out_place[2]) {
  out_place[0] = block % blocks_across(grid) * 8 + bit % 8;
  out_place[1] = block / blocks_across(grid) * 8 + bit / 8;
  return grid->first + out_place[1] * grid->columns + out_place[0];
}

static int32_t collect(fum_context *context, const marks *m, fum_lattice *lattice) {
  int64_t n = 0, place[2];
  for (int64_t w = 0; w < m->firsts[lattice->face_count]; w++)
    lattice->lit_count += __builtin_popcountll(m->words[w]);
  const int32_t status =
      fum_alloc(context, lattice->lit_count, sizeof *lattice->samples, "lattice of light", &lattice->samples);
  for (int32_t f = 0; f < lattice->face_count && status == FUM_OK; f++) {
    for (int64_t w = m->firsts[f]; w < m->firsts[f + 1]; w++) {
      for (uint64_t word = m->words[w]; word != 0; word &= word - 1) {
        const int bit = __builtin_ctzll(word);
        lattice->samples[n++] = (uint32_t)sample_of(&lattice->faces[f], w - m->firsts[f], bit, place);
      }
    }
  }
  return status;
}

/* Forgets the marks of samples that the camera can't see. */
static void unmark_hidden(fum_context *context, const fum_lattice *lattice, marks *m) {
  if (lattice->hidden.depths == NULL) return;
#pragma omp parallel for num_threads(fum_thread_count(context)) schedule(dynamic)
  for (int32_t f = 0; f < lattice->face_count; f++) {
    const fum_lattice_face *grid = &lattice->faces[f];
    for (int64_t w = m->firsts[f]; w < m->firsts[f + 1]; w++) {
      uint64_t kept = 0;
      for (uint64_t word = m->words[w]; word != 0; word &= word - 1) {
        int64_t place[2];
        (void)sample_of(grid, w - m->firsts[f], __builtin_ctzll(word), place);
        const float u = grid->origin[0] + grid->spacing[0] * (float)place[0];
        const float v = grid->origin[1] + grid->spacing[1] * (float)place[1];
        if (!fum_hidden_ask(&lattice->hidden, f, u, v)) kept |= word & (~word + 1);
      }
      m->words[w] = kept;
    }
  }
}

/* Optical depth that nothing is seen through: more would only swing in the interpolation. */
static const float OPAQUE = 20.0F;

int32_t fum_lattice_place(fum_context *context, const fum_octree *octree, const fum_view *view, const fum_slabs *slabs,
                          float footprint_sigmas, float tolerance, fum_lattice *out_lattice) {
  fum_lattice lattice = {0};
  marks m = {0};
  int32_t status = lay_faces(context, view, slabs, &lattice);
  if (status == FUM_OK && lattice.sample_count > UINT32_MAX - 64) {
    status = fum_fail(context, FUM_ERROR_MEMORY, "lattice of light: %lld samples are too many; raise the tolerance",
                      (long long)lattice.sample_count);
  }
  if (status == FUM_OK) status = begin_marks(context, &lattice, &m);
  if (status == FUM_OK) status = mark_samples(context, octree, view, slabs, footprint_sigmas, &lattice, &m);
  if (status == FUM_OK)
    status = fum_hidden_find(context, octree, view, slabs, lattice.faces, tolerance, &lattice.hidden);
  if (status == FUM_OK) unmark_hidden(context, &lattice, &m);
  if (status == FUM_OK) status = collect(context, &m, &lattice);
  if (status == FUM_OK) {
    *out_lattice = lattice;
    lattice = (fum_lattice){0};
  }
  end_marks(context, &m);
  fum_lattice_free(context, &lattice);
  return status;
}

/* Where the samples are, [3 lit_count]. */
static void place_samples(const fum_view *view, const fum_slabs *slabs, const fum_lattice *lattice, float *positions) {
  int32_t f = 0;
  for (int64_t n = 0; n < lattice->lit_count; n++) {
    while (f + 1 < lattice->face_count && lattice->samples[n] >= lattice->faces[f + 1].first)
      f++;
    const fum_lattice_face *grid = &lattice->faces[f];
    const int64_t i = lattice->samples[n] - grid->first;
    const float u = grid->origin[0] + grid->spacing[0] * (float)(i % grid->columns);
    const float v = grid->origin[1] + grid->spacing[1] * (float)(i / grid->columns);
    double local[3];
    fum_view_point(view, (double)u, (double)v, (double)slabs->faces[f].range, local);
    for (int axis = 0; axis < 3; axis++)
      positions[3 * n + axis] = (float)local[axis];
  }
}

/* `points` are the samples, `receivers` made of them. */
static int32_t light_points(const fum_gathering *g, const fum_octree *points, const fum_lamp *lamps,
                            fum_lattice *lattice) {
  fum_context *context = g->context;
  float *depths = NULL, *visible = NULL;
  int32_t total = 0, done_samples = 0;
  for (int32_t l = 0; l < lattice->light_count; l++)
    total += lamps[l].sample_count;
  int32_t status = fum_alloc(context, points->count, sizeof *depths, "lattice of light", &depths);
  if (status == FUM_OK && lattice->visible != NULL)
    status = fum_alloc(context, points->count, sizeof *visible, "lattice of light", &visible);
  for (int32_t l = 0; l < lattice->light_count && status == FUM_OK; l++) {
    const float from = (float)done_samples / (float)total;
    done_samples += lamps[l].sample_count;
    status = fum_gather_depths(g, &lamps[l], (float[2]){from, (float)done_samples / (float)total}, depths, visible);
    if (status != FUM_OK) break;
    const int64_t base_index = l * lattice->sample_count;
    const bool is_per_metre = fum_lattice_is_per_metre(&lamps[l]);
    for (int64_t i = 0; i < points->count; i++) {
      const int64_t at = base_index + lattice->samples[points->indices[i]];
      const fum_vec3 point = {points->x[i], points->y[i], points->z[i]};
      const float distance = is_per_metre ? fum_length(fum_sub(lamps[l].position, point)) : 1.0F;
      lattice->depths[at] = fminf(depths[i], OPAQUE) / fmaxf(distance, 1e-20F);
      if (visible != NULL) lattice->visible[at] = visible[i];
    }
  }
  fum_free(context, &visible);
  fum_free(context, &depths);
  return status;
}

static int32_t allocate_values(const fum_gathering *g, fum_lattice *lattice) {
  const int64_t values = lattice->sample_count * lattice->light_count;
  int32_t status = fum_alloc(g->context, values, sizeof *lattice->depths, "lattice of light", &lattice->depths);
  for (int64_t i = 0; i < values && status == FUM_OK; i++)
    lattice->depths[i] = NAN;
  if (status == FUM_OK && g->solids != NULL)
    status = fum_alloc(g->context, values, sizeof *lattice->visible, "lattice of light", &lattice->visible);
  return status;
}

int32_t fum_lattice_light(const fum_gathering *gathering, const fum_view *view, const fum_slabs *slabs,
                          int32_t light_count, const fum_lamp *lamps, fum_lattice *lattice) {
  fum_context *context = gathering->context;
  const double *origin = gathering->medium->octree->origin;
  fum_gathering g = *gathering;
  fum_receivers receivers = {0};
  fum_octree *points = NULL;
  float *positions = NULL;
  lattice->light_count = light_count;
  int32_t status = allocate_values(&g, lattice);
  if (status == FUM_OK)
    status = fum_alloc(context, lattice->lit_count, 3 * sizeof *positions, "lattice of light", &positions);
  if (status != FUM_OK) goto done;
  place_samples(view, slabs, lattice, positions);
  status = fum_octree_build_points(context, origin, lattice->lit_count, positions, FUM_GROUP_SIZE, &points);
  fum_free(context, &positions);
  if (status == FUM_OK) status = fum_receivers_group(context, points, &receivers);
  g.receivers = &receivers;
  if (status == FUM_OK) status = light_points(&g, points, lamps, lattice);
done:
  fum_receivers_free(context, &receivers);
  fum_octree_destroy(context, points);
  fum_free(context, &positions);
  return status;
}

void fum_lattice_forget(fum_context *context, fum_lattice *lattice) {
  fum_free(context, &lattice->depths);
  fum_free(context, &lattice->visible);
}

void fum_lattice_free(fum_context *context, fum_lattice *lattice) {
  fum_lattice_forget(context, lattice);
  fum_hidden_free(context, &lattice->hidden);
  fum_free(context, &lattice->faces);
  fum_free(context, &lattice->samples);
}
