/* SPDX-License-Identifier: GPL-3.0-or-later */
#include "lighting/meter.h"

#include "base/hash.h"
#include "lighting/meter_pick.h"

#include <stdlib.h>
#include <string.h>

/* Points wanted, and how many candidates are looked at for each: where the camera sees very little of the smoke there
 * will be fewer points. */
enum { POINTS = 1024, ATTEMPTS = 16, ROUND = 256 };

static bool is_black(const fum_lamp *lamp) {
  const float *c = lamp->desc.intensity;
  return c[0] <= 0.0F && c[1] <= 0.0F && c[2] <= 0.0F;
}

static int32_t begin(fum_context *context, const fum_meter_options *options, int64_t count, fum_meter *meter) {
  *meter = (fum_meter){.context = context,
                       .lamps = options->lamps,
                       .viewpoint = options->viewpoint,
                       .media = options->media,
                       .dark = fum_truth_dark(options->error)};
  const int64_t values = count * options->lamps->count;
  const int32_t media = options->media->count;
  int32_t status = fum_alloc(context, media, sizeof *meter->truths, "meter", &meter->truths);
  for (int32_t k = 0; k < media && status == FUM_OK; k++) {
    const fum_medium *medium = &options->media->items[k];
    status = fum_truth_begin(context, medium, fum_truth_cutoff(medium, options->error), &meter->truths[k]);
  }
  if (status == FUM_OK) status = fum_alloc(context, count, sizeof *meter->points, "meter", &meter->points);
  if (status == FUM_OK) status = fum_alloc(context, values, sizeof *meter->exact, "meter", &meter->exact);
  if (status == FUM_OK) status = fum_alloc(context, values, sizeof *meter->found, "meter", &meter->found);
  if (status == FUM_OK) status = fum_alloc(context, values, sizeof *meter->sent, "meter", &meter->sent);
  return status;
}

static int32_t light_set_of(const fum_meter_options *options, int64_t receiver) {
  return fum_scene_particles_of(options->scene, options->octree->indices[receiver])->light_set;
}

int32_t fum_meter_begin_particles(fum_context *context, const fum_meter_options *options, fum_meter *out_meter) {
  const fum_octree *octree = options->octree;
  const double start_s = fum_now_s();
  fum_meter_picks picks = {0};
  fum_meter meter = {0};
  /* A few more: how many there are is about what is asked for. */
  int32_t status = fum_meter_pick(context, options->scene, octree, POINTS + POINTS / 8, &picks);
  if (status != FUM_OK) goto done;
  const int64_t count = picks.count < POINTS ? picks.count : POINTS;
  status = begin(context, options, count, &meter);
  if (status != FUM_OK) goto done;
  for (int64_t n = 0; n < count; n++) {
    const uint32_t i = picks.ranks[n];
    meter.points[n] = (fum_meter_point){.position = {(double)octree->x[i], (double)octree->y[i], (double)octree->z[i]},
                                        .receiver = i,
                                        .light_set = light_set_of(options, i)};
  }
  meter.count = count;
  meter.seconds = fum_now_s() - start_s;
  *out_meter = meter;
  meter = (fum_meter){0};
done:
  fum_meter_end(&meter);
  fum_meter_picks_free(context, &picks);
  return status;
}

/* Normally distributed numbers (Box and Muller 1958). Returns the length of the vector. */
static double scatter(uint64_t seed, double out[3]) {
  double squared = 0.0;
  for (uint64_t axis = 0; axis < 3; axis++) {
    const double radius = sqrt(-2.0 * log(1.0 - fum_hash_unit(seed + 2 * axis)));
    out[axis] = radius * cos(2.0 * FUM_PI * fum_hash_unit(seed + 2 * axis + 1));
    squared += out[axis] * out[axis];
  }
  return sqrt(squared);
}

/* Moves a point to the middle of its pixel at the same range. False if it isn't seen there. */
static bool put_on_pixel(const fum_meter_sight *sight, fum_meter_point *point) {
  const fum_view *view = sight->view;
  double c[3];
  fum_transform_point(view->camera_from_local, point->position, c);
  const bool is_perspective = view->type == FUM_CAMERA_PERSPECTIVE;
  const int32_t sizes[2] = {view->width, view->height};
  int32_t pixels[2];
  double length = 1.0;
  if (is_perspective && !(c[2] < 0.0)) return false;
  point->range = is_perspective ? sqrt(c[0] * c[0] + c[1] * c[1] + c[2] * c[2]) : -c[2];
  for (int axis = 0; axis < 2; axis++) {
    const double *edges = view->window + 2 * axis, step = (edges[1] - edges[0]) / sizes[axis];
    const double place = floor((is_perspective ? c[axis] / -c[2] : c[axis]) / step - edges[0] / step);
    if (!(place >= 0.0 && place < sizes[axis])) return false;
    pixels[axis] = (int32_t)place;
    point->window[axis] = edges[0] + (place + 0.5) * step;
    length += is_perspective ? point->window[axis] * point->window[axis] : 0.0;
  }
  const double depth = point->range / sqrt(length);
  if (depth < view->clip_start || depth > view->clip_end) return false;
  const int64_t pixel = (int64_t)pixels[1] * view->width + pixels[0];
  if (sight->solid_depths != NULL && depth > (double)sight->solid_depths[pixel]) return false;
  fum_view_point(view, point->window[0], point->window[1], point->range, point->position);
  return true;
}

/* How points are looked for. */
typedef struct search {
  const fum_octree *octree; /* of the smoke that the camera sees */
  fum_meter_picks picks;    /* of its particles; each is a candidate several times where they are few */
  bool asks_hidden;         /* else rays are walked through `smoke` */
  fum_truth smoke;
  const fum_meter_sight *sight;
  struct candidate {
    bool is_seen;
    fum_meter_point point;
  } candidates[ROUND];
} search;

static int32_t begin_search(fum_context *context, search *s) {
  const fum_medium smoke = {.octree = s->octree, .sigma_scale = 1.0F, .depth_scale = 1.0F};
  const double sigmas = 2.5; /* these depths only choose: particles farther away may be missed */
  /* Among few particles walks are short, and what hides them may be smaller than what is known of it. */
  const int64_t few = 50000;
  s->asks_hidden = s->sight->hidden->depths != NULL && s->octree->count > few;
  if (s->asks_hidden) return FUM_OK;
  return fum_truth_begin(context, &smoke, 0.5 * sigmas * sigmas, &s->smoke);
}

/* Lets a point pass as often as light passes from it to the camera. Where nothing shows no light was looked for. */
static bool passes(const search *s, const fum_meter_point *point, double chance) {
  const fum_view *view = s->sight->view;
  const double *w = point->window,
               shows = s->sight->hidden->depths != NULL ? 0.99 * (double)s->sight->hidden->limit : INFINITY;
  const double limit = fmin(-log(1.0 - chance), shows);
  if (s->asks_hidden) return fum_hidden_depth(s->sight->hidden, s->sight->slabs, w, point->range) <= limit;
  const double length = view->type == FUM_CAMERA_PERSPECTIVE ? sqrt(1.0 + w[0] * w[0] + w[1] * w[1]) : 1.0;
  double start[3];
  fum_view_point(view, w[0], w[1], view->clip_start * length, start);
  const fum_emitter camera = {.position = {(float)start[0], (float)start[1], (float)start[2]}};
  return fum_truth_depth(&s->smoke, point->position, &camera, limit) <= limit;
}

static bool find_point(const search *s, int64_t candidate, fum_meter_point *out_point) {
  const fum_octree *octree = s->octree;
  const double sigmas = s->sight->footprint_sigmas;
  const int64_t pick = candidate % s->picks.count;
  const uint32_t i = s->picks.ranks[pick];
  const uint64_t seed = fum_hash64(s->picks.keys[pick] + (uint64_t)(candidate / s->picks.count));
  double offset[3];
  if (!(octree->optical_depths[i] > 0.0F) || scatter(seed, offset) > sigmas) return false;
  /* What is seen of a dense particle is the surface of its footprint. */
  const double stretch = fum_footprint(sigmas, (double)octree->optical_depths[i]) / sigmas;
  const double center[3] = {(double)octree->x[i], (double)octree->y[i], (double)octree->z[i]};
  for (int axis = 0; axis < 3; axis++) {
    out_point->position[axis] = center[axis] + offset[axis] * stretch / (double)octree->inverse_sigmas[i];
  }
  out_point->receiver = i;
  return put_on_pixel(s->sight, out_point) && passes(s, out_point, fum_hash_unit(seed + 6));
}

static void take_seen(const search *s, fum_meter *meter) {
  for (int64_t n = 0; n < ROUND && meter->count < POINTS; n++) {
    const struct candidate *candidate = &s->candidates[n];
    if (candidate->is_seen) meter->points[meter->count++] = candidate->point;
  }
}

static int compare_places(const void *a, const void *b) {
  const uint32_t x = ((const fum_meter_point *)a)->receiver, y = ((const fum_meter_point *)b)->receiver;
  return (x > y) - (x < y);
}

/* Neighbours in the octree's order one after another: their rays read the same memory. */
static int32_t find_points(fum_meter *meter, search *s) {
  enum { ROUNDS = ATTEMPTS * POINTS / ROUND };
  fum_context *context = meter->context;
  int32_t status = FUM_OK;
  for (int64_t round = 0; round < ROUNDS && meter->count < POINTS && status == FUM_OK; round++) {
#pragma omp parallel for num_threads(fum_thread_count(context)) schedule(dynamic, 8)
    for (int64_t n = 0; n < ROUND; n++) {
      if (fum_progress_in_loop(context, n, 16)) continue;
      s->candidates[n].is_seen = find_point(s, round * ROUND + n, &s->candidates[n].point);
    }
    take_seen(s, meter);
    status = fum_progress_report(context, FUM_STAGE_LIGHTING, 1.0F, "Measuring the light's accuracy");
  }
  qsort(meter->points, (size_t)meter->count, sizeof *meter->points, compare_places);
  return status;
}

/* An environment has many samples: it is compared at some of the points only. */
static bool is_asked(const fum_lamp *lamp, int64_t n) {
  enum { USUAL_SAMPLES = 16 };
  const int32_t samples = lamp->environment != NULL ? lamp->environment->count : 1;
  return n % ((samples + USUAL_SAMPLES - 1) / USUAL_SAMPLES) == 0;
}

static double exact_transmittance(const fum_meter *meter, const fum_lamp *lamp, const fum_emitter *sample, int64_t n) {
  const fum_truth *truth = &meter->truths[fum_media_find(meter->media, lamp)];
  if (lamp->desc.casts_shadows == 0) return 1.0;
  return exp(-fum_truth_depth(truth, meter->points[n].position, sample, meter->dark));
}

static fum_vec3 place_of(const fum_meter *meter, int64_t n) {
  const double *p = meter->points[n].position;
  return (fum_vec3){(float)p[0], (float)p[1], (float)p[2]};
}

/* Adds a sample of a light at one point; NULL: nothing else than the truth is known. */
static void add_sample(fum_meter *meter, const fum_lamp *lamp, const fum_emitter *sample, int64_t n,
                       const float *found_depth) {
  const double sent = (double)fum_emitter_irradiance(lamp, sample, place_of(meter, n));
  const int64_t i = lamp->index * meter->count + n;
  if (!(sent > 0.0) || !fum_has_set(lamp->desc.light_sets, meter->points[n].light_set)) return;
  meter->sent[i] += sent;
  meter->exact[i] += sent * exact_transmittance(meter, lamp, sample, n);
  if (found_depth != NULL) meter->found[i] += sent * exp(-(double)*found_depth);
}

/* Adds a part of an environment at one point, to all of its lamps. */
static void add_part(fum_meter *meter, const fum_lamp *lamps, int32_t lamp_count, int32_t part, int64_t n) {
  const fum_vec3 to_viewer = fum_direction_to_viewer(&meter->viewpoint, place_of(meter, n));
  const fum_emitter sample = fum_lamp_sample(lamps, part);
  const double passing = exact_transmittance(meter, lamps, &sample, n);
  for (int32_t l = 0; l < lamp_count; l++) {
    const fum_environment *e = lamps->environment;
    const fum_sky_peak peak = fum_environment_peak(e, lamps[l].channel, lamps[l].anisotropy, to_viewer);
    const double sent = (double)fum_sky_weight(e, part, lamps[l].channel, lamps[l].anisotropy, to_viewer, &peak);
    const int64_t i = lamps[l].index * meter->count + n;
    meter->sent[i] += sent;
    meter->exact[i] += sent * passing;
  }
}

/* Adds all samples of lamps that look the same ways at one point. */
static void add_lamps(fum_meter *meter, const fum_lamp *lamps, int32_t alike, int64_t n) {
  if (is_black(lamps) || !fum_has_set(lamps->desc.light_sets, meter->points[n].light_set)) return;
  for (int32_t s = 0; s < lamps->sample_count; s++) {
    if (fum_progress_in_loop(meter->context, s, 16)) return;
    if (lamps->environment != NULL) {
      add_part(meter, lamps, alike, s, n);
    } else {
      const fum_emitter sample = fum_lamp_sample(lamps, s);
      add_sample(meter, lamps, &sample, n, NULL);
    }
  }
}

int32_t fum_meter_find_exact(fum_meter *meter) {
  const double start_s = fum_now_s();
  const fum_lamps *lamps = meter->lamps;
  const size_t bytes = (size_t)(meter->count * lamps->count) * sizeof *meter->exact;
  memset(meter->exact, 0, bytes);
  memset(meter->sent, 0, bytes);
#pragma omp parallel for num_threads(fum_thread_count(meter->context)) schedule(dynamic, 8)
  for (int64_t n = 0; n < meter->count; n++) {
    for (int32_t l = 0, alike; l < lamps->count; l += alike) {
      alike = fum_lamps_alike(lamps, l);
      if (is_asked(&lamps->items[l], n)) add_lamps(meter, &lamps->items[l], alike, n);
    }
  }
  meter->seconds += fum_now_s() - start_s;
  return fum_progress_report(meter->context, FUM_STAGE_LIGHTING, 1.0F, "Measuring the light's accuracy");
}

int32_t fum_meter_begin_points(fum_context *context, const fum_meter_options *options, const fum_meter_sight *sight,
                               fum_meter *out_meter) {
  const double start_s = fum_now_s();
  search *s = NULL;
  fum_meter meter;
  int32_t status = begin(context, options, POINTS, &meter);
  if (status == FUM_OK) status = fum_alloc(context, 1, sizeof *s, "meter", &s);
  if (status != FUM_OK) goto done;
  s->octree = options->octree;
  s->sight = sight;
  status = begin_search(context, s);
  if (status == FUM_OK) status = fum_meter_pick(context, options->scene, s->octree, ATTEMPTS * POINTS, &s->picks);
  if (status == FUM_OK && s->picks.count > 0) status = find_points(&meter, s);
  if (status != FUM_OK) goto done;
  for (int64_t n = 0; n < meter.count; n++)
    meter.points[n].light_set = light_set_of(options, meter.points[n].receiver);
  meter.seconds = fum_now_s() - start_s;
  *out_meter = meter;
  meter = (fum_meter){0};
done:
  if (s != NULL) {
    fum_truth_end(context, &s->smoke);
    fum_meter_picks_free(context, &s->picks);
  }
  fum_free(context, &s);
  fum_meter_end(&meter);
  return status;
}

void fum_meter_end(fum_meter *meter) {
  if (meter->context == NULL) return;
  for (int32_t k = 0; meter->truths != NULL && k < meter->media->count; k++)
    fum_truth_end(meter->context, &meter->truths[k]);
  fum_free(meter->context, &meter->truths);
  fum_free(meter->context, &meter->points);
  fum_free(meter->context, &meter->exact);
  fum_free(meter->context, &meter->found);
  fum_free(meter->context, &meter->sent);
}

void fum_meter_listen(void *user, const fum_lamp *lamp, const fum_emitter *sample, const uint8_t *is_lit,
                      const float *depths) {
  fum_meter *meter = user;
  const double start_s = fum_now_s();
#pragma omp parallel for num_threads(fum_thread_count(meter->context)) schedule(dynamic, 8)
  for (int64_t n = 0; n < meter->count; n++) {
    const uint32_t i = meter->points[n].receiver;
    if (fum_progress_in_loop(meter->context, n, 16) || !is_lit[i] || !is_asked(lamp, n)) continue;
    add_sample(meter, lamp, sample, n, &depths[i]);
  }
  meter->seconds += fum_now_s() - start_s;
}

void fum_meter_ask(fum_meter *meter, const fum_slabs *slabs, const fum_lattice *lattice) {
  const double start_s = fum_now_s();
  for (int32_t l = 0; l < meter->lamps->count; l++) {
    for (int64_t n = 0; n < meter->count; n++) {
      const int64_t i = l * meter->count + n;
      const fum_meter_point *p = &meter->points[n];
      const double depth =
          fum_lattice_depth(lattice, slabs, &meter->lamps->items[l], l, p->window, p->range, p->position);
      meter->found[i] = meter->sent[i] * exp(-depth);
    }
  }
  meter->seconds += fum_now_s() - start_s;
}

static int compare(const void *a, const void *b) {
  const double x = *(const double *)a, y = *(const double *)b;
  return (x > y) - (x < y);
}

int32_t fum_meter_read(const fum_meter *meter, fum_accuracy *out_accuracy) {
  const int64_t values = meter->count * meter->lamps->count;
  fum_accuracy a = {0};
  double *errors = NULL;
  int64_t n = 0;
  const int32_t status = fum_alloc(meter->context, values, sizeof *errors, "meter", &errors);
  if (status != FUM_OK) return status;
  for (int64_t point = 0; point < meter->count; point++) {
    bool is_lit = false;
    for (int64_t i = point; i < values; i += meter->count) {
      if (!(meter->sent[i] > 0.0)) continue;
      const double exact = meter->exact[i] / meter->sent[i], error = meter->found[i] / meter->sent[i] - exact;
      is_lit = true;
      errors[n++] = fabs(error);
      a.bias += error;
      a.rms += error * error;
      a.level += exact * exact;
    }
    a.count += is_lit;
  }
  if (n > 0) {
    qsort(errors, (size_t)n, sizeof *errors, compare);
    a.bias /= (double)n;
    a.rms = sqrt(a.rms / (double)n);
    a.level = sqrt(a.level / (double)n);
    a.p95 = errors[(n - 1) * 95 / 100];
    a.worst = errors[n - 1];
  }
  *out_accuracy = a;
  fum_free(meter->context, &errors);
  return FUM_OK;
}
