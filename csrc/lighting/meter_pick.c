/* SPDX-License-Identifier: GPL-3.0-or-later */
#include "lighting/meter_pick.h"

#include "base/hash.h"
#include "base/radix.h"

#include <math.h>

/* Inverted: subsampling hangs on the hash of the identity itself. */
static uint64_t key_of(const fum_particles *set, int64_t i) {
  return fum_hash64(~fum_particle_identity(set, i));
}

static const fum_particles *set_at(const fum_particles *set, int64_t index) {
  while (index >= set->offset + set->count)
    set++;
  return set;
}

/* Notes in a bit for each of the scene's particles whether its key is below the limit. */
static int64_t mark(fum_context *context, const fum_scene *scene, uint64_t limit, uint64_t *words) {
  const int64_t particle_count = scene->particle_count;
  int64_t marked = 0;
#pragma omp parallel for num_threads(fum_thread_count(context)) schedule(static) reduction(+ : marked)
  for (int64_t w = 0; w < (particle_count + 63) / 64; w++) {
    const int64_t end = 64 * w + 64 < particle_count ? 64 * w + 64 : particle_count;
    const fum_particles *set = fum_scene_particles_of(scene, 64 * w);
    if (fum_progress_in_loop(context, w, 1 << 12)) continue;
    for (int64_t i = 64 * w; i < end; i++) {
      set = set_at(set, i);
      words[w] |= (uint64_t)(key_of(set, i - set->offset) <= limit) << (i & 63);
    }
    marked += __builtin_popcountll(words[w]);
  }
  return marked;
}

/* Where ids don't differ keys say nothing: then they are taken at equal intervals. */
static int64_t mark_evenly(int64_t particle_count, int64_t wanted, uint64_t *words) {
  for (int64_t k = 0; k < wanted; k++) {
    const int64_t i = k * particle_count / wanted;
    words[i / 64] |= UINT64_C(1) << (i & 63);
  }
  return wanted;
}

/* Those that are marked and in the octree, in its order. */
static int64_t collect(const fum_octree *octree, const uint64_t *words, uint32_t *ranks) {
  int64_t count = 0;
  for (int64_t rank = 0; rank < octree->count; rank++) {
    const uint32_t index = octree->indices[rank];
    if (words[index / 64] >> (index & 63) & 1) ranks[count++] = (uint32_t)rank;
  }
  return count;
}

int32_t fum_meter_pick(fum_context *context, const fum_scene *scene, const fum_octree *octree, int64_t most,
                       fum_meter_picks *out_picks) {
  const char *what = "meter";
  const int64_t all = scene->particle_count;
  const int64_t wanted = octree->count < most ? octree->count : most;
  fum_meter_picks picks = {0};
  uint64_t *words = NULL;
  int32_t status = fum_alloc(context, (all + 63) / 64, sizeof *words, what, &words);
  if (status != FUM_OK || wanted == 0) goto done;
  /* Particles of the scene that aren't in the octree have keys as well. */
  const double share = fmin(1.0, (double)wanted / (double)octree->count);
  int64_t marked = mark(context, scene, share < 1.0 ? (uint64_t)ldexp(share, 64) : UINT64_MAX, words);
  const double expected = share * (double)all;
  if (fabs((double)marked - expected) > 0.5 * expected) {
    for (int64_t w = 0; w < (all + 63) / 64; w++)
      words[w] = 0;
    marked = mark_evenly(all, (int64_t)expected, words);
  }
  status = fum_alloc(context, marked, sizeof *picks.keys, what, &picks.keys);
  if (status == FUM_OK) status = fum_alloc(context, marked, sizeof *picks.ranks, what, &picks.ranks);
  if (status != FUM_OK) goto done;
  picks.count = collect(octree, words, picks.ranks);
  for (int64_t k = 0; k < picks.count; k++) {
    const int64_t index = octree->indices[picks.ranks[k]];
    const fum_particles *set = fum_scene_particles_of(scene, index);
    picks.keys[k] = key_of(set, index - set->offset);
  }
  status = fum_radix_sort(context, picks.count, 0, picks.keys, picks.ranks);
  if (status != FUM_OK) goto done;
  *out_picks = picks;
  picks = (fum_meter_picks){0};
done:
  fum_meter_picks_free(context, &picks);
  fum_free(context, &words);
  return status;
}

void fum_meter_picks_free(fum_context *context, fum_meter_picks *picks) {
  fum_free(context, &picks->keys);
  fum_free(context, &picks->ranks);
}
