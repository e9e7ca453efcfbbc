/* SPDX-License-Identifier: GPL-3.0-or-later */
#include "lighting/lattice_spline.h"

#include "base/simd.h"

#include <omp.h>

/* Rows or columns of a face side by side, as many as there are lanes; places beyond them and beyond the ends of the
 * lines hold NaN, as samples do that aren't lit. */
enum { LANES = 16, VECTORS = LANES / FUM_LANES, MARGIN = 2 };

typedef struct lines {
  int32_t count;  /* places along them */
  float *values;  /* [MARGIN + count + MARGIN][LANES] at the samples, from place -MARGIN on */
  float *factors; /* [count][LANES] how much of the next coefficient is in one */
  float *found;   /* [count][LANES] coefficients */
} lines;

static int64_t floats_of_lines(int32_t count) {
  return (int64_t)LANES * (2 * MARGIN + 3 * (int64_t)count);
}

static lines take_lines(float *memory, int32_t count) {
  lines l = {.count = count, .values = memory};
  l.factors = memory + (int64_t)LANES * (2 * MARGIN + count);
  l.found = l.factors + (int64_t)LANES * count;
  for (int32_t i = 0; i < MARGIN * LANES; i++)
    l.values[i] = l.values[(MARGIN + count) * LANES + i] = NAN;
  return l;
}

/* Coefficients c of neighbours f in each line: c[k - 1] + 4 c[k] + c[k + 1] = 6 f[k] (Unser, Aldroubi and Eden 1991),
 * for every run of lit samples by itself. At its ends the spline bends as the three samples there do. First all is
 * expressed by the next coefficient, then they are found from the last one on. */
static void fit_lines(lines *l) {
  const float sixth = 0.16666667F;
  fum_vf factors[VECTORS] = {{0}}, known[VECTORS] = {{0}};
  for (int32_t k = 0; k < l->count; k++) {
    for (int32_t v = 0; v < VECTORS; v++) {
      const float *f = l->values + (MARGIN + k) * LANES + v * FUM_LANES;
      const fum_vf here = fum_vf_load(f), before = fum_vf_load(f - LANES), behind = fum_vf_load(f + LANES);
      const fum_vi begins = before != before, is_end = begins | (behind != behind); /* NaN */
      const fum_vf bend = here + fum_vf_select(begins, fum_vf_load(f + 2 * LANES) - 2.0F * behind,
                                               fum_vf_load(f - 2 * LANES) - 2.0F * before);
      const fum_vf end = here - fum_vf_select(bend == bend, sixth * bend, (fum_vf){0});
      const fum_vf inner = 1.0F / (4.0F - factors[v]);
      factors[v] = fum_vf_select(is_end, (fum_vf){0}, inner);
      known[v] = fum_vf_select(is_end, end, (6.0F * here - known[v]) * inner);
      fum_vf_store(l->factors + k * LANES + v * FUM_LANES, factors[v]);
      fum_vf_store(l->found + k * LANES + v * FUM_LANES, known[v]);
    }
  }
  for (int32_t k = l->count - 1; k >= 0; k--) {
    for (int32_t v = 0; v < VECTORS; v++) {
      const fum_vf share = fum_vf_load(l->factors + k * LANES + v * FUM_LANES);
      const fum_vf own = fum_vf_load(l->found + k * LANES + v * FUM_LANES);
      known[v] = fum_vf_select(share > 0.0F, own - share * known[v], own);
      fum_vf_store(l->found + k * LANES + v * FUM_LANES, known[v]);
    }
  }
}

/* Fits the lines from `first` on, of `line_count`, whose samples are `step` apart and which are `stride` apart. */
static void fit_some(float *depths, int32_t first, int32_t line_count, int64_t stride, int64_t step, lines *l) {
  const int32_t used = line_count - first < LANES ? line_count - first : LANES;
  float *begin = depths + first * stride;
  for (int32_t k = 0; k < l->count; k++) {
    float *values = l->values + (MARGIN + k) * LANES;
    for (int32_t i = 0; i < LANES; i++)
      values[i] = i < used ? begin[i * stride + k * step] : NAN;
  }
  fit_lines(l);
  for (int32_t k = 0; k < l->count; k++) {
    for (int32_t i = 0; i < used; i++)
      begin[i * stride + k * step] = l->found[k * LANES + i];
  }
}

static void fit_face(const fum_lattice_face *grid, float *depths, float *memory) {
  lines l = take_lines(memory, grid->columns);
  for (int32_t row = 0; row < grid->rows; row += LANES)
    fit_some(depths, row, grid->rows, grid->columns, 1, &l);
  l = take_lines(memory, grid->rows);
  for (int32_t column = 0; column < grid->columns; column += LANES)
    fit_some(depths, column, grid->columns, 1, grid->columns, &l);
}

int32_t fum_lattice_fit(fum_context *context, fum_lattice *lattice) {
  const int threads = fum_thread_count(context);
  int32_t longest = 0;
  float *memory = NULL;
  for (int32_t f = 0; f < lattice->face_count; f++) {
    const fum_lattice_face *grid = &lattice->faces[f];
    const int32_t longer = grid->columns > grid->rows ? grid->columns : grid->rows;
    longest = longer > longest ? longer : longest;
  }
  const int64_t size = floats_of_lines(longest);
  const int32_t status = fum_alloc(context, threads * size, sizeof *memory, "lattice of light", &memory);
  if (status != FUM_OK) return status;
#pragma omp parallel for num_threads(threads) schedule(dynamic) collapse(2)
  for (int32_t l = 0; l < lattice->lamp_count; l++) {
    for (int32_t f = 0; f < lattice->face_count; f++) {
      const fum_lattice_face *grid = &lattice->faces[f];
      fit_face(grid, lattice->depths + l * lattice->sample_count + grid->first, memory + omp_get_thread_num() * size);
    }
  }
  fum_free(context, &memory);
  return FUM_OK;
}
