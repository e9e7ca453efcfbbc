/* SPDX-License-Identifier: GPL-3.0-or-later */
#include "lighting/exact.h"

#include <omp.h>

/* A group of receivers on its way to the light. */
typedef struct walk {
  const fum_medium *medium;
  const fum_run_loops *loops;
  fum_beam beam;
  int32_t count;
  fum_segment segments[FUM_GROUP_SIZE];
  float depths[FUM_GROUP_SIZE];
  fum_batch batch;
} walk;

static void flush(walk *w) {
  for (int32_t i = 0; i < w->count && w->batch.count > 0; i++) {
    if (w->depths[i] < w->medium->depth_limit) w->depths[i] += w->loops->sum(&w->batch, &w->segments[i]);
  }
  w->batch.count = 0;
}

static bool is_dark(const walk *w) {
  for (int32_t i = 0; i < w->count; i++) {
    if (w->depths[i] < w->medium->depth_limit) return false;
  }
  return true;
}

static void append(walk *w, uint32_t run) {
  const fum_spheres *spheres = &w->medium->spheres;
  fum_batch *b = &w->batch;
  const int32_t n = b->count++;
  b->runs[n] = &w->medium->runs[run];
  b->x[n] = spheres->x[run];
  b->y[n] = spheres->y[run];
  b->z[n] = spheres->z[run];
  b->hearing[n] = spheres->hearing[run];
  b->clear[n] = spheres->clear[run];
}

static bool visit(void *user, const fum_octree_node *node, float reach) {
  (void)reach;
  walk *w = user;
  const uint32_t first = w->medium->first_runs[node - fum_medium_casters(w->medium)->nodes];
  const uint32_t end = first + (node->count + FUM_RUN_SIZE - 1) / FUM_RUN_SIZE;
  for (uint32_t run = first; run < end; run += FUM_BATCH_SIZE) {
    const int32_t count = end - run < FUM_BATCH_SIZE ? (int32_t)(end - run) : FUM_BATCH_SIZE;
    for (uint64_t heard = w->loops->hear(&w->beam, &w->medium->spheres, run, count); heard != 0; heard &= heard - 1) {
      if (w->batch.count == FUM_BATCH_SIZE) {
        flush(w);
        if (is_dark(w)) return false;
      }
      append(w, run + (uint32_t)__builtin_ctzll(heard));
    }
  }
  return true;
}

static fum_vec3 receiver_position(const fum_receivers *receivers, uint32_t i) {
  const fum_octree *octree = receivers->octree;
  return (fum_vec3){octree->x[i], octree->y[i], octree->z[i]};
}

/* The segment from a receiver to the light. One of no length has no particles on it. */
static fum_segment segment_to(const fum_emitter *emitter, fum_vec3 from) {
  const fum_way way = fum_emitter_way(emitter, from);
  const fum_vec3 d = way.direction;
  return (fum_segment){{from.x, from.y, from.z}, {d.x, d.y, d.z}, way.length};
}

/* The beam around the segments: it starts as wide as the group and narrows towards the light, if that is far away. */
static void find_beam(walk *w, const fum_emitter *emitter) {
  fum_vec3 lower = {INFINITY, INFINITY, INFINITY}, upper = {-INFINITY, -INFINITY, -INFINITY};
  for (int32_t i = 0; i < w->count; i++) {
    const float *p = w->segments[i].origin;
    lower = (fum_vec3){fminf(lower.x, p[0]), fminf(lower.y, p[1]), fminf(lower.z, p[2])};
    upper = (fum_vec3){fmaxf(upper.x, p[0]), fmaxf(upper.y, p[1]), fmaxf(upper.z, p[2])};
  }
  const fum_vec3 middle = {0.5F * (lower.x + upper.x), 0.5F * (lower.y + upper.y), 0.5F * (lower.z + upper.z)};
  const fum_segment axis = segment_to(emitter, middle);
  const fum_vec3 direction = {axis.direction[0], axis.direction[1], axis.direction[2]};
  float radius = 0.0F;
  for (int32_t i = 0; i < w->count; i++) {
    const fum_segment *s = &w->segments[i];
    const fum_vec3 offset = {s->origin[0] - middle.x, s->origin[1] - middle.y, s->origin[2] - middle.z};
    radius = fmaxf(radius, fum_length(offset));
  }
  const bool narrows = !emitter->is_directional && axis.length > radius;
  w->beam = (fum_beam){.start = middle,
                       .axis = direction,
                       .first = -radius,
                       .last = axis.length + radius,
                       .radius = radius,
                       .slope = narrows ? -radius / axis.length : 0.0F};
}

static void solve_group(walk *w, const fum_receivers *receivers, int64_t group, const fum_emitter *emitter,
                        const uint8_t *is_lit, float *out_depths) {
  const uint32_t begin = receivers->group_begins[group], end = receivers->group_begins[group + 1];
  w->count = 0;
  for (uint32_t i = begin; i < end; i++) {
    if (!is_lit[i]) continue;
    w->depths[w->count] = 0.0F;
    w->segments[w->count++] = segment_to(emitter, receiver_position(receivers, i));
  }
  if (w->count == 0) return;
  find_beam(w, emitter);
  w->batch.count = 0;
  fum_beam_walk(fum_medium_casters(w->medium), w->medium->reaches, FUM_PACKET_SIZE, &w->beam, visit, w);
  flush(w);
  int32_t n = 0;
  for (uint32_t i = begin; i < end; i++) {
    if (is_lit[i]) out_depths[i] = w->depths[n++];
  }
}

int32_t fum_exact_solve(fum_context *context, fum_medium *medium, fum_receivers *receivers, const fum_emitter *emitter,
                        const uint8_t *is_lit, const float progress[2], float *out_depths) {
  walk *walks = NULL;
  const int32_t threads = fum_thread_count(context);
  int32_t status = fum_medium_lay_runs(context, medium);
  if (status == FUM_OK) status = fum_receivers_group(context, receivers);
  if (status == FUM_OK) status = fum_alloc(context, threads, sizeof *walks, "lighting", &walks);
  if (status != FUM_OK) return status;
  atomic_int_least64_t groups_done = 0;
#pragma omp parallel num_threads(threads)
  {
    const int thread = omp_get_thread_num();
    walk *w = &walks[thread];
    w->medium = medium;
    w->loops = fum_run_loops_get();
#pragma omp for schedule(dynamic, 4)
    for (int64_t group = 0; group < receivers->group_count; group++) {
      if (fum_is_cancelled(context)) continue;
      solve_group(w, receivers, group, emitter, is_lit, out_depths);
      const int64_t done = atomic_fetch_add(&groups_done, 1) + 1;
      if (thread == 0) {
        const float share = (float)done / (float)receivers->group_count;
        const float fraction = progress[0] + (progress[1] - progress[0]) * share;
        (void)fum_progress_report(context, FUM_STAGE_LIGHTING, fraction, "Lighting particles");
      }
    }
  }
  status = fum_is_cancelled(context) ? FUM_ERROR_CANCELLED : FUM_OK;
  fum_free(context, &walks);
  return status;
}
