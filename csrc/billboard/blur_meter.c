/* SPDX-License-Identifier: GPL-3.0-or-later */
#include "billboard/blur_meter.h"

#include "base/hash.h"
#include "billboard/blur_rays.h"
#include "billboard/dust.h"
#include "lighting/smears.h"
#include "scene/aperture.h"

#include <stdlib.h>
#include <string.h>

enum {
  SIDE = 16, /* pixels that are looked at, across and up */
  PIXELS = SIDE * SIDE,
  LEVELS = 3, /* numbers of pictures */
  RAYS = 64   /* of each of them, through a pixel */
};

static const int32_t PICTURES[LEVELS] = {1, 4, 16};

/* Sigmas out to which a particle is looked at. */
static const double FOOTPRINT = 3.0;

typedef struct meter {
  const fum_scene *scene;
  const fum_octree *octree;
  const fum_solids *solids; /* NULL: the camera sees none */
  const fum_camera *camera;
  const fum_view *view;
  fum_smears smears;
  fum_view views[2];         /* when the shutter opens and closes */
  double aperture[2];        /* half axes of the ellipse that has the aperture's area, m */
  double pixel;              /* side of a pixel at unit depth, or in m */
  double lower[2], upper[2]; /* part of the window that smoke is in */
  int64_t begins[PIXELS + 1];
  uint32_t *particles; /* of each pixel, in the octree's order */
} meter;

/* A particle in camera space. */
typedef struct passing {
  double start[3], move[3], sigma, optical_depth;
  double lower[2], upper[2]; /* of the window, that it is seen in */
  bool is_seen;
} passing;

/* Radius of the circle of confusion at a depth, m. */
static double confusion_at(const meter *m, double depth) {
  return fmax(m->aperture[0], m->aperture[1]) * fabs(depth - m->camera->focus_distance) / m->camera->focus_distance;
}

static void cover(const meter *m, const double center[3], double sigma, passing *p) {
  const bool is_perspective = m->view->type == FUM_CAMERA_PERSPECTIVE;
  const double depth = -center[2], radius = FOOTPRINT * sigma + confusion_at(m, depth);
  float lower[2], upper[2];
  if (depth + FOOTPRINT * sigma <= m->view->clip_start || depth - FOOTPRINT * sigma >= m->view->clip_end) return;
  if (is_perspective && depth <= 0.0) return;
  fum_view_cover(m->view, center, fmin(radius, is_perspective ? 0.98 * depth : radius), lower, upper);
  for (int axis = 0; axis < 2; axis++) {
    p->lower[axis] = p->is_seen ? fmin(p->lower[axis], (double)lower[axis]) : (double)lower[axis];
    p->upper[axis] = p->is_seen ? fmax(p->upper[axis], (double)upper[axis]) : (double)upper[axis];
  }
  p->is_seen = true;
}

static passing pass(const meter *m, int64_t rank) {
  const fum_smear *smear = &m->smears.items[rank];
  const double depth = m->view->type == FUM_CAMERA_PERSPECTIVE ? fmax(0.0, -(double)smear->center[2]) : 1.0;
  const double sigma = 1.0 / (double)m->octree->inverse_sigmas[rank];
  const double width = fmax(sigma, FUM_MIN_SIGMA_PIXELS * m->pixel * depth);
  passing p = {.sigma = width,
               .optical_depth = (double)m->octree->optical_depths[rank] * sigma * sigma / (width * width)};
  double end[3];
  for (int axis = 0; axis < 3; axis++) {
    p.move[axis] = (double)smear->path[axis];
    p.start[axis] = (double)smear->center[axis] - 0.5 * p.move[axis];
    end[axis] = p.start[axis] + p.move[axis];
  }
  cover(m, p.start, width, &p);
  cover(m, end, width, &p);
  p.is_seen = p.is_seen && p.lower[0] < p.upper[0] && p.lower[1] < p.upper[1];
  return p;
}

/* The part of the picture that smoke is in. */
static void find_bounds(meter *m) {
  double low_x = INFINITY, low_y = INFINITY, high_x = -INFINITY, high_y = -INFINITY;
  const int threads = fum_thread_count(m->scene->context);
#pragma omp parallel for num_threads(threads) reduction(min : low_x, low_y) reduction(max : high_x, high_y)
  for (int64_t i = 0; i < m->octree->count; i++) {
    const passing p = pass(m, i);
    if (!p.is_seen) continue;
    low_x = fum_least(low_x, p.lower[0]);
    low_y = fum_least(low_y, p.lower[1]);
    high_x = fum_most(high_x, p.upper[0]);
    high_y = fum_most(high_y, p.upper[1]);
  }
  memcpy(m->lower, (double[2]){low_x, low_y}, sizeof m->lower);
  memcpy(m->upper, (double[2]){high_x, high_y}, sizeof m->upper);
}

/* Window coordinate of a pixel that is looked at: somewhere in its part of the bounds, always at the same place. */
static double place_of(const meter *m, int axis, int32_t pixel) {
  const double cell = (double)(axis == 0 ? pixel % SIDE : pixel / SIDE);
  const double within = fum_hash_unit((uint64_t)(2 * pixel + axis));
  return m->lower[axis] + (m->upper[axis] - m->lower[axis]) * (cell + within) / SIDE;
}

/* Parts of the bounds, from *out_first up to, not including, *out_end, between two window coordinates. */
static void find_range(const meter *m, int axis, double low, double high, int32_t *out_first, int32_t *out_end) {
  const double per_unit = SIDE / (m->upper[axis] - m->lower[axis]);
  *out_first = (int32_t)fum_most(0.0, floor((low - m->lower[axis]) * per_unit));
  *out_end = (int32_t)fum_least(SIDE, floor((high - m->lower[axis]) * per_unit) + 1.0);
}

static bool is_within(const meter *m, const passing *p, int32_t pixel) {
  for (int axis = 0; axis < 2; axis++) {
    const double place = place_of(m, axis, pixel);
    if (place < p->lower[axis] || place > p->upper[axis]) return false;
  }
  return true;
}

/* Calls for each pixel that a particle may be seen in: counts it, or writes it down. */
static void enter(const meter *m, int64_t rank, int64_t *cursors, uint32_t *out) {
  const passing p = pass(m, rank);
  int32_t columns[2], rows[2];
  if (!p.is_seen) return;
  find_range(m, 0, p.lower[0], p.upper[0], &columns[0], &columns[1]);
  find_range(m, 1, p.lower[1], p.upper[1], &rows[0], &rows[1]);
  for (int32_t row = rows[0]; row < rows[1]; row++) {
    for (int32_t column = columns[0]; column < columns[1]; column++) {
      if (!is_within(m, &p, row * SIDE + column)) continue;
      const int64_t at = cursors[row * SIDE + column]++;
      if (out != NULL) out[at] = (uint32_t)rank;
    }
  }
}

/* Lists of particles: each block of them counts, then writes to places of its own, so that lists are in order. */
static int32_t list_particles(meter *m) {
  fum_context *context = m->scene->context;
  const int blocks = fum_thread_count(context);
  int64_t *cursors = NULL, total = 0;
  int32_t status = fum_alloc(context, (int64_t)blocks * PIXELS, sizeof *cursors, "the meter of blur", &cursors);
  if (status != FUM_OK) return status;
  for (int step = 0; step < 2 && status == FUM_OK; step++) {
#pragma omp parallel for num_threads(blocks) schedule(static, 1)
    for (int block = 0; block < blocks; block++) {
      const int64_t end = m->octree->count * (block + 1) / blocks;
      for (int64_t i = m->octree->count * block / blocks; i < end; i++) {
        if (fum_progress_in_loop(context, i, 1 << 16)) break;
        enter(m, i, cursors + (int64_t)block * PIXELS, step == 0 ? NULL : m->particles);
      }
    }
    if (step == 1) break;
    for (int32_t pixel = 0; pixel < PIXELS; pixel++) {
      m->begins[pixel] = total;
      for (int block = 0; block < blocks; block++) {
        const int64_t n = cursors[(int64_t)block * PIXELS + pixel];
        cursors[(int64_t)block * PIXELS + pixel] = total;
        total += n;
      }
    }
    m->begins[PIXELS] = total;
    status = fum_alloc(context, total, sizeof *m->particles, "the meter of blur", &m->particles);
  }
  fum_free(context, &cursors);
  if (status != FUM_OK) return status;
  return fum_is_cancelled(context) ? FUM_ERROR_CANCELLED : FUM_OK;
}

/* ---- Rays -------------------------------------------------------------------------------------------------------- */

/* Depth of the solid along a ray of camera space, clip_end if there is none. */
static float find_far(const meter *m, const fum_blur_instant *i, const double start[3], const double direction[3]) {
  const float none = (float)m->view->clip_end;
  float local_start[3], local_direction[3];
  fum_solid_point point;
  if (m->solids == NULL) return none;
  for (int row = 0; row < 3; row++) {
    double s = 0.0, d = 0.0;
    for (int column = 0; column < 4; column++) {
      const int entry = 4 * row + column;
      const double a = m->views[0].local_from_camera[entry], b = m->views[1].local_from_camera[entry];
      const double at = a + i->time * (b - a);
      s += at * (column < 3 ? start[column] : 1.0);
      d += column < 3 ? at * direction[column] : 0.0;
    }
    local_start[row] = (float)s;
    local_direction[row] = (float)d;
  }
  return fum_solids_see(m->solids, (fum_vec3){local_start[0], local_start[1], local_start[2]},
                        (fum_vec3){local_direction[0], local_direction[1], local_direction[2]},
                        (float)m->view->clip_start, none, &point);
}

/* The ray of a pixel that starts at the aperture and meets the pinhole's at the focus. */
static fum_blur_ray find_ray(const meter *m, double u, double v, const fum_blur_instant *i) {
  const bool is_perspective = m->view->type == FUM_CAMERA_PERSPECTIVE;
  const double focus = m->camera->focus_distance;
  const double lens[2] = {i->lens[0] * m->aperture[0], i->lens[1] * m->aperture[1]};
  const double across[2] = {is_perspective ? u : 0.0, is_perspective ? v : 0.0};
  const double start[3] = {lens[0] + (is_perspective ? 0.0 : u), lens[1] + (is_perspective ? 0.0 : v), 0.0};
  const double direction[3] = {across[0] - lens[0] / focus, across[1] - lens[1] / focus, -1.0};
  fum_blur_ray ray = {.time = (float)i->time, .near = (float)m->view->clip_start};
  for (int axis = 0; axis < 3; axis++) {
    ray.start[axis] = (float)start[axis];
    ray.direction[axis] = (float)direction[axis];
  }
  ray.far = fmaxf(ray.near, find_far(m, i, start, direction));
  return ray;
}

/* ---- Errors ------------------------------------------------------------------------------------------------------ */

/* Buffers of one thread. */
typedef struct scratch {
  float *buffer;
  int64_t size; /* floats of each of the 8 arrays */
} scratch;

static bool gather(const meter *m, int64_t begin, int64_t end, scratch *s, fum_blur_particles *out) {
  const int64_t count = end - begin, size = count + FUM_BLUR_PAD;
  if (size > s->size) {
    free(s->buffer);
    s->size = (size + 15) / 16 * 16;
    s->buffer = aligned_alloc(64, 8 * (size_t)s->size * sizeof *s->buffer);
  }
  if (s->buffer == NULL) {
    s->size = 0;
    return false;
  }
  float *const b = s->buffer;
  const int64_t n = s->size;
  *out = (fum_blur_particles){count, b, b + n, b + 2 * n, b + 3 * n, b + 4 * n, b + 5 * n, b + 6 * n, b + 7 * n};
  memset(b, 0, 8 * (size_t)n * sizeof *b);
  for (int64_t i = 0; i < count; i++) {
    const passing p = pass(m, m->particles[begin + i]);
    for (int axis = 0; axis < 3; axis++) {
      b[axis * n + i] = (float)p.start[axis];
      b[(3 + axis) * n + i] = (float)p.move[axis];
    }
    out->inverse_sigmas[i] = (float)(1.0 / p.sigma);
    out->optical_depths[i] = (float)p.optical_depth;
  }
  return true;
}

/* Opacity of the pixel through all rays of a level, and that less the opacity that smears have. */
typedef struct opacity {
  double mean, error;
} opacity;

static opacity look(const meter *m, int32_t pixel, int level, const fum_blur_particles *particles) {
  const fum_blur_sum_fn sum = fum_blur_sum_get();
  const double u = place_of(m, 0, pixel), v = place_of(m, 1, pixel);
  const int32_t pictures = PICTURES[level], rays = RAYS / pictures;
  opacity all = {0};
  for (int32_t picture = 0; picture < pictures; picture++) {
    const fum_blur_instant middle = fum_blur_find_instant(pictures, picture, (double[3]){0.5, 0.5, 0.5});
    const float far = find_ray(m, u, v, &middle).far;
    double mean = 0.0, smeared = 0.0;
    for (int32_t k = 0; k < rays; k++) {
      const uint32_t index = (uint32_t)k;
      const double within[3] = {((double)k + 0.5) / rays, fum_radical_inverse(2, index) + 0.5 / rays,
                                fum_radical_inverse(3, index)};
      const fum_blur_instant i = fum_blur_find_instant(pictures, picture, within);
      fum_blur_ray ray = find_ray(m, u, v, &i);
      const float depth = sum(particles, &ray);
      mean -= expm1(-(double)depth);
      const bool ends_alike = fabsf(ray.far - far) <= 0.01F * far;
      ray.far = fmaxf(ray.near, far);
      smeared += (double)(ends_alike ? depth : sum(particles, &ray));
    }
    mean /= rays;
    all.mean += mean / pictures;
    all.error += (mean + expm1(-smeared / rays)) / pictures;
  }
  return all;
}

/* Half axes of the ellipse that has the aperture's area and ratio, m. */
static void find_ellipse(const fum_camera *camera, double out[2]) {
  const double ratio = (double)camera->aperture_ratio;
  fum_aperture aperture;
  fum_aperture_find(camera, &aperture);
  out[1] = camera->aperture_radius * sqrt(aperture.area * ratio / FUM_PI);
  out[0] = out[1] / ratio;
}

static int32_t find_views(fum_context *context, meter *m) {
  const double times[2] = {m->camera->shutter_open, m->camera->shutter_close};
  int32_t status = FUM_OK;
  for (int k = 0; k < 2 && status == FUM_OK; k++) {
    status = fum_view_init_at(context, m->camera, times[k], &m->views[k]);
    if (status == FUM_OK) fum_view_place(&m->views[k], m->scene->origin);
  }
  return status;
}

static int32_t look_at_pixels(const meter *m, opacity found[LEVELS][PIXELS]) {
  fum_context *context = m->scene->context;
  atomic_bool is_out_of_memory = false;
#pragma omp parallel num_threads(fum_thread_count(context))
  {
    scratch s = {0};
#pragma omp for schedule(dynamic)
    for (int32_t pixel = 0; pixel < PIXELS; pixel++) {
      fum_blur_particles particles;
      if (m->begins[pixel] == m->begins[pixel + 1] || fum_progress_in_loop(context, pixel, 1)) continue;
      if (!gather(m, m->begins[pixel], m->begins[pixel + 1], &s, &particles)) {
        atomic_store(&is_out_of_memory, true);
        continue;
      }
      for (int level = 0; level < LEVELS; level++)
        found[level][pixel] = look(m, pixel, level, &particles);
    }
    free(s.buffer);
  }
  if (atomic_load(&is_out_of_memory)) return fum_fail(context, FUM_ERROR_MEMORY, "the meter of blur: no memory");
  return fum_is_cancelled(context) ? FUM_ERROR_CANCELLED : FUM_OK;
}

/* Relative root mean square. */
static double sum_up(const opacity found[PIXELS]) {
  double squared = 0.0, opacities = 0.0;
  for (int32_t pixel = 0; pixel < PIXELS; pixel++) {
    squared += found[pixel].error * found[pixel].error;
    opacities += found[pixel].mean * found[pixel].mean;
  }
  return opacities > 0.0 ? sqrt(squared / opacities) : 0.0;
}

int32_t fum_blur_meter_read(const fum_scene *scene, const fum_octree *octree, const fum_solids *solids,
                            const fum_camera *camera, const fum_view *view, fum_blur_errors *out_errors) {
  fum_context *context = scene->context;
  opacity found[LEVELS][PIXELS] = {{{0}}};
  meter m = {.scene = scene,
             .octree = octree,
             .solids = fum_solids_hide_from_camera(solids) ? solids : NULL,
             .camera = camera,
             .view = view,
             .pixel = fmax((view->window[1] - view->window[0]) / (double)view->width,
                           (view->window[3] - view->window[2]) / (double)view->height)};
  find_ellipse(camera, m.aperture);
  int32_t status = find_views(context, &m);
  if (status == FUM_OK) status = fum_smears_find(scene, octree, camera, view, &m.smears);
  if (status != FUM_OK) return status;
  find_bounds(&m);
  if (m.lower[0] < m.upper[0] && m.lower[1] < m.upper[1]) {
    status = list_particles(&m);
    if (status == FUM_OK) status = look_at_pixels(&m, found);
  }
  for (int level = 0; level < LEVELS && status == FUM_OK; level++)
    out_errors->of[level] = sum_up(found[level]);
  fum_free(context, &m.particles);
  fum_smears_free(context, &m.smears);
  return status;
}

int32_t fum_blur_samples_needed(const fum_blur_errors *errors, double tolerance) {
  const double *e = errors->of;
  if (!(e[0] > tolerance)) return 1;
  const int above =
      e[1] > tolerance ? 1 : 0; /* the last level that is known to be too far off, of the two that count */
  /* Errors fall with a power of the number. */
  const double slope = fmax(0.3, log(e[above] / fmax(e[above + 1], 1e-12)) / log(4.0));
  const double samples = (double)PICTURES[above] * pow(e[above] / tolerance, 1.0 / slope);
  return (int32_t)fmin(FUM_BLUR_MOST_SAMPLES, ceil(samples - 1e-6));
}
