/* SPDX-License-Identifier: GPL-3.0-or-later */
#include "billboard/deep.h"
#include "billboard/deep_curve.h"

enum { PARTS = FUM_DEEP_MIXED };

/* What joining pictures needs. */
typedef struct join {
  fum_deep *const *parts;
  int32_t count;
  fum_deep_share shares[PARTS];
  fum_deep_limits limits;
  fum_deep *out;
  int64_t *firsts[PARTS], *out_firsts; /* [height + 1] */
  int64_t most;                        /* points of any pixel's mixture */
  float *memory;                       /* [threads][memory_size] for curves */
  int64_t memory_size;
  fum_deep_sample *samples; /* [threads][most] */
} join;

static int64_t points_of(uint32_t samples) {
  return (int64_t)(1 + FUM_DEEP_STEPS) * samples;
}

static void find_most(join *j) {
  for (int64_t i = 0; i < (int64_t)j->out->width * j->out->height; i++) {
    int64_t points = 0;
    for (int32_t k = 0; k < j->count; k++)
      points += points_of(j->parts[k]->counts[i]);
    j->most = points > j->most ? points : j->most;
  }
}

/* To be freed, whatever this returns. */
static int32_t make_room(join *j) {
  fum_context *context = j->out->context;
  const int64_t rows = (int64_t)j->out->height + 1, threads = fum_thread_count(context);
  int32_t status = fum_alloc(context, rows, sizeof *j->out_firsts, "deep samples", &j->out_firsts);
  for (int32_t k = 0; k < j->count && status == FUM_OK; k++) {
    status = fum_alloc(context, rows, sizeof *j->firsts[k], "deep samples", &j->firsts[k]);
    if (status == FUM_OK) fum_deep_find_rows(j->parts[k], j->firsts[k]);
  }
  j->memory_size = (1 + j->count) * fum_deep_curve_size(j->most);
  if (status == FUM_OK) {
    status = fum_alloc(context, threads, (size_t)j->memory_size * sizeof(float), "deep samples", &j->memory);
  }
  if (status == FUM_OK)
    status = fum_alloc(context, threads, (size_t)(j->most + 1) * sizeof *j->samples, "deep samples", &j->samples);
  return status;
}

static void free_room(join *j) {
  fum_context *context = j->out->context;
  fum_free(context, &j->samples);
  fum_free(context, &j->memory);
  for (int32_t k = 0; k < j->count; k++)
    fum_free(context, &j->firsts[k]);
  fum_free(context, &j->out_firsts);
}

/* Joins a row's pixels. Without room for samples their numbers are found alone. */
static void join_row(const join *j, int32_t y, fum_deep_sample *room) {
  float *memory = j->memory + omp_get_thread_num() * j->memory_size;
  fum_deep_sample *tried = j->samples + omp_get_thread_num() * (j->most + 1);
  const fum_deep_sample *next[PARTS] = {NULL};
  for (int32_t k = 0; k < j->count; k++)
    next[k] = j->parts[k]->samples + j->firsts[k][y];
  for (int32_t x = 0; x < j->out->width; x++) {
    const int64_t pixel = (int64_t)y * j->out->width + x;
    fum_deep_curve curves[PARTS], mixed;
    for (int32_t k = 0; k < j->count; k++) {
      const uint32_t count = j->parts[k]->counts[pixel];
      fum_deep_curve_place(memory + k * fum_deep_curve_size(j->most), j->most, &curves[k]);
      fum_deep_unfold(next[k], (int32_t)count, &curves[k]);
      next[k] += count;
    }
    fum_deep_curve_place(memory + j->count * fum_deep_curve_size(j->most), j->most, &mixed);
    fum_deep_mix(j->count, curves, j->shares, &mixed);
    const int32_t found = fum_deep_divide(&mixed, &j->limits, room != NULL ? room : tried);
    if (room != NULL) room += found;
    j->out->counts[pixel] = (uint32_t)found;
  }
}

int32_t fum_deep_join(fum_deep *const *parts, int32_t count, const int32_t of[3], float tolerance, fum_deep *out) {
  fum_context *context = out->context;
  join j = {.parts = parts, .count = count, .limits = {tolerance, false}, .out = out};
  for (int c = 0; c < 3; c++) {
    j.shares[of[c]].opacity += 1.0F / 3.0F;
    j.shares[of[c]].rgb[c] = 1.0F;
  }
  find_most(&j);
  int32_t status = make_room(&j);
  if (status == FUM_OK) status = fum_progress_report(context, FUM_STAGE_DRAWING, 0.0F, "Joining channels");
  if (status != FUM_OK) goto done;
  const int32_t threads = fum_thread_count(context);
#pragma omp parallel for num_threads(threads) schedule(dynamic)
  for (int32_t y = 0; y < out->height; y++) {
    if (!fum_progress_in_loop(context, y, 4)) join_row(&j, y, NULL);
  }
  status = fum_progress_report(context, FUM_STAGE_DRAWING, 0.5F, "Joining channels");
  if (status != FUM_OK) goto done;
  fum_deep_find_rows(out, j.out_firsts);
  out->sample_count = j.out_firsts[out->height];
  status = fum_alloc(context, out->sample_count, sizeof *out->samples, "deep samples", &out->samples);
  if (status != FUM_OK) goto done;
#pragma omp parallel for num_threads(threads) schedule(dynamic)
  for (int32_t y = 0; y < out->height; y++) {
    if (!fum_progress_in_loop(context, y, 4)) join_row(&j, y, out->samples + j.out_firsts[y]);
  }
  status = fum_progress_report(context, FUM_STAGE_DRAWING, 1.0F, "Joining channels");
done:
  free_room(&j);
  return status;
}
