/* SPDX-License-Identifier: GPL-3.0-or-later */
#include "lighting/sweep.h"

#include "base/cpu.h"

#include <omp.h>
#include <stdlib.h>
#include <string.h>

void fum_sweep_plain(const fum_sweep_job *job, int64_t index, fum_sweep_scratch *scratch);
void fum_sweep_avx2(const fum_sweep_job *job, int64_t index, fum_sweep_scratch *scratch);
void fum_sweep_avx512(const fum_sweep_job *job, int64_t index, fum_sweep_scratch *scratch);

fum_sweep_fn fum_sweep_get(void) {
  return FUM_CPU_CHOOSE(fum_sweep_plain, fum_sweep_avx2, fum_sweep_avx512);
}

/* A level's sigmas in steps of its grid, from the smallest to the largest; more would not fit the block that is written
 * at once. */
static const float LEAST_SIGMA = 0.75F, MOST_SIGMA = 1.8F;

enum { BINS = 512, MOST_LEVELS = 12 };

/* How casters' sigmas are spread, in bins of equal ratio. */
typedef struct spread {
  float smallest, largest;
  int64_t counts[BINS];
} spread;

static double bins_per_log(const spread *s) {
  return (double)s->largest > (double)s->smallest ? (BINS - 1) / log((double)s->largest / (double)s->smallest) : 0.0;
}

static void find_spread(const fum_medium *medium, const fum_sweep_view *view, spread *s) {
  const fum_octree *casters = fum_medium_casters(medium);
  *s = (spread){.smallest = INFINITY};
  for (int64_t i = 0; i < casters->count; i++) {
    if (!(casters->optical_depths[i] > 0.0F)) continue;
    const float sigma = fum_sweep_sigma(view, casters, i, medium->sigma_scale);
    s->smallest = fminf(s->smallest, sigma);
    s->largest = fmaxf(s->largest, sigma);
  }
  const double per_log = bins_per_log(s);
  for (int64_t i = 0; i < casters->count; i++) {
    if (!(casters->optical_depths[i] > 0.0F)) continue;
    const double sigma = (double)fum_sweep_sigma(view, casters, i, medium->sigma_scale);
    s->counts[(int)(log(sigma / (double)s->smallest) * per_log)]++;
  }
}

/* As few levels as hold all casters, from the smallest on. Returns how many; 0: too many. */
static int32_t find_levels(const spread *s, fum_sweep_level levels[MOST_LEVELS]) {
  const double per_log = bins_per_log(s), most = log((double)(MOST_SIGMA / LEAST_SIGMA));
  int32_t count = 0;
  for (int bin = 0; bin < BINS; bin++) {
    if (s->counts[bin] == 0) continue;
    if (count == MOST_LEVELS) return 0;
    const double low = per_log > 0.0 ? bin / per_log : 0.0, high = low + most;
    const double smallest = (double)s->smallest * exp(low);
    fum_sweep_level *level = &levels[count++];
    *level = (fum_sweep_level){
        .smallest = bin == 0 ? 0.0F : (float)smallest, .cell = (float)smallest / LEAST_SIGMA, .largest = INFINITY};
    while (bin + 1 < BINS && (bin + 2) / per_log <= high)
      bin++;
    if (bin + 1 < BINS) level->largest = (float)((double)s->smallest * exp((bin + 1) / per_log));
  }
  return count;
}

/* As find_place in sweep_loop.h. */
static double range_of(const fum_sweep_view *view, double distance) {
  const double x = (distance - view->reference) / (distance + view->reference), squared = x * x;
  return 2.0 * x * (1.0 + squared * (1.0 / 3.0 + squared * (0.2 + squared / 7.0)));
}

/* Slabs from before the first caster to behind the last. */
static void cut_slabs(const fum_medium *medium, const fum_sweep_view *view, fum_sweep_level *level) {
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
    from = range_of(view, view->nearest);
    to = range_of(view, view->farthest);
  }
  const double reach = 4.0 + (double)(FUM_SWEEP_REACH * MOST_SIGMA);
  level->first = (float)(from - (reach + 1.0) * (double)level->slab);
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
#pragma omp for schedule(dynamic)
    for (int64_t i = 0; i < job->patches->count; i++) {
      if (fum_is_cancelled(context) || atomic_load(&is_out_of_memory)) continue;
      sweep_patch(job, i, &scratch);
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

static int32_t solve_level(fum_context *context, const fum_medium *medium, const fum_receivers *receivers,
                           const uint8_t *is_lit, const float progress[2], fum_sweep_view *view,
                           const fum_sweep_level *level, float *depths) {
  fum_sweep_patches patches = {0};
  (void)fum_sweep_lay(level, view, &patches.count);
  int32_t status = fum_sweep_sort(context, medium, receivers, is_lit, view, level, &patches);
  const double *o = view->to_middle, squared = o[0] * o[0] + o[1] * o[1] + o[2] * o[2];
  const fum_sweep_job job = {.casters = fum_medium_casters(medium),
                             .points = receivers->octree,
                             .sigma_scale = medium->sigma_scale,
                             .depth_scale = medium->depth_scale,
                             .view = view,
                             .level = level,
                             .patches = &patches,
                             .to_middle = {(float)o[0], (float)o[1], (float)o[2]},
                             .beyond = (float)(squared - view->reference * view->reference),
                             .depths = depths};
  if (status == FUM_OK) status = sweep_level(context, &job, progress);
  fum_sweep_patches_free(context, &patches);
  return status;
}

int32_t fum_sweep_solve(fum_context *context, const fum_medium *medium, const fum_receivers *receivers,
                        const fum_emitter *emitter, const uint8_t *is_lit, const float progress[2], float *out_depths,
                        bool *out_is_solved) {
  fum_sweep_view view;
  fum_sweep_level levels[MOST_LEVELS];
  int64_t patches;
  *out_is_solved = false;
  if (!fum_sweep_view_find(medium, emitter, &view)) return FUM_OK;
  spread s;
  find_spread(medium, &view, &s);
  const int32_t count = find_levels(&s, levels);
  for (int32_t k = 0; k < count; k++) {
    cut_slabs(medium, &view, &levels[k]);
    if (!fum_sweep_lay(&levels[k], &view, &patches) || levels[k].slab_count > 100000) return FUM_OK;
  }
  if (count == 0) return FUM_OK;
  int32_t status = FUM_OK;
  for (int64_t i = 0; i < receivers->octree->count; i++) {
    if (is_lit[i]) out_depths[i] = 0.0F;
  }
  for (int32_t k = 0; k < count && status == FUM_OK; k++) {
    const float step = (progress[1] - progress[0]) / (float)count, from = progress[0] + step * (float)k;
    status =
        solve_level(context, medium, receivers, is_lit, (float[2]){from, from + step}, &view, &levels[k], out_depths);
  }
  *out_is_solved = status == FUM_OK;
  return status;
}
