/* SPDX-License-Identifier: GPL-3.0-or-later */
#include "api/light_error.h"

#include "lighting/lookup.h"
#include "pass/depth.h"

/* Points in the smoke, one in each pixel that shows some: half of its opacity lies in front. */
typedef struct spots {
  int64_t count;
  uint32_t *pixels; /* [count] */
  float *positions; /* [3 count] local space */
  float *depths;    /* [height][width] along the axis */
} spots;

static void spots_free(fum_context *context, spots *s) {
  fum_free(context, &s->pixels);
  fum_free(context, &s->positions);
  fum_free(context, &s->depths);
}

/* Depths of pixels without smoke are those of solids, or the clip range's end. */
static bool has_smoke(const fum_rendering *r, const spots *s, int64_t pixel) {
  const double end = r->solid.depths != NULL ? (double)r->solid.depths[pixel] : r->view.clip_end;
  return (double)s->depths[pixel] < end;
}

static int32_t find_spots(fum_rendering *r, spots *s) {
  fum_context *context = r->context;
  const fum_view *view = &r->view;
  const fum_octree *all = r->scene->caches->all;
  const int64_t pixels = (int64_t)view->width * view->height;
  const char *what = "pass Error";
  float *reaches = NULL;
  int32_t status = fum_reach_find(context, all, 0.1F * r->settings.tolerance, &reaches);
  if (status == FUM_OK) status = fum_alloc(context, pixels, sizeof *s->depths, what, &s->depths);
  if (status == FUM_OK)
    status = fum_depth_find(r->scene, all, reaches, view, r->solid.depths, FUM_DEPTH_OF_MIDDLE, s->depths);
  if (status == FUM_OK) status = fum_alloc(context, pixels, sizeof *s->pixels, what, &s->pixels);
  for (int64_t i = 0; i < pixels && status == FUM_OK; i++) {
    if (has_smoke(r, s, i)) s->pixels[s->count++] = (uint32_t)i;
  }
  if (status == FUM_OK) status = fum_alloc(context, s->count, 3 * sizeof *s->positions, what, &s->positions);
  for (int64_t n = 0; n < s->count && status == FUM_OK; n++) {
    const int64_t i = s->pixels[n];
    double start[3], direction[3];
    fum_view_ray(view, (double)(i % view->width) + 0.5, (double)(i / view->width) + 0.5, start, direction);
    for (int axis = 0; axis < 3; axis++)
      s->positions[3 * n + axis] = (float)(start[axis] + (double)s->depths[i] * direction[axis]);
  }
  fum_free(context, &reaches);
  return status;
}

/* What the lattice holds of a light at a spot. */
static double held_depth(const fum_rendering *r, const fum_slabs *slabs, const fum_lattice *lattice,
                         const fum_lamp *lamp, int32_t light, uint32_t pixel, float axis_depth, fum_vec3 position) {
  const fum_view *view = &r->view;
  const double *w = view->window;
  const double window[2] = {w[0] + (w[1] - w[0]) * ((double)(pixel % (uint32_t)view->width) + 0.5) / view->width,
                            w[2] + (w[3] - w[2]) * ((double)(pixel / (uint32_t)view->width) + 0.5) / view->height};
  const bool is_perspective = view->type == FUM_CAMERA_PERSPECTIVE;
  const double speed = is_perspective ? sqrt(1.0 + window[0] * window[0] + window[1] * window[1]) : 1.0;
  const double place[3] = {(double)position.x, (double)position.y, (double)position.z};
  return fum_lattice_depth(lattice, slabs, lamp, light, window, speed * (double)axis_depth, place);
}

/* What all samples of a lamp send to a point, whatever the colour; of an environment by what smoke makes of it. */
static double sent_to(const fum_lamp *lamp, const fum_viewpoint *viewpoint, fum_vec3 position) {
  const fum_vec3 to_viewer = fum_direction_to_viewer(viewpoint, position);
  const float *color = lamp->color;
  double sent = 0.0;
  for (int32_t k = 0; k < lamp->sample_count; k++) {
    const fum_emitter sample = fum_lamp_sample(lamp, k);
    if (lamp->environment != NULL) {
      const fum_sky *part = &lamp->environment->parts[k];
      sent += 4.0 * FUM_PI * (double)fum_sky_scatter_wide(part, lamp->channel, lamp->anisotropy, to_viewer);
    } else {
      sent += (double)fum_emitter_irradiance(lamp, &sample, position);
    }
  }
  return sent * (double)(color[0] + color[1] + color[2]);
}

/* Sums of one spot over the lights. */
typedef struct sum {
  double wrong, sent;
} sum;

/* Adds a lamp whose exact optical depths are known at the points. */
static void add_lamp(const fum_rendering *r, const fum_lamp *lamp, const fum_slabs *slabs, const fum_lattice *lattice,
                     const spots *s, const fum_octree *points, const float *exact, sum *sums) {
  const fum_viewpoint viewpoint = fum_find_viewpoint(&r->view);
#pragma omp parallel for num_threads(fum_thread_count(r->context)) schedule(dynamic, 256)
  for (int64_t i = 0; i < points->count; i++) {
    if (fum_progress_in_loop(r->context, i, 1 << 12)) continue;
    const uint32_t n = points->indices[i], pixel = s->pixels[n];
    const fum_vec3 position = {points->x[i], points->y[i], points->z[i]};
    const double held = held_depth(r, slabs, lattice, lamp, lamp->index, pixel, s->depths[pixel], position);
    const double sent = sent_to(lamp, &viewpoint, position);
    sums[n].wrong += sent * (exp(-held) - exp(-(double)exact[i]));
    sums[n].sent += sent;
  }
}

static int32_t add_lights(fum_rendering *r, const fum_lighting *lighting, const fum_slabs *slabs,
                          const fum_lattice *lattice, const spots *s, const fum_octree *points, sum *sums) {
  fum_context *context = r->context;
  fum_solver exactly = {.wanted = FUM_SOLVER_EXACT, .tolerance = r->settings.tolerance};
  fum_receivers receivers = {.octree = points};
  fum_gathering g = lighting->gathering;
  float *exact = NULL;
  g.solver = &exactly;
  g.receivers = &receivers;
  g.solids = NULL; /* they block light, however much of it there is */
  const fum_lamps *lamps = &lighting->lamps;
  const int64_t most = points->count * fum_lamps_most_alike(lamps);
  int32_t status = fum_alloc(context, most, sizeof *exact, "pass Error", &exact);
  for (int32_t l = 0, alike; l < lamps->count && status == FUM_OK; l += alike) {
    const fum_lamp *lamp = &lamps->items[l];
    alike = fum_lamps_alike(lamps, l);
    if (!lamp->lights_smoke) continue;
    const float count = (float)lamps->count, progress[2] = {(float)l / count, (float)(l + alike) / count};
    status = lamp->environment != NULL ? fum_gather_around(&g, lamp, alike, progress, exact, NULL)
                                       : fum_gather_depths(&g, lamp, progress, exact, NULL);
    for (int32_t k = 0; k < alike && status == FUM_OK; k++)
      add_lamp(r, &lamp[k], slabs, lattice, s, points, exact + k * points->count, sums);
  }
  fum_free(context, &exact);
  fum_receivers_free(context, &receivers);
  return status;
}

int32_t fum_light_error_find(fum_rendering *r, const fum_lighting *lighting, const fum_slabs *slabs,
                             const fum_lattice *lattice) {
  fum_context *context = r->context;
  fum_octree *points = NULL;
  sum *sums = NULL;
  spots s = {0};
  int32_t status = find_spots(r, &s);
  if (status == FUM_OK)
    status = fum_octree_build_points(context, r->scene->origin, s.count, s.positions, FUM_GROUP_SIZE, &points);
  if (status == FUM_OK) status = fum_alloc(context, s.count, sizeof *sums, "pass Error", &sums);
  if (status == FUM_OK && s.count > 0) status = add_lights(r, lighting, slabs, lattice, &s, points, sums);
  for (int64_t n = 0; n < s.count && status == FUM_OK; n++)
    r->error[s.pixels[n]] = sums[n].sent > 0.0 ? (float)(sums[n].wrong / sums[n].sent) : 0.0F;
  fum_free(context, &sums);
  fum_octree_destroy(context, points);
  spots_free(context, &s);
  return status;
}
