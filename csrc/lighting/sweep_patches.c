/* SPDX-License-Identifier: GPL-3.0-or-later */
#include "lighting/sweep_patches.h"

#include <string.h>

/* Grid lines across a patch, and patches across a face. */
enum { PATCH_CELLS = 64, MOST_PATCHES = 256 };

static void cross(const double a[3], const double b[3], double out[3]) {
  for (int axis = 0; axis < 3; axis++) {
    const int next = (axis + 1) % 3, last = (axis + 2) % 3;
    out[axis] = a[next] * b[last] - a[last] * b[next];
  }
}

static double dot(const double a[3], const double b[3]) {
  return a[0] * b[0] + a[1] * b[1] + a[2] * b[2];
}

static fum_vec3 to_floats(const double v[3]) {
  return (fum_vec3){(float)v[0], (float)v[1], (float)v[2]};
}

/* A face that looks along `axis` (unit), with the window -half..half. */
static void aim_face(const double to_middle[3], const double axis[3], double half, fum_sweep_face *out) {
  double helper[3] = {0.0, 0.0, 0.0}, right[3], up[3];
  helper[fabs(axis[0]) < 0.6 ? 0 : 1] = 1.0;
  cross(axis, helper, right);
  const double length = sqrt(dot(right, right));
  for (int i = 0; i < 3; i++)
    right[i] /= length;
  cross(right, axis, up);
  *out =
      (fum_sweep_face){.right = to_floats(right),
                       .up = to_floats(up),
                       .axis = to_floats(axis),
                       .offset = {(float)dot(to_middle, right), (float)dot(to_middle, up), (float)dot(to_middle, axis)},
                       .lower = {(float)-half, (float)-half},
                       .upper = {(float)half, (float)half}};
}

/* Distances of the casters from the light, and whether each is small as seen from it. */
static bool measure(const fum_medium *medium, fum_sweep_view *view) {
  const double widest = 0.1; /* sigma over distance */
  const fum_octree *casters = fum_medium_casters(medium);
  const double *o = view->to_middle, squared = dot(o, o);
  double nearest = INFINITY, farthest = 0.0;
  for (int64_t i = 0; i < casters->count; i++) {
    if (!(casters->optical_depths[i] > 0.0F)) continue;
    const double q[3] = {(double)(casters->x[i] - view->middle.x), (double)(casters->y[i] - view->middle.y),
                         (double)(casters->z[i] - view->middle.z)};
    const double distance = sqrt(squared + 2.0 * dot(o, q) + dot(q, q));
    if (widest * distance * (double)casters->inverse_sigmas[i] < (double)medium->sigma_scale) return false;
    nearest = distance < nearest ? distance : nearest;
    farthest = distance > farthest ? distance : farthest;
  }
  view->nearest = nearest;
  view->farthest = farthest;
  view->reference = sqrt(nearest * farthest);
  return farthest <= 100.0 * nearest;
}

bool fum_sweep_view_find(const fum_medium *medium, const fum_emitter *emitter, fum_sweep_view *out_view) {
  const fum_octree *casters = fum_medium_casters(medium);
  fum_sweep_view view = {.is_parallel = emitter->is_directional, .face_count = 1};
  if (casters->node_count == 0) return false;
  const fum_octree_node *root = &casters->nodes[0];
  double middle[3], squared = 0.0;
  for (int axis = 0; axis < 3; axis++) {
    const double side = (double)root->upper[axis] - (double)root->lower[axis];
    middle[axis] = 0.5 * ((double)root->upper[axis] + (double)root->lower[axis]);
    squared += 0.25 * side * side;
  }
  view.middle = to_floats(middle);
  const double radius = sqrt(squared), parallel = 1e4,
               light[3] = {(double)emitter->position.x, (double)emitter->position.y, (double)emitter->position.z};
  double axis[3] = {-(double)emitter->direction.x, -(double)emitter->direction.y, -(double)emitter->direction.z};
  if (!view.is_parallel) {
    double distance;
    for (int i = 0; i < 3; i++)
      axis[i] = view.to_middle[i] = (double)((float[3]){view.middle.x, view.middle.y, view.middle.z})[i] - light[i];
    distance = sqrt(dot(axis, axis));
    view.is_parallel = distance > parallel * radius;
    for (int i = 0; i < 3 && distance > 0.0; i++)
      axis[i] /= distance;
    if (!view.is_parallel && !measure(medium, &view)) return false;
    if (!view.is_parallel && distance < 1.5 * radius) { /* all around */
      view.face_count = FUM_SWEEP_FACES;
      for (int f = 0; f < FUM_SWEEP_FACES; f++) {
        double side[3] = {0.0};
        side[f / 2] = f % 2 == 0 ? 1.0 : -1.0;
        aim_face(view.to_middle, side, 1.001, &view.faces[f]);
      }
      *out_view = view;
      return true;
    }
  }
  if (view.is_parallel) memset(view.to_middle, 0, sizeof view.to_middle);
  const double distance = sqrt(dot(view.to_middle, view.to_middle));
  /* Twice the tangent of the cone around the casters: receivers beyond are few and in nobody's shadow. */
  const double half = view.is_parallel ? radius : radius / sqrt(distance * distance - squared);
  aim_face(view.to_middle, axis, 1.05 * half + 1e-30, &view.faces[0]);
  *out_view = view;
  return true;
}

float fum_sweep_sigma(const fum_sweep_view *view, const fum_octree *casters, int64_t i, float sigma_scale) {
  const float sigma = sigma_scale / casters->inverse_sigmas[i];
  if (view->is_parallel) return sigma;
  const fum_sweep_face *face = &view->faces[0];
  const fum_vec3 q = {casters->x[i] - view->middle.x, casters->y[i] - view->middle.y, casters->z[i] - view->middle.z};
  const fum_vec3 p = {fum_dot(q, face->right) + face->offset[0], fum_dot(q, face->up) + face->offset[1],
                      fum_dot(q, face->axis) + face->offset[2]};
  return sigma / fum_length(p);
}

bool fum_sweep_lay(const fum_sweep_level *level, fum_sweep_view *view, int64_t *out_count) {
  int64_t count = 0;
  for (int f = 0; f < view->face_count; f++) {
    fum_sweep_face *face = &view->faces[f];
    const double cells = (double)(face->upper[0] - face->lower[0]) / (double)level->cell;
    /* A patch is small against the sphere too, so that its cells are alike. */
    const double least = view->is_parallel ? 1.0 : ceil((double)(face->upper[0] - face->lower[0]) / 0.25);
    const double patches = fmax(least, ceil(cells / PATCH_CELLS));
    if (!(patches <= MOST_PATCHES)) return false;
    face->columns = face->rows = (int32_t)patches;
    face->first_patch = count;
    count += (int64_t)face->columns * face->rows;
  }
  *out_count = count;
  return true;
}

/* What of a face a ball is seen in. */
typedef struct span {
  int32_t begin[2], end[2]; /* patches; empty where end <= begin */
} span;

static fum_vec3 see(const fum_sweep_view *view, const fum_sweep_face *face, const fum_octree *points, int64_t i) {
  const fum_vec3 q = {points->x[i] - view->middle.x, points->y[i] - view->middle.y, points->z[i] - view->middle.z};
  return (fum_vec3){fum_dot(q, face->right) + face->offset[0], fum_dot(q, face->up) + face->offset[1],
                    fum_dot(q, face->axis) + face->offset[2]};
}

static span find_span(const fum_sweep_view *view, const fum_sweep_face *face, fum_vec3 p, float radius) {
  const float lateral[2] = {p.x, p.y}, near = 1.0F / (p.z - radius), far = 1.0F / (p.z + radius);
  const int32_t counts[2] = {face->columns, face->rows};
  span s = {{0, 0}, {0, 0}};
  const bool is_beside = !view->is_parallel && p.z <= 1.01F * radius;
  if (!view->is_parallel && p.z + radius <= 0.0F) return s;
  for (int axis = 0; axis < 2; axis++) {
    float low = lateral[axis] - radius, high = lateral[axis] + radius;
    if (!view->is_parallel) {
      low = low > 0.0F ? low * far : is_beside ? -INFINITY : low * near;
      high = high < 0.0F ? high * far : is_beside ? INFINITY : high * near;
    }
    if (high < face->lower[axis] || low > face->upper[axis]) return (span){{0, 0}, {0, 0}};
    low = low > face->lower[axis] ? low : face->lower[axis];
    high = high < face->upper[axis] ? high : face->upper[axis];
    const float per_unit = (float)counts[axis] / (face->upper[axis] - face->lower[axis]);
    const int32_t first = (int32_t)((low - face->lower[axis]) * per_unit),
                  last = (int32_t)((high - face->lower[axis]) * per_unit);
    s.begin[axis] = first < counts[axis] ? first : counts[axis] - 1;
    s.end[axis] = last < counts[axis] ? last + 1 : counts[axis];
  }
  return s;
}

/* Lists are filled in two rounds: the first counts, the second writes where the first has counted. */
typedef struct filling {
  int64_t *cursors;
  uint32_t *out; /* NULL: only counts */
} filling;

static void put(const filling *f, int64_t patch, int64_t i) {
  const int64_t at = f->cursors[patch]++;
  if (f->out != NULL) f->out[at] = (uint32_t)i;
}

/* What both rounds look at. */
typedef struct sorting {
  const fum_sweep_view *view;
  const fum_sweep_level *level;
  const fum_octree *casters, *points;
  const uint8_t *is_lit;
  float sigma_scale;
} sorting;

static void put_caster(const sorting *s, int64_t i, const filling *f) {
  const fum_sweep_level *level = s->level;
  const float seen = fum_sweep_sigma(s->view, s->casters, i, s->sigma_scale);
  if (!(seen >= level->smallest && seen < level->largest && s->casters->optical_depths[i] > 0.0F)) return;
  const float sigma = s->sigma_scale / s->casters->inverse_sigmas[i];
  const float radius = sigma * (FUM_SWEEP_REACH + FUM_SWEEP_MARGIN * level->cell / seen);
  for (int n = 0; n < s->view->face_count; n++) {
    const fum_sweep_face *face = &s->view->faces[n];
    const span patches = find_span(s->view, face, see(s->view, face, s->casters, i), radius);
    for (int32_t row = patches.begin[1]; row < patches.end[1]; row++) {
      for (int32_t column = patches.begin[0]; column < patches.end[0]; column++)
        put(f, face->first_patch + (int64_t)row * face->columns + column, i);
    }
  }
}

/* The face whose axis is nearest to the point. */
static void put_receiver(const sorting *s, int64_t i, const filling *f) {
  if (!s->is_lit[i]) return;
  const fum_sweep_face *best = &s->view->faces[0];
  fum_vec3 p = see(s->view, best, s->points, i);
  for (int n = 1; n < s->view->face_count; n++) {
    const fum_vec3 other = see(s->view, &s->view->faces[n], s->points, i);
    if (other.z <= p.z) continue;
    best = &s->view->faces[n];
    p = other;
  }
  const span patches = find_span(s->view, best, p, 0.0F);
  if (patches.begin[0] < patches.end[0])
    put(f, best->first_patch + (int64_t)patches.begin[1] * best->columns + patches.begin[0], i);
}

/* Counting sort: each block of items counts, then writes to places of its own, so that every list stays in order
 * whatever the number of threads. */
static int32_t fill(fum_context *context, const sorting *s, bool is_casters, int64_t patch_count, int64_t *begins,
                    uint32_t **out_list) {
  const char *what = "patches of a light";
  const int64_t count = is_casters ? s->casters->count : s->points->count;
  const int blocks = fum_thread_count(context);
  int64_t *cursors = NULL, total = 0;
  int32_t status = fum_alloc(context, blocks * patch_count, sizeof *cursors, what, &cursors);
  if (status != FUM_OK) return status;
  for (int round = 0; round < 2 && status == FUM_OK; round++) {
#pragma omp parallel for num_threads(blocks) schedule(static, 1)
    for (int block = 0; block < blocks; block++) {
      const filling f = {cursors + block * patch_count, *out_list};
      const int64_t end = count * (block + 1) / blocks;
      for (int64_t i = count * block / blocks; i < end; i++)
        (is_casters ? put_caster : put_receiver)(s, i, &f);
    }
    if (round == 1) break;
    for (int64_t patch = 0; patch < patch_count; patch++) {
      begins[patch] = total;
      for (int block = 0; block < blocks; block++) {
        const int64_t n = cursors[block * patch_count + patch];
        cursors[block * patch_count + patch] = total;
        total += n;
      }
    }
    begins[patch_count] = total;
    status = fum_alloc(context, total, sizeof **out_list, what, out_list);
  }
  fum_free(context, &cursors);
  return status;
}

int32_t fum_sweep_sort(fum_context *context, const fum_medium *medium, const fum_receivers *receivers,
                       const uint8_t *is_lit, const fum_sweep_view *view, const fum_sweep_level *level,
                       fum_sweep_patches *patches) {
  const char *what = "patches of a light";
  const sorting s = {view, level, fum_medium_casters(medium), receivers->octree, is_lit, medium->sigma_scale};
  int32_t status = fum_alloc(context, patches->count + 1, sizeof(int64_t), what, &patches->caster_begins);
  if (status == FUM_OK)
    status = fum_alloc(context, patches->count + 1, sizeof(int64_t), what, &patches->receiver_begins);
  if (status == FUM_OK)
    status = fill(context, &s, false, patches->count, patches->receiver_begins, &patches->receivers);
  if (status == FUM_OK) status = fill(context, &s, true, patches->count, patches->caster_begins, &patches->casters);
  return status;
}

void fum_sweep_patches_free(fum_context *context, fum_sweep_patches *patches) {
  fum_free(context, &patches->caster_begins);
  fum_free(context, &patches->receiver_begins);
  fum_free(context, &patches->casters);
  fum_free(context, &patches->receivers);
}
