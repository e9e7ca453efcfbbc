/* SPDX-License-Identifier: GPL-3.0-or-later */
#include "lighting/sweep.h"

#include "base/cpu.h"
#include "lighting/sweep_near.h"

#include <omp.h>
#include <stdlib.h>
#include <string.h>

void fum_sweep_plain(const fum_sweep_job *job, int64_t index, fum_sweep_scratch *scratch);
void fum_sweep_avx2(const fum_sweep_job *job, int64_t index, fum_sweep_scratch *scratch);
void fum_sweep_avx512(const fum_sweep_job *job, int64_t index, fum_sweep_scratch *scratch);

fum_sweep_fn fum_sweep_get(void) {
  return FUM_CPU_CHOOSE(fum_sweep_plain, fum_sweep_avx2, fum_sweep_avx512);
}

/* A level's sigmas in steps of its grid, from the smallest to the largest; larger ones would reach over more faces than
 * are open at once. */
static const float LEAST_SIGMA = 0.75F, MOST_SIGMA = 1.7F;

enum { BINS_PER_OCTAVE = 32, MOST_OCTAVES = 24, BINS = BINS_PER_OCTAVE * MOST_OCTAVES };

/* Bins of sigmas, even within each octave: the top bits of a float count them. */
static int32_t bin_of(float sigma, float smallest) {
  const int shift = 23 - 5; /* 2^5 bins an octave */
  uint32_t bits, first;
  memcpy(&bits, &sigma, sizeof bits);
  memcpy(&first, &smallest, sizeof first);
  return (int32_t)(bits >> shift) - (int32_t)(first >> shift);
}

/* The smallest sigma of a bin. */
static float begin_of(int32_t bin, float smallest) {
  const int shift = 23 - 5;
  uint32_t bits;
  float begin;
  memcpy(&bits, &smallest, sizeof bits);
  bits = ((bits >> shift) + (uint32_t)bin) << shift;
  memcpy(&begin, &bits, sizeof begin);
  return begin;
}

/* Casters by how large they look: how many, and the nearest and farthest from the light. */
typedef struct census {
  int64_t counts[BINS];
  double nearest[BINS], farthest[BINS]; /* m */
} census;

static void take_census(fum_context *context, const fum_medium *medium, const fum_sweep_view *view, census *out) {
  const fum_octree *casters = fum_medium_casters(medium);
  int64_t *counts = out->counts;
  double *nearest = out->nearest, *farthest = out->farthest;
  for (int32_t bin = 0; bin < BINS; bin++) {
    counts[bin] = 0;
    nearest[bin] = INFINITY;
    farthest[bin] = 0.0;
  }
#pragma omp parallel for num_threads(fum_thread_count(context)) schedule(static) reduction(+ : counts[:BINS]) reduction(min : nearest[:BINS]) reduction(max : farthest[:BINS])
  for (int64_t i = 0; i < casters->count; i++) {
    const float seen = view->sigmas[i];
    if (!(seen > 0.0F)) continue;
    const int32_t bin = bin_of(seen, view->smallest);
    const double distance = (double)(medium->sigma_scale / (casters->inverse_sigmas[i] * seen));
    counts[bin]++;
    nearest[bin] = distance < nearest[bin] ? distance : nearest[bin];
    farthest[bin] = distance > farthest[bin] ? distance : farthest[bin];
  }
}

/* A level and the distances of its casters from the light. */
typedef struct shell {
  fum_sweep_level level;
  double nearest, farthest; /* m; of a light that isn't parallel */
} shell;

/* Levels that hold all casters, from the smallest on, each up to `ratio` between its sigmas. Returns how many; 0: too
 * many. */
static int32_t cut_levels(const fum_sweep_view *view, const census *c, double ratio, shell *shells) {
  int32_t count = 0;
  for (int32_t bin = 0; bin < BINS; bin++) {
    if (c->counts[bin] == 0) continue;
    if (count == FUM_SWEEP_MOST_LEVELS) return 0;
    const float begin = begin_of(bin, view->smallest), smallest = fmaxf(begin, view->smallest);
    shell *s = &shells[count++];
    *s = (shell){.nearest = c->nearest[bin], .farthest = c->farthest[bin]};
    while (bin + 1 < BINS && (double)begin_of(bin + 2, view->smallest) <= (double)smallest * ratio) {
      bin++;
      s->nearest = fmin(s->nearest, c->nearest[bin]);
      s->farthest = fmax(s->farthest, c->farthest[bin]);
    }
    s->level = (fum_sweep_level){
        .smallest = begin, .largest = begin_of(bin + 1, view->smallest), .cell = smallest / LEAST_SIGMA};
  }
  return count;
}

/* As few levels as there can be, and with those as fine cells as there can be. Returns how many; 0: too many. */
static int32_t find_levels(const fum_sweep_view *view, const census *c, shell *shells) {
  const double most = (double)(MOST_SIGMA / LEAST_SIGMA);
  const int32_t count = cut_levels(view, c, most, shells);
  shell even[FUM_SWEEP_MOST_LEVELS];
  if (count < 2) return count;
  /* A bin more, as they begin and end at bins. */
  const double bin = pow(2.0, 1.0 / BINS_PER_OCTAVE);
  const double ratio = bin * pow((double)(view->largest / view->smallest), 1.0 / (double)count);
  if (ratio < most && cut_levels(view, c, ratio, even) == count) memcpy(shells, even, sizeof even);
  return count;
}

/* The distance at a range. */
static double distance_at(const fum_sweep_view *view, double range) {
  double low = 0.0, high = view->farthest;
  for (int step = 0; step < 50; step++) {
    const double middle = 0.5 * (low + high);
    *(fum_sweep_range(view, middle) < range ? &low : &high) = middle;
  }
  return low;
}

/* Slabs from before the first caster to behind the last. */
static void cut_slabs(const fum_medium *medium, const fum_sweep_view *view, shell *s) {
  fum_sweep_level *level = &s->level;
  /* As long as cells are wide, but far from the reference, where ranges grow more slowly than distances. */
  level->slab = level->cell;
  double from = INFINITY, to = -INFINITY;
  if (view->is_parallel) {
    const fum_octree_node *root = &fum_medium_casters(medium)->nodes[0];
    double squared = 0.0;
    for (int axis = 0; axis < 3; axis++)
      squared += 0.25 * pow((double)root->upper[axis] - (double)root->lower[axis], 2.0);
    from = -sqrt(squared);
    to = sqrt(squared);
  } else {
    from = fum_sweep_range(view, s->nearest);
    to = fum_sweep_range(view, s->farthest);
  }
  const double reach = 4.0 + (double)(FUM_SWEEP_SPREAD * MOST_SIGMA);
  level->first = (float)(from - (reach + 1.0) * (double)level->slab);
  level->begin = view->is_parallel ? 0.0 : distance_at(view, (double)level->first);
  const double slabs = ceil((to - (double)level->first) / (double)level->slab + reach);
  level->slab_count = 2 * (int32_t)fmin(1e8, ceil(0.5 * slabs));
}

static int32_t sweep_level(fum_context *context, const fum_sweep_job *job, const float progress[2]) {
  const fum_sweep_fn sweep_patch = fum_sweep_get();
  atomic_bool is_out_of_memory = false;
  atomic_int_least64_t patches_done = 0;
#pragma omp parallel num_threads(fum_thread_count(context))
  {
    fum_sweep_scratch scratch = {0};
#pragma omp for schedule(dynamic, 1)
    for (int64_t i = 0; i < job->patches->count; i++) {
      if (fum_is_cancelled(context) || atomic_load(&is_out_of_memory)) continue;
      sweep_patch(job, job->patches->order[i].index, &scratch);
      if (scratch.is_out_of_memory) atomic_store(&is_out_of_memory, true);
      const int64_t done = atomic_fetch_add(&patches_done, 1) + 1;
      if (omp_get_thread_num() != 0) continue;
      const float share = (float)done / (float)job->patches->count;
      (void)fum_progress_report(context, FUM_STAGE_LIGHTING, progress[0] + (progress[1] - progress[0]) * share,
                                "Lighting particles");
    }
    for (int k = 0; k < FUM_SWEEP_BUFFER_COUNT; k++)
      free(scratch.buffers[k]);
  }
  if (atomic_load(&is_out_of_memory)) return fum_fail(context, FUM_ERROR_MEMORY, "lighting: no memory for a patch");
  return fum_is_cancelled(context) ? FUM_ERROR_CANCELLED : FUM_OK;
}

static int32_t solve_level(fum_context *context, const fum_sweep_task *task, const float progress[2],
                           fum_sweep_view *view, const fum_sweep_level *level, float *depths) {
  const fum_medium *medium = task->medium;
  fum_sweep_patches patches = {0};
  (void)fum_sweep_lay(level, view, &patches.count);
  int32_t status = fum_sweep_sort(context, medium, task->receivers, task->is_lit, view, level, &patches);
  const double *o = view->to_middle, squared = o[0] * o[0] + o[1] * o[1] + o[2] * o[2];
  const float edge = expf(-0.5F * view->reach * view->reach);
  const fum_sweep_job job = {.casters = fum_medium_casters(medium),
                             .points = task->receivers->octree,
                             .sigma_scale = medium->sigma_scale,
                             .depth_scale = medium->depth_scale / (1.0F - edge),
                             .edge = edge,
                             .view = view,
                             .level = level,
                             .patches = &patches,
                             .to_middle = {(float)o[0], (float)o[1], (float)o[2]},
                             .beyond = (float)(squared - view->reference * view->reference),
                             .is_lit = task->is_lit,
                             .depths = depths};
  if (status == FUM_OK) status = sweep_level(context, &job, progress);
  fum_sweep_patches_free(context, &patches);
  return status;
}

/* Levels with slabs, and how many slabs all of their patches have together. Returns how many; 0: casters are too
 * unlike, or too small for a grid. */
static int32_t plan_levels(fum_context *context, const fum_sweep_task *task, fum_sweep_view *view, shell *shells,
                           double *out_slabs) {
  const int32_t most_slabs = 100000;
  census c;
  int64_t patches;
  if (!(view->largest < view->smallest * (float)(1 << (MOST_OCTAVES - 1)))) return 0;
  take_census(context, task->medium, view, &c);
  const int32_t count = find_levels(view, &c, shells);
  *out_slabs = 0.0;
  for (int32_t k = 0; k < count; k++) {
    cut_slabs(task->medium, view, &shells[k]);
    if (!fum_sweep_lay(&shells[k].level, view, &patches) || shells[k].level.slab_count > most_slabs) return 0;
    *out_slabs += (double)patches * (double)shells[k].level.slab_count;
  }
  return count;
}

/* Of measured times: a caster takes its time at its own level, more where it reaches over sides of a cube, and each is
 * looked at, as each receiver is, at all of them. Grids for small casters are large, however few these are. */
static bool is_affordable(const fum_sweep_task *task, const fum_sweep_view *view, const fum_sweep_near *near,
                          int32_t levels, double slabs) {
  const double casters = (double)fum_medium_casters(task->medium)->count;
  const double receivers = (double)task->receivers->octree->count;
  const double once_us = (view->face_count > 1 ? 0.35 : 0.16) * casters;
  const double level_us = 0.04 * casters + 0.04 * receivers, grids_us = 0.4 * slabs;
  return once_us + (double)levels * level_us + grids_us + near->cost_us <= task->affordable_us;
}

static int32_t solve_levels(fum_context *context, const fum_sweep_task *task, const float progress[2],
                            fum_sweep_view *view, int32_t count, const shell *shells, float *depths) {
  int32_t status = FUM_OK;
  for (int32_t k = 0; k < count && status == FUM_OK; k++) {
    const float step = (progress[1] - progress[0]) / (float)count, from = progress[0] + step * (float)k;
    status = solve_level(context, task, (float[2]){from, from + step}, view, &shells[k].level, depths);
  }
  return status;
}

int32_t fum_sweep_solve(fum_context *context, const fum_sweep_task *task, const float progress[2], float *out_depths,
                        bool *out_is_solved) {
  fum_sweep_view view = {0};
  fum_sweep_near near = {0};
  shell shells[FUM_SWEEP_MOST_LEVELS];
  bool is_clear;
  double slabs = 0.0;
  *out_is_solved = false;
  int32_t status = fum_sweep_view_find(context, task->medium, task->emitter, &view, &is_clear);
  const int32_t count = status == FUM_OK && is_clear ? plan_levels(context, task, &view, shells, &slabs) : 0;
  if (count == 0) goto done;
  status = fum_sweep_near_plan(context, task, &view, &near);
  if (status != FUM_OK || !near.is_worthwhile || !is_affordable(task, &view, &near, count, slabs)) goto done;
#pragma omp parallel for num_threads(fum_thread_count(context)) schedule(static)
  for (int64_t i = 0; i < task->receivers->octree->count; i++) {
    if (task->is_lit[i]) out_depths[i] = 0.0F;
  }
  const float from = progress[0] + (view.vicinity.count > 0 ? 0.2F : 0.0F) * (progress[1] - progress[0]);
  status = fum_sweep_near_solve(context, task, &view, &near, (float[2]){progress[0], from}, out_depths);
  if (status == FUM_OK)
    status = solve_levels(context, task, (float[2]){from, progress[1]}, &view, count, shells, out_depths);
  *out_is_solved = status == FUM_OK;
done:
  fum_sweep_near_free(context, &near);
  fum_sweep_view_free(context, &view);
  return status;
}
