/* SPDX-License-Identifier: GPL-3.0-or-later */
#include "lighting/medium.h"

#include "octree/bunch.h"
#include "octree/neighbours.h"

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

/* What is lost by not hearing a run from distance `d` of its middle on: at most by one segment, and as a share of what
 * it weighs on all segments together (optical depth times sigma^2), offsets taken as normally distributed. */
typedef struct loss {
  float most, share;
} loss;

static loss loss_at(const fum_run *run, const float *offsets, float d) {
  float most = 0.0F, lost = 0.0F, all = 0.0F;
  for (int i = 0; i < FUM_RUN_SIZE; i++) {
    const float near = fmaxf(d - offsets[i], 0.0F) * run->scales[i];
    const float wide = d * run->scales[i], offset = offsets[i] * run->scales[i];
    const float widening = 1.0F + 0.46209812F * offset * offset; /* 1 + (offset / sigma)^2 / 3 */
    const float weight = run->optical_depths[i] / (run->scales[i] * run->scales[i]);
    most += run->optical_depths[i] * exp2f(-near * near);
    lost += weight * exp2f(-wide * wide / widening);
    all += weight;
  }
  return (loss){most, lost / all};
}

/* Distance from its middle over which a run is heard: the smallest that keeps the bounds of fum_cutoff_sigmas. A single
 * run, however dense, may be missed only where it weighs less than the error divided among a few such runs. In smoke of
 * many runs a share is lost everywhere, and tau exp(-tau) is at most 1 / e. At `most`, each particle keeps them by
 * itself. */
static float hearing_of(const fum_run *run, const float *offsets, float error, float most) {
  const float runs = 4.0F;
  float low = 0.0F, high = most;
  for (int step = 0; step < 7; step++) {
    const float middle = 0.5F * (low + high);
    const loss lost = loss_at(run, offsets, middle);
    const bool is_heard = !(lost.most * runs <= error && lost.share <= 2.0F * error);
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

static const float SCALE_SIGMAS = 0.84932180F; /* sqrt(log2(e) / 2) */

static void fill_run(const fum_medium *medium, const uint32_t *particles, uint32_t count, fum_vec3 middle,
                     fum_run *run) {
  const fum_octree *octree = fum_medium_casters(medium);
  for (uint32_t i = 0; i < FUM_RUN_SIZE; i++) {
    const uint32_t p = particles[i < count ? i : 0];
    run->x[i] = octree->x[p] - middle.x;
    run->y[i] = octree->y[p] - middle.y;
    run->z[i] = octree->z[p] - middle.z;
    run->scales[i] = SCALE_SIGMAS * octree->inverse_sigmas[p] / medium->sigma_scale;
    run->optical_depths[i] = i < count ? octree->optical_depths[p] * medium->depth_scale : 0.0F;
  }
}

/* What may be lost, and how many sigmas clear of an end particles must be. */
typedef struct limits {
  float error, clear_sigmas;
} limits;

/* Finds the sphere around a run; returns the reach of its particles. */
static float bound_run(const limits *l, const fum_run *run, fum_vec3 middle, int64_t number, fum_spheres *spheres) {
  float offsets[FUM_RUN_SIZE], optical_depth = 0.0F, widest = 0.0F, hearing = 0.0F, clear = 0.0F;
  for (int i = 0; i < FUM_RUN_SIZE; i++)
    optical_depth += run->optical_depths[i];
  const float cutoff = optical_depth > 0.0F ? fum_cutoff_sigmas(optical_depth, l->error) : 0.0F;
  for (int i = 0; i < FUM_RUN_SIZE; i++) {
    const float sigma = SCALE_SIGMAS / run->scales[i];
    offsets[i] = fum_length((fum_vec3){run->x[i], run->y[i], run->z[i]});
    hearing = fmaxf(hearing, offsets[i] + cutoff * sigma);
    clear = fmaxf(clear, offsets[i] + l->clear_sigmas * sigma);
    widest = fmaxf(widest, sigma);
  }
  spheres->x[number] = middle.x;
  spheres->y[number] = middle.y;
  spheres->z[number] = middle.z;
  spheres->hearing[number] = 1.00001F * hearing_of(run, offsets, l->error, hearing);
  spheres->clear[number] = clear;
  return cutoff * widest;
}

/* Lays out the runs of a node; returns the reach of its particles. */
static float lay_node(const limits *l, const fum_octree_node *node, int64_t first, uint32_t *particles,
                      fum_medium *medium) {
  float reach = 0.0F;
  for (uint32_t p = 0; p < node->count; p++)
    particles[p] = node->begin + p;
  fum_neighbours_sort(fum_medium_casters(medium), FUM_RUN_SIZE, node->count, particles);
  for (uint32_t begin = 0; begin < node->count; begin += FUM_RUN_SIZE) {
    const int64_t number = first + begin / FUM_RUN_SIZE;
    const uint32_t count = node->count - begin < FUM_RUN_SIZE ? node->count - begin : FUM_RUN_SIZE;
    const fum_vec3 middle = middle_of(fum_medium_casters(medium), particles + begin, count);
    fill_run(medium, particles + begin, count, middle, &medium->runs[number]);
    reach = fmaxf(reach, bound_run(l, &medium->runs[number], middle, number, &medium->spheres));
  }
  return reach;
}

static int32_t lay_runs(fum_context *context, float error, const uint8_t *is_cut, uint32_t *order, fum_medium *medium) {
  const fum_octree *octree = fum_medium_casters(medium);
  const limits l = {error, clear_of(error)};
#pragma omp parallel for num_threads(fum_thread_count(context)) schedule(dynamic, 1024)
  for (int64_t i = 0; i < octree->node_count; i++) {
    const fum_octree_node *node = &octree->nodes[i];
    if (fum_progress_in_loop(context, i, 1 << 10) || !is_cut[i]) continue;
    medium->reaches[i] = lay_node(&l, node, medium->first_runs[i], order + node->begin, medium);
  }
  fum_reach_raise(octree, medium->reaches);
  return fum_is_cancelled(context) ? FUM_ERROR_CANCELLED : FUM_OK;
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

/* Mean over the smoke of the extinction around a particle times its sigma, taken as even in each leaf. */
static void weigh(fum_medium *medium) {
  const fum_octree *octree = fum_medium_casters(medium);
  const double scale = (double)medium->sigma_scale, per_mass = (double)medium->depth_scale * scale * scale;
  double mass = 0.0, weighed = 0.0;
  for (int64_t i = 0; i < octree->node_count; i++) {
    const fum_octree_node *leaf = &octree->nodes[i];
    const double own = octree->sums[i].mass * per_mass, sigma = octree->sums[i].sigma * scale / leaf->count;
    double volume = 1.0;
    if (leaf->children != 0) continue;
    /* A single Gaussian fills sqrt(2 pi) sigma along each axis at its peak extinction. */
    for (int axis = 0; axis < 3; axis++)
      volume *= (double)leaf->upper[axis] - (double)leaf->lower[axis] + FUM_SQRT_2PI * sigma;
    mass += own;
    weighed += own * 2.0 * FUM_PI * own / volume * sigma;
  }
  medium->mass = mass;
  medium->thickness = mass > 0.0 ? weighed / mass : 0.0;
}

int32_t fum_medium_begin(fum_context *context, float transmittance_error, fum_medium *medium) {
  const fum_merge_options merging = {medium->sigma_scale, medium->depth_scale, 0.5F * transmittance_error};
  medium->error = transmittance_error;
  const int32_t status = fum_octree_merge(context, medium->octree, &merging, &medium->merged);
  if (status == FUM_OK) weigh(medium);
  return status;
}

static void free_runs(fum_context *context, fum_medium *medium) {
  fum_free(context, &medium->runs);
  fum_free(context, &medium->spheres.x);
  fum_free(context, &medium->spheres.y);
  fum_free(context, &medium->spheres.z);
  fum_free(context, &medium->spheres.hearing);
  fum_free(context, &medium->spheres.clear);
  fum_free(context, &medium->first_runs);
  fum_free(context, &medium->reaches);
}

int32_t fum_medium_lay_runs(fum_context *context, fum_medium *medium) {
  const char *what = "runs of particles";
  const fum_octree *casters = fum_medium_casters(medium);
  const int64_t node_count = casters->node_count;
  uint8_t *is_cut = NULL, *is_below = NULL;
  uint32_t *order = NULL;
  if (medium->runs != NULL) return FUM_OK;
  int32_t status = fum_alloc(context, node_count, sizeof *is_cut, what, &is_cut);
  if (status == FUM_OK) status = fum_alloc(context, node_count, sizeof *is_below, what, &is_below);
  if (status == FUM_OK) status = fum_alloc(context, casters->count, sizeof *order, what, &order);
  if (status == FUM_OK) status = fum_alloc(context, node_count, sizeof *medium->first_runs, what, &medium->first_runs);
  if (status == FUM_OK) status = fum_alloc(context, node_count, sizeof *medium->reaches, what, &medium->reaches);
  if (status != FUM_OK) goto done;
  const int64_t count = number_runs(casters, is_cut, is_below, medium->first_runs);
  status = allocate_runs(context, count, medium);
  if (status == FUM_OK) status = lay_runs(context, medium->error, is_cut, order, medium);
done:
  if (status != FUM_OK) free_runs(context, medium);
  fum_free(context, &order);
  fum_free(context, &is_below);
  fum_free(context, &is_cut);
  return status;
}

int32_t fum_medium_bunch(fum_context *context, float side, fum_medium *medium) {
  const fum_bunch_options options = {.sigma_scale = medium->sigma_scale, .side = side, .most_left = 0.5F};
  if (medium->bunch_side == side) return FUM_OK;
  fum_medium_forget_bunches(context, medium);
  medium->bunch_side = side;
  return fum_octree_bunch(context, fum_medium_casters(medium), &options, &medium->bunched);
}

void fum_medium_forget_bunches(fum_context *context, fum_medium *medium) {
  fum_octree_destroy(context, medium->bunched);
  medium->bunched = NULL;
  medium->bunch_side = 0.0F;
}

void fum_medium_end(fum_context *context, fum_medium *medium) {
  fum_medium_forget_bunches(context, medium);
  fum_octree_destroy(context, medium->merged);
  medium->merged = NULL;
  free_runs(context, medium);
}
