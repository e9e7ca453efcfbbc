/* SPDX-License-Identifier: GPL-3.0-or-later */
#include "octree/source.h"

#include "base/hash.h"
#include "base/vector.h"

#include <string.h>

static int64_t count_set(const fum_source *source, int32_t set) {
  const bool *takes = source->options->takes;
  return takes == NULL || takes[set] ? source->scene->particles[set].count : 0;
}

int64_t fum_source_count(const fum_source *source) {
  int64_t count = source->point_count;
  for (int32_t s = 0; source->scene != NULL && s < source->scene->particles_count; s++)
    count += count_set(source, s);
  return count;
}

static void open_set(fum_source_reader *r, int32_t index) {
  r->set_index = index;
  r->set = &r->source->scene->particles[index];
  r->positions = r->set->positions;
  r->next = 0;
}

static int64_t left_in_set(const fum_source_reader *r) {
  return (r->set != NULL ? count_set(r->source, r->set_index) : r->source->point_count) - r->next;
}

void fum_source_begin(const fum_source *source, int block, int blocks, fum_source_reader *r) {
  const int64_t count = fum_source_count(source);
  int64_t before = fum_block_begin(count, block, blocks);
  r->source = source;
  r->set = NULL;
  r->positions = source->points;
  r->set_index = 0;
  r->stretches = r->next = 0;
  r->count = 0;
  r->left = fum_block_begin(count, block + 1, blocks) - before;
  if (r->left == 0) return;
  if (source->scene != NULL) open_set(r, 0);
  while (before >= left_in_set(r)) {
    before -= left_in_set(r);
    open_set(r, r->set_index + 1);
  }
  r->next = before;
}

/* Finds the numbers of those of the stretch that go in; returns how many they are. */
static int32_t choose(const fum_source_reader *r, int64_t begin, int64_t end, uint32_t *out) {
  const float share = r->set != NULL ? r->source->options->subsampling : 1.0F;
  int32_t count = 0;
  for (int64_t i = begin; i < end; i++) {
    out[count] = (uint32_t)i;
    count += share >= 1.0F || fum_hash_unit(fum_particle_identity(r->set, i)) < (double)share;
  }
  return count;
}

/* Particles whose places are found in one go, as vectors of any width. */
enum { ABREAST = 4 };

static void find_places(const double origin[3], int32_t count, const float *restrict positions,
                        float out[3][FUM_SOURCE_STRETCH]) {
  double origins[3 * ABREAST];
  for (int k = 0; k < 3 * ABREAST; k++)
    origins[k] = origin[k % 3];
  for (int32_t i = 0; i < count; i += ABREAST) {
    float places[3 * ABREAST];
    for (int k = 0; k < 3 * ABREAST; k++)
      places[k] = (float)((double)positions[3 * i + k] - origins[k]);
    for (int k = 0; k < ABREAST; k++) {
      for (int axis = 0; axis < 3; axis++)
        out[axis][i + k] = places[3 * k + axis];
    }
  }
}

bool fum_source_read(fum_context *context, fum_source_reader *r) {
  const int64_t stretches_between_pulses = 256;
  const double local[3] = {0.0, 0.0, 0.0};
  if (r->left == 0 || fum_progress_in_loop(context, r->stretches++, stretches_between_pulses)) return false;
  while (left_in_set(r) == 0)
    open_set(r, r->set_index + 1);
  const int64_t in_set = left_in_set(r), most = in_set < FUM_SOURCE_STRETCH ? in_set : FUM_SOURCE_STRETCH;
  const int64_t count = most < r->left ? most : r->left;
  r->count = choose(r, r->next, r->next + count, r->numbers);
  const float *positions = r->positions + 3 * r->next;
  float chosen[3 * (FUM_SOURCE_STRETCH + ABREAST)];
  if (r->count < FUM_SOURCE_STRETCH) {
    for (int32_t i = 0; i < r->count; i++)
      memcpy(chosen + 3 * i, r->positions + 3 * (size_t)r->numbers[i], 3 * sizeof *chosen);
    memset(chosen + 3 * r->count, 0, 3 * ABREAST * sizeof *chosen);
    positions = chosen;
  }
  find_places(r->set != NULL ? r->source->scene->origin : local, r->count, positions, r->places);
  r->next += count;
  r->left -= count;
  return true;
}

static void weigh(int32_t count, double share, const float *restrict sigmas, const float *restrict densities,
                  float *restrict inverse_sigmas, float *restrict optical_depths) {
  for (int32_t i = 0; i < count; i++) {
    const double sigma = (double)sigmas[i], inverse = 1.0 / sigma;
    const double depth = (double)densities[i] / share * sigma * FUM_SQRT_2PI;
    inverse_sigmas[i] = (float)(inverse < 1e18 ? inverse : 1e18); /* its square stays finite */
    optical_depths[i] = (float)(depth < 1e30 ? depth : 1e30);
  }
}

void fum_source_describe(const fum_source_reader *r, uint32_t indices[FUM_SOURCE_STRETCH],
                         float inverse_sigmas[FUM_SOURCE_STRETCH], float optical_depths[FUM_SOURCE_STRETCH]) {
  const uint32_t offset = r->set != NULL ? (uint32_t)r->set->offset : 0;
  float sigmas[FUM_SOURCE_STRETCH], densities[FUM_SOURCE_STRETCH];
  for (int32_t i = 0; i < r->count; i++)
    indices[i] = offset + r->numbers[i];
  if (r->set == NULL) return;
  for (int32_t i = 0; i < r->count; i++) {
    sigmas[i] = r->set->sigmas[r->numbers[i]];
    densities[i] = r->set->densities[r->numbers[i]];
  }
  const float share = r->source->options->subsampling;
  weigh(r->count, share < 1.0F ? (double)share : 1.0, sigmas, densities, inverse_sigmas, optical_depths);
}
