/* SPDX-License-Identifier: GPL-3.0-or-later */
/* Adaptive Gauss-Kronrod quadrature (Piessens and others 1983, QUADPACK): every part of the ray is integrated with 7
 * and with 15 points; where the two differ too much it is halved. */
#include "reference/ray.h"

#include "base/vector.h"

#include <stdlib.h>
#include <string.h>

enum { POINTS = 15, MAX_STRETCH_PANELS = 256, MAX_PANELS = 8192 };

static const double NODES[8] = {0.991455371120812639206854697526329, 0.949107912342758524526189684047851,
                                0.864864423359769072789712788640926, 0.741531185599394439863864773280788,
                                0.586087235467691130294144691838259, 0.405845151377397166906606412076961,
                                0.207784955007898467600689403773245, 0.0};
static const double KRONROD_WEIGHTS[8] = {0.022935322010529224963732008058970, 0.063092092629978553290700663189204,
                                          0.104790010322250183839876322541518, 0.140653259715525918745189590510238,
                                          0.169004726639267902826583426598550, 0.190350578064785409913256402421014,
                                          0.204432940075298892414161999234649, 0.209482141084727828012999174891714};
static const double GAUSS_WEIGHTS[8] = {
    0.0, 0.129484966168869693270611432679082, 0.0, 0.279705391489276667901467771423780,
    0.0, 0.381830050505118944950369775488975, 0.0, 0.417959183673469387755102040816327};

static double dot(const double a[3], const double b[3]) {
  return a[0] * b[0] + a[1] * b[1] + a[2] * b[2];
}

/* Adds the optical depth of one particle from where smoke is seen first to t, for red, green and blue. */
static void add_depth(const fum_ray *ray, const fum_heard *h, double t, double depths[3]) {
  const double mean = h->density * fum_gaussian_integral(h->sigma, ray->start - h->along, t - h->along);
  for (int c = 0; c < 3; c++)
    depths[c] += mean * h->tint[c];
}

static void find_depths(const fum_ray *ray, double t, double out_depths[3]) {
  memset(out_depths, 0, 3 * sizeof *out_depths);
  for (int64_t i = 0; i < ray->heard.count && ray->heard.items[i].along - ray->heard.items[i].cut < t; i++)
    add_depth(ray, &ray->heard.items[i], t, out_depths);
}

/* What of the optical depths until t is looked at. */
typedef double (*reading)(const fum_ray *ray, double t);

static double mean_until(const fum_ray *ray, double t) {
  double d[3];
  find_depths(ray, t, d);
  return d[0] == d[1] && d[1] == d[2] ? d[0] : (d[0] + d[1] + d[2]) / 3.0;
}

static double least_until(const fum_ray *ray, double t) {
  double d[3];
  find_depths(ray, t, d);
  return fmin(d[0], fmin(d[1], d[2]));
}

/* Where the optical depth reaches `depth`, by bisection; `end` if it doesn't before. */
static double find_depth(const fum_ray *ray, reading read, double depth, double end) {
  double low = ray->start, high = end;
  if (read(ray, end) <= depth) return end;
  for (int step = 0; step < 60; step++) {
    const double middle = 0.5 * (low + high);
    if (read(ray, middle) < depth) {
      low = middle;
    } else {
      high = middle;
    }
  }
  return 0.5 * (low + high);
}

/* What lights add at a point of the ray. */
typedef struct scatter_point {
  const fum_ray *ray;
  const double *position;
  const fum_light_desc *light;
  double radiance[3]; /* per metre */
} scatter_point;

/* Henyey-Greenstein; `cosine` between the light's way and the way on to the camera. */
static double phase(double g, double cosine) {
  return (1.0 - g * g) / (4.0 * FUM_PI * pow(1.0 + g * g - 2.0 * g * cosine, 1.5));
}

static void add_shine(void *user, const fum_shine *shine) {
  scatter_point *s = user;
  const fum_reference_world *world = s->ray->world;
  const fum_scene *scene = world->smoke->scene;
  if (fum_is_cancelled(world->context)) return;
  const double *p = s->position, *u = shine->direction;
  const fum_vec3 from = {(float)p[0], (float)p[1], (float)p[2]}, towards = {(float)u[0], (float)u[1], (float)u[2]};
  const bool casts_shadows = s->light->casts_shadows != 0;
  if (casts_shadows && fum_solids_occlude(world->solids, s->light->shadow_sets, from, towards, (float)shine->distance))
    return;
  const fum_way way = {{p[0], p[1], p[2]}, {u[0], u[1], u[2]}, shine->distance};
  double depths[3] = {0.0};
  if (casts_shadows) fum_smoke_depth(world->smoke, &way, s->light->shadow_sets, depths);
  const double cosine = dot(s->ray->way.direction, u);
  for (int c = 0; c < 3; c++) {
    const double arrives = shine->strength * exp(-depths[c]) * (double)s->light->intensity[c] * shine->tint[c];
    for (int32_t set = 0; set < scene->particles_count && arrives > 0.0; set++) {
      if (!fum_has_set(s->light->light_sets, scene->particles[set].light_set)) continue;
      const double factor = arrives * phase((double)scene->particles[set].anisotropy, cosine);
      s->radiance[c] += factor * s->ray->scattering[3 * set + c];
    }
  }
}

static void add_lights(const fum_ray *ray, double t, double radiance[3]) {
  const fum_reference_world *world = ray->world;
  double position[3];
  for (int axis = 0; axis < 3; axis++)
    position[axis] = ray->way.start[axis] + t * ray->way.direction[axis];
  for (int32_t i = 0; i < world->lamp_count; i++) {
    const fum_reference_lamp *lamp = &world->lamps[i];
    const float *color = lamp->desc->intensity;
    scatter_point s = {ray, position, lamp->desc, {0.0}};
    if (color[0] <= 0.0F && color[1] <= 0.0F && color[2] <= 0.0F) continue;
    fum_reference_lamp_visit(lamp, position, add_shine, &s);
    for (int c = 0; c < 3; c++)
      radiance[c] += s.radiance[c];
  }
}

/* The integrand. `before`: optical depths of the particles that end before the panel; `active_count`: those in it. */
static void evaluate(fum_ray *ray, double t, const double before[3], int64_t active_count, double out[3]) {
  const int32_t sets = ray->world->smoke->scene->particles_count;
  double depths[3] = {before[0], before[1], before[2]}, scattered = 0.0;
  memset(out, 0, 3 * sizeof *out);
  memset(ray->scattering, 0, (size_t)(3 * sets) * sizeof *ray->scattering);
  for (int64_t k = 0; k < active_count; k++) {
    const fum_heard *h = &ray->heard.items[ray->active[k]];
    const double z = t - h->along;
    if (z < -h->cut) continue;
    add_depth(ray, h, t, depths);
    if (z > h->cut) continue;
    const double there = exp(-0.5 * z * z / (h->sigma * h->sigma));
    for (int c = 0; c < 3; c++) {
      out[c] += h->glow[c] * there;
      ray->scattering[3 * h->set + c] += h->scattering[c] * there;
      scattered += h->scattering[c] * there;
    }
  }
  if (scattered > 0.0) add_lights(ray, t, out);
  for (int c = 0; c < 3; c++)
    out[c] *= exp(-depths[c]);
  ray->step_count++;
}

/* Chooses the particles that are heard in the panel; gives their number and the depths of those before it. */
static int64_t activate(fum_ray *ray, const fum_panel *panel, double out_before[3]) {
  int64_t count = 0;
  memset(out_before, 0, 3 * sizeof *out_before);
  for (int64_t i = 0; i < ray->heard.count; i++) {
    const fum_heard *h = &ray->heard.items[i];
    if (h->along - h->cut > panel->end) break;
    if (h->along + h->cut < panel->begin) {
      add_depth(ray, h, panel->begin, out_before);
    } else {
      ray->active[count++] = i;
    }
  }
  return count;
}

static void integrate_panel(fum_ray *ray, fum_panel *panel) {
  double before[3], kronrod[3] = {0.0}, gauss[3] = {0.0};
  const int64_t active = activate(ray, panel, before);
  const double middle = 0.5 * (panel->begin + panel->end), half = 0.5 * (panel->end - panel->begin);
  for (int k = 0; k < POINTS && active > 0; k++) {
    const int node = k < 8 ? k : POINTS - 1 - k;
    double value[3];
    evaluate(ray, middle + (k < 8 ? -half : half) * NODES[node], before, active, value);
    for (int c = 0; c < 3; c++) {
      kronrod[c] += KRONROD_WEIGHTS[node] * half * value[c];
      gauss[c] += GAUSS_WEIGHTS[node] * half * value[c];
    }
    if (omp_get_thread_num() == 0) fum_progress_pulse(ray->world->context);
  }
  panel->error = 0.0;
  for (int c = 0; c < 3; c++) {
    panel->value[c] = kronrod[c];
    panel->error = fmax(panel->error, fabs(kronrod[c] - gauss[c]));
  }
}

static bool add_panel(fum_ray *ray, double begin, double end) {
  if (!(end > begin)) return true;
  if (ray->panel_count == ray->panel_capacity) {
    const int64_t capacity = 2 * ray->panel_capacity + 64;
    fum_panel *grown = realloc(ray->panels, (size_t)capacity * sizeof *grown);
    if (grown == NULL) return false;
    ray->panels = grown;
    ray->panel_capacity = capacity;
  }
  ray->panels[ray->panel_count++] = (fum_panel){.begin = begin, .end = end};
  return true;
}

/* Divides the panel that holds t there. */
static bool break_at(fum_ray *ray, double t) {
  for (int64_t i = 0; i < ray->panel_count; i++) {
    fum_panel *panel = &ray->panels[i];
    if (t > panel->begin && t < panel->end) {
      const double end = panel->end;
      panel->end = t;
      return add_panel(ray, t, end);
    }
  }
  return true;
}

/* Panels over a stretch of the ray with smoke throughout: a few of the smallest particles wide. */
static bool cover(fum_ray *ray, double begin, double end) {
  const double panel_sigmas = 4.0, wanted = ceil((end - begin) / (panel_sigmas * ray->world->smoke->smallest_sigma));
  const int count = (int)fmin(fmax(wanted, 4.0), (double)MAX_STRETCH_PANELS);
  for (int k = 0; k < count; k++) {
    const double width = (end - begin) / count;
    if (!add_panel(ray, begin + k * width, k + 1 < count ? begin + (k + 1) * width : end)) return false;
  }
  return true;
}

/* Breaks around particles that the panels are too wide to find by themselves. */
static bool break_at_small_particles(fum_ray *ray) {
  double widest = 0.0;
  for (int64_t i = 0; i < ray->panel_count; i++)
    widest = fmax(widest, ray->panels[i].end - ray->panels[i].begin);
  for (int64_t i = 0; i < ray->heard.count && ray->panel_count < MAX_PANELS; i++) {
    const fum_heard *h = &ray->heard.items[i];
    for (int k = -1; k <= 1 && h->sigma < widest / 8.0; k++) {
      if (!break_at(ray, h->along + k * h->cut)) return false;
    }
  }
  return true;
}

/* Panels between the extents of the Gaussians, broken where lights change abruptly. */
static bool make_panels(fum_ray *ray) {
  const double end = find_depth(ray, least_until, FUM_DARK_DEPTH, ray->way.length);
  const fum_heard_list *heard = &ray->heard;
  ray->panel_count = 0;
  for (int64_t i = 0; i < heard->count;) {
    const double begin = heard->items[i].along - heard->items[i].cut;
    double last = begin;
    for (; i < heard->count && heard->items[i].along - heard->items[i].cut <= last; i++) {
      last = fmax(last, heard->items[i].along + heard->items[i].cut);
    }
    if (fmax(begin, ray->start) < fmin(last, end) && !cover(ray, fmax(begin, ray->start), fmin(last, end)))
      return false;
  }
  for (int32_t i = 0; i < ray->world->lamp_count; i++) {
    double breaks[FUM_LAMP_BREAKS];
    const int count = fum_reference_lamp_breaks(&ray->world->lamps[i], ray->way.start, ray->way.direction, breaks);
    for (int k = 0; k < count; k++) {
      if (!break_at(ray, breaks[k])) return false;
    }
  }
  return break_at_small_particles(ray);
}

/* Sums the panels. */
static void gather(const fum_ray *ray, fum_ray_result *result) {
  memset(result->radiance, 0, sizeof result->radiance);
  result->error = 0.0;
  for (int64_t i = 0; i < ray->panel_count; i++) {
    for (int c = 0; c < 3; c++)
      result->radiance[c] += ray->panels[i].value[c];
    result->error += ray->panels[i].error;
  }
}

/* Halves each panel whose error exceeds its share. Gives false without memory. */
static bool refine(fum_ray *ray, double allowed) {
  const int64_t count = ray->panel_count;
  const double share = 0.5 * allowed / (double)count;
  for (int64_t i = 0; i < count && ray->panel_count < MAX_PANELS; i++) {
    if (ray->panels[i].error <= share) continue;
    const double begin = ray->panels[i].begin, end = ray->panels[i].end, middle = 0.5 * (begin + end);
    if (!(middle > begin && middle < end)) continue; /* as narrow as numbers go */
    ray->panels[i].end = middle;
    if (!add_panel(ray, middle, end)) return false;
    integrate_panel(ray, &ray->panels[i]);
    integrate_panel(ray, &ray->panels[ray->panel_count - 1]);
    if (fum_is_cancelled(ray->world->context)) break;
  }
  return true;
}

static int32_t make_room(fum_ray *ray) {
  if (ray->scattering == NULL) {
    ray->scattering = calloc((size_t)(3 * ray->world->smoke->scene->particles_count + 1), sizeof *ray->scattering);
    if (ray->scattering == NULL) return FUM_ERROR_MEMORY;
  }
  if (ray->active_capacity < ray->heard.capacity) {
    int64_t *grown = realloc(ray->active, (size_t)ray->heard.capacity * sizeof *grown);
    if (grown == NULL) return FUM_ERROR_MEMORY;
    ray->active = grown;
    ray->active_capacity = ray->heard.capacity;
  }
  return FUM_OK;
}

/* Refines until the radiance has converged, or no panel can be halved any more. */
static int32_t converge(fum_ray *ray, fum_ray_result *result) {
  for (int64_t i = 0; i < ray->panel_count && !fum_is_cancelled(ray->world->context); i++) {
    integrate_panel(ray, &ray->panels[i]);
  }
  gather(ray, result);
  for (;;) {
    const double *rgb = result->radiance;
    const double allowed = ray->world->tolerance * fmax(rgb[0], fmax(rgb[1], rgb[2]));
    const int64_t before = ray->panel_count;
    result->has_converged = result->error <= allowed;
    if (fum_is_cancelled(ray->world->context)) return FUM_ERROR_CANCELLED;
    if (result->has_converged) return FUM_OK;
    if (!refine(ray, allowed)) return FUM_ERROR_MEMORY;
    gather(ray, result);
    if (ray->panel_count == before) return FUM_OK;
  }
}

int32_t fum_ray_integrate(fum_ray *ray, const fum_reference_world *world, const fum_way *way, double start,
                          bool wants_half_way, fum_ray_result *out_result) {
  const double half = 0.69314718055994530942; /* ln 2 */
  ray->world = world;
  ray->way = *way;
  ray->start = start;
  fum_ray_result result = {.has_converged = true, .half_way = INFINITY};
  if (!fum_smoke_listen(world->smoke, way, &ray->heard)) return FUM_ERROR_MEMORY;
  int32_t status = make_room(ray);
  if (status == FUM_OK && !make_panels(ray)) status = FUM_ERROR_MEMORY;
  if (status == FUM_OK) status = converge(ray, &result);
  if (status != FUM_OK) return status;
  double depths[3];
  find_depths(ray, way->length, depths);
  for (int c = 0; c < 3; c++)
    result.through[c] = exp(-depths[c]);
  result.alpha = -(expm1(-depths[0]) + expm1(-depths[1]) + expm1(-depths[2])) / 3.0;
  if (wants_half_way && mean_until(ray, way->length) > half)
    result.half_way = find_depth(ray, mean_until, half, way->length);
  *out_result = result;
  return FUM_OK;
}

void fum_ray_free(fum_ray *ray) {
  free(ray->heard.items);
  free(ray->active);
  free(ray->scattering);
  free(ray->panels);
}
