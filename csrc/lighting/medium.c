/* SPDX-License-Identifier: GPL-3.0-or-later */
#include "lighting/medium.h"

#include "lighting/neighbours.h"

static int64_t runs_of(const fum_octree_node *node) {
  return (node->count + FUM_RUN_SIZE - 1) / FUM_RUN_SIZE;
}

/* Numbers the runs; nodes below a cut one, and those above, get none. Children come after their parents. */
static int64_t number_runs(const fum_octree *octree, uint8_t *is_cut, uint8_t *is_below, uint32_t *first_runs) {
  int64_t count = 0;
  for (int64_t i = 0; i < octree->node_count; i++) {
    const fum_octree_node *node = &octree->nodes[i];
    const bool ends_here = node->children == 0 || node->count <= FUM_PACKET_SIZE;
    is_cut[i] = !is_below[i] && ends_here;
    first_runs[i] = (uint32_t)count;
    if (is_cut[i]) count += runs_of(node);
    const int children = __builtin_popcount(node->octants);
    for (int c = 0; c < children; c++)
      is_below[node->children + (uint32_t)c] = is_below[i] || ends_here;
  }
  return count;
}

static fum_vec3 middle_of(const fum_octree *octree, const uint32_t *particles, uint32_t count) {
  fum_vec3 lower = {INFINITY, INFINITY, INFINITY}, upper = {-INFINITY, -INFINITY, -INFINITY};
  for (uint32_t i = 0; i < count; i++) {
    const fum_vec3 p = {octree->x[particles[i]], octree->y[particles[i]], octree->z[particles[i]]};
    lower = (fum_vec3){fminf(lower.x, p.x), fminf(lower.y, p.y), fminf(lower.z, p.z)};
    upper = (fum_vec3){fmaxf(upper.x, p.x), fmaxf(upper.y, p.y), fmaxf(upper.z, p.z)};
  }
  return (fum_vec3){0.5F * (lower.x + upper.x), 0.5F * (lower.y + upper.y), 0.5F * (lower.z + upper.z)};
}

/* What a segment that passes the middle of a run at distance `d` loses by not hearing it: at most, and on average over
 * all directions if offsets are taken as normally distributed. */
typedef struct loss {
  float most, mean;
} loss;

static loss loss_at(const fum_run *run, const float *offsets, float d) {
  loss lost = {0};
  for (int i = 0; i < FUM_RUN_SIZE; i++) {
    const float near = fmaxf(d - offsets[i], 0.0F) * run->scales[i];
    const float wide = d * run->scales[i], spread = offsets[i] * run->scales[i];
    lost.most += run->optical_depths[i] * exp2f(-near * near);
    lost.mean += run->optical_depths[i] * exp2f(-wide * wide / (1.0F + spread * spread * (2.0F / 3.0F) * 0.69314718F));
  }
  return lost;
}

/* Distance from its middle over which a run is heard. A single run, however dense, may be missed only where it weighs less
 * than the error divided among a few; and of smoke of many runs, a share of optical depth is lost everywhere: tau
 * exp(-tau) is at most 1 / e. `most` misses nothing that matters. */
static float hearing_of(const fum_run *run, const float *offsets, float optical_depth, float error, float most) {
  const float runs = 4.0F;
  float low = 0.0F, high = most;
  for (int step = 0; step < 7; step++) {
    const float middle = 0.5F * (low + high);
    const loss lost = loss_at(run, offsets, middle);
    const bool is_heard = lost.most * runs > error || lost.mean > 2.0F * error * optical_depth;
    low = is_heard ? middle : low;
    high = is_heard ? high : middle;
  }
  return high;
}

/* Sigmas from an end of a segment beyond which it cuts less than a twentieth of the error off a particle of any optical
 * depth: the tail of the normal distribution is below exp(-c^2 / 2) / (2.5 c), and tau exp(-tau) at most 1 / e. */
static float clear_of(float error) {
  const float share = 0.05F * 2.718F * error;
  float c = 3.0F;
  while (c < 6.0F && expf(-0.5F * c * c) / (2.5F * c) > share)
    c += 0.125F;
  return c;
}

/* Lays out one run; returns how far its particles are heard. */
static float lay_run(fum_medium *medium, float error, int64_t number, const uint32_t *particles, uint32_t count) {
  const float scale_sigmas = 0.84932180F; /* sqrt(log2(e) / 2) */
  const fum_octree *octree = medium->octree;
  const fum_vec3 middle = middle_of(octree, particles, count);
  fum_run *run = &medium->runs[number];
  float optical_depth = 0.0F, widest = 0.0F, hearing = 0.0F, clear = 0.0F;
  for (uint32_t i = 0; i < FUM_RUN_SIZE; i++) {
    const uint32_t p = particles[i < count ? i : 0];
    const float inverse_sigma = octree->inverse_sigmas[p] / medium->sigma_scale;
    run->x[i] = octree->x[p] - middle.x;
    run->y[i] = octree->y[p] - middle.y;
    run->z[i] = octree->z[p] - middle.z;
    run->scales[i] = scale_sigmas * inverse_sigma;
    run->optical_depths[i] = i < count ? octree->optical_depths[p] * medium->depth_scale : 0.0F;
    optical_depth += run->optical_depths[i];
    widest = fmaxf(widest, 1.0F / inverse_sigma);
  }
  const float clear_sigmas = clear_of(error);
  const float cutoff = optical_depth > 0.0F ? fum_cutoff_sigmas(optical_depth, error) : 0.0F;
  float offsets[FUM_RUN_SIZE] = {0};
  for (uint32_t i = 0; i < count; i++) {
    const float sigma = scale_sigmas / run->scales[i];
    const float offset = fum_length((fum_vec3){run->x[i], run->y[i], run->z[i]});
    offsets[i] = offset;
    hearing = fmaxf(hearing, offset + cutoff * sigma);
    clear = fmaxf(clear, offset + clear_sigmas * sigma);
  }
  hearing = hearing_of(run, offsets, optical_depth, error, hearing);
  medium->spheres.x[number] = middle.x;
  medium->spheres.y[number] = middle.y;
  medium->spheres.z[number] = middle.z;
  medium->spheres.hearing[number] = 1.00001F * hearing;
  medium->spheres.clear[number] = clear;
  return cutoff * widest;
}

static void lay_runs(fum_context *context, float error, const uint8_t *is_cut, uint32_t *order, fum_medium *medium) {
  const fum_octree *octree = medium->octree;
#pragma omp parallel for num_threads(fum_thread_count(context)) schedule(dynamic, 1024)
  for (int64_t i = 0; i < octree->node_count; i++) {
    const fum_octree_node *node = &octree->nodes[i];
    if (!is_cut[i]) continue;
    uint32_t *particles = order + node->begin;
    for (uint32_t p = 0; p < node->count; p++)
      particles[p] = node->begin + p;
    fum_neighbours_sort(octree, FUM_RUN_SIZE, node->count, particles);
    for (uint32_t begin = 0; begin < node->count; begin += FUM_RUN_SIZE) {
      const uint32_t rest = node->count - begin;
      const float reach = lay_run(medium, error, medium->first_runs[i] + begin / FUM_RUN_SIZE, particles + begin,
                                  rest < FUM_RUN_SIZE ? rest : FUM_RUN_SIZE);
      medium->reaches[i] = fmaxf(medium->reaches[i], reach);
    }
  }
  for (int64_t i = octree->node_count - 1; i >= 0; i--) {
    const fum_octree_node *node = &octree->nodes[i];
    const int children = __builtin_popcount(node->octants);
    for (int c = 0; c < children; c++)
      medium->reaches[i] = fmaxf(medium->reaches[i], medium->reaches[node->children + (uint32_t)c]);
  }
}

static int32_t allocate_runs(fum_context *context, int64_t count, fum_medium *medium) {
  const char *what = "runs of particles";
  const int64_t padded = count + FUM_RUN_SIZE;
  fum_spheres *s = &medium->spheres;
  int32_t status = fum_alloc(context, count, sizeof *medium->runs, what, &medium->runs);
  if (status == FUM_OK) status = fum_alloc(context, padded, sizeof *s->x, what, &s->x);
  if (status == FUM_OK) status = fum_alloc(context, padded, sizeof *s->y, what, &s->y);
  if (status == FUM_OK) status = fum_alloc(context, padded, sizeof *s->z, what, &s->z);
  if (status == FUM_OK) status = fum_alloc(context, padded, sizeof *s->hearing, what, &s->hearing);
  if (status == FUM_OK) status = fum_alloc(context, padded, sizeof *s->clear, what, &s->clear);
  return status;
}

int32_t fum_medium_begin(fum_context *context, float transmittance_error, fum_medium *medium) {
  const char *what = "runs of particles";
  const int64_t node_count = medium->octree->node_count;
  uint8_t *is_cut = NULL, *is_below = NULL;
  uint32_t *order = NULL;
  int32_t status = fum_alloc(context, node_count, sizeof *is_cut, what, &is_cut);
  if (status == FUM_OK) status = fum_alloc(context, node_count, sizeof *is_below, what, &is_below);
  if (status == FUM_OK) status = fum_alloc(context, medium->octree->count, sizeof *order, what, &order);
  if (status == FUM_OK)
    status = fum_alloc(context, node_count, sizeof *medium->first_runs, what, &medium->first_runs);
  if (status == FUM_OK) status = fum_alloc(context, node_count, sizeof *medium->reaches, what, &medium->reaches);
  if (status != FUM_OK) goto done;
  const int64_t count = number_runs(medium->octree, is_cut, is_below, medium->first_runs);
  status = allocate_runs(context, count, medium);
  if (status == FUM_OK) lay_runs(context, transmittance_error, is_cut, order, medium);
done:
  if (status != FUM_OK) fum_medium_end(context, medium);
  fum_free(context, &order);
  fum_free(context, &is_below);
  fum_free(context, &is_cut);
  return status;
}

void fum_medium_end(fum_context *context, fum_medium *medium) {
  fum_free(context, &medium->runs);
  fum_free(context, &medium->spheres.x);
  fum_free(context, &medium->spheres.y);
  fum_free(context, &medium->spheres.z);
  fum_free(context, &medium->spheres.hearing);
  fum_free(context, &medium->spheres.clear);
  fum_free(context, &medium->first_runs);
  fum_free(context, &medium->reaches);
}
