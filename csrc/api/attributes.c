/* SPDX-License-Identifier: GPL-3.0-or-later */
#include "api/attributes.h"

#include "pass/crypto.h"

#include <string.h>

/* What a drawing device is handed, and what it hands back. */
typedef struct drawing {
  fum_rendering *r;
  fum_draw_values_fn draw;
  void *user;
  float *values; /* [3 count] in the octree's order */
  float *rgba;   /* [height][width][4] */
} drawing;

static int64_t pixel_count(const fum_rendering *r) {
  return (int64_t)r->view.width * r->view.height;
}

/* A particle by its place in the octree's order. */
typedef struct particle {
  const fum_particles *set;
  int64_t index_in_set;
} particle;

static particle particle_at(const fum_rendering *r, int64_t rank) {
  const uint32_t index = r->scene->caches->all->indices[rank];
  const fum_particles *set = fum_scene_particles_of(r->scene, index);
  return (particle){set, index - set->offset};
}

static int32_t draw(drawing *d, bool are_colors) {
  memset(d->rgba, 0, 4 * (size_t)pixel_count(d->r) * sizeof *d->rgba);
  return d->draw(d->user, d->values, are_colors, d->rgba);
}

static int32_t make_albedo(drawing *d) {
  fum_rendering *r = d->r;
#pragma omp parallel for num_threads(fum_thread_count(r->context)) schedule(static)
  for (int64_t rank = 0; rank < r->scene->caches->all->count; rank++) {
    const particle p = particle_at(r, rank);
    const float *albedo = p.set->albedos != NULL ? p.set->albedos + 3 * p.index_in_set : p.set->albedo;
    memcpy(d->values + 3 * rank, albedo, 3 * sizeof *albedo);
  }
  const int32_t status = draw(d, true);
  for (int64_t i = 0; i < 3 * pixel_count(r) && status == FUM_OK; i++)
    r->albedo[i] = d->rgba[i / 3 * 4 + i % 3];
  return status;
}

/* Pixels by which a particle moves in a frame: the one before less this one, this one less the one after, as Blender
 * has it. 0 of what stands behind the camera. */
static void find_motion(const fum_rendering *r, const fum_view views[2], int64_t rank, float out[4]) {
  const fum_octree *all = r->scene->caches->all;
  const particle p = particle_at(r, rank);
  const float *velocity = p.set->velocities != NULL ? p.set->velocities + 3 * p.index_in_set : (float[3]){0};
  const double at[3] = {(double)all->x[rank], (double)all->y[rank], (double)all->z[rank]};
  double here[2], there[2][2];
  bool is_seen = fum_view_project(&r->view, at, here);
  for (int k = 0; k < 2; k++) {
    const double sign = k == 0 ? -1.0 : 1.0;
    double moved[3];
    for (int axis = 0; axis < 3; axis++)
      moved[axis] = at[axis] + sign * (double)velocity[axis];
    is_seen = is_seen && fum_view_project(&views[k], moved, there[k]);
  }
  for (int axis = 0; axis < 2; axis++) {
    out[axis] = is_seen ? (float)(there[0][axis] - here[axis]) : 0.0F;
    out[2 + axis] = is_seen ? (float)(here[axis] - there[1][axis]) : 0.0F;
  }
}

/* Motion to one of the frames beside, the mean of what adds to a pixel's opacity. */
static int32_t make_vector_to(drawing *d, const fum_view views[2], bool is_next) {
  fum_rendering *r = d->r;
#pragma omp parallel for num_threads(fum_thread_count(r->context)) schedule(static)
  for (int64_t rank = 0; rank < r->scene->caches->all->count; rank++) {
    float motion[4], *value = d->values + 3 * rank;
    find_motion(r, views, rank, motion);
    memcpy(value, motion + (is_next ? 2 : 0), 2 * sizeof *value);
    value[2] = 0.0F;
  }
  const int32_t status = draw(d, false);
  for (int64_t i = 0; i < pixel_count(r) && status == FUM_OK; i++) {
    const float *sum = d->rgba + 4 * i, per_opacity = sum[3] > 0.0F ? 1.0F / sum[3] : 0.0F;
    for (int axis = 0; axis < 2; axis++)
      r->vector[4 * i + (is_next ? 2 : 0) + axis] = sum[axis] * per_opacity;
  }
  return status;
}

static int32_t make_vector(drawing *d) {
  fum_rendering *r = d->r;
  fum_view views[2];
  int32_t status = FUM_OK;
  for (int k = 0; k < 2 && status == FUM_OK; k++) {
    status = fum_view_init_moved(r->context, r->camera, k == 1, &views[k]);
    if (status == FUM_OK) fum_view_place(&views[k], r->scene->origin);
  }
  if (status == FUM_OK) status = make_vector_to(d, views, false);
  if (status == FUM_OK) status = make_vector_to(d, views, true);
  return status;
}

/* The first set with the name of each set. */
static void find_names(const fum_scene *scene, int32_t *out_first_sets) {
  for (int32_t s = 0; s < scene->particles_count; s++) {
    int32_t first = 0;
    while (strcmp(scene->particles[first].matte_name, scene->particles[s].matte_name) != 0)
      first++;
    out_first_sets[s] = first;
  }
}

/* Three names are drawn at once: 1 in the channel of its own, 0 in the others. */
static int32_t enter_names(drawing *d, const int32_t *first_sets, const int32_t names[3], int32_t count) {
  fum_rendering *r = d->r;
  const fum_scene *scene = r->scene;
#pragma omp parallel for num_threads(fum_thread_count(r->context)) schedule(static)
  for (int64_t rank = 0; rank < scene->caches->all->count; rank++) {
    const int32_t name = first_sets[particle_at(r, rank).set - scene->particles];
    for (int32_t c = 0; c < 3; c++)
      d->values[3 * rank + c] = c < count && names[c] == name ? 1.0F : 0.0F;
  }
  const int32_t status = draw(d, false);
  for (int32_t c = 0; c < count && status == FUM_OK; c++) {
    const uint32_t hash = fum_crypto_hash(scene->particles[names[c]].matte_name);
    fum_crypto_enter(hash, pixel_count(r), d->rgba + c, 4, r->channel_share, r->crypto_count, r->crypto);
  }
  return status;
}

static int32_t make_crypto(drawing *d) {
  const fum_scene *scene = d->r->scene;
  int32_t *first_sets = NULL, names[3], count = 0;
  int32_t status =
      fum_alloc(d->r->context, scene->particles_count, sizeof *first_sets, "pass CryptoObject", &first_sets);
  if (status != FUM_OK) return status;
  find_names(scene, first_sets);
  for (int32_t s = 0; s < scene->particles_count && status == FUM_OK; s++) {
    if (first_sets[s] != s) continue;
    names[count++] = s;
    if (count < 3) continue;
    status = enter_names(d, first_sets, names, count);
    count = 0;
  }
  if (status == FUM_OK && count > 0) status = enter_names(d, first_sets, names, count);
  fum_free(d->r->context, &first_sets);
  return status;
}

bool fum_attributes_are_wanted(const fum_rendering *r) {
  return r->albedo != NULL || r->vector != NULL || r->crypto_count > 0;
}

int32_t fum_attributes_make(fum_rendering *r, fum_draw_values_fn draw_values, void *user) {
  drawing d = {.r = r, .draw = draw_values, .user = user};
  if (!fum_attributes_are_wanted(r)) return FUM_OK;
  const int64_t count = r->scene->caches->all->count;
  int32_t status = fum_alloc(r->context, count, 3 * sizeof *d.values, "values of the particles", &d.values);
  if (status == FUM_OK) status = fum_alloc(r->context, pixel_count(r), 4 * sizeof *d.rgba, "passes", &d.rgba);
  if (status == FUM_OK && r->albedo != NULL) status = make_albedo(&d);
  if (status == FUM_OK && r->vector != NULL) status = make_vector(&d);
  if (status == FUM_OK && r->crypto_count > 0) status = make_crypto(&d);
  fum_free(r->context, &d.rgba);
  fum_free(r->context, &d.values);
  return status;
}
