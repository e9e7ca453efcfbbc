/* SPDX-License-Identifier: GPL-3.0-or-later */
/* The loops of cells.h, to be compiled once for each instruction set: cells_*.c define FUM_LANES and
 * FUM_CELL_LOOPS_NAME. */
#include "base/simd.h"
#include "octree/cells.h"

/* Lanes of `count`, which may be more than there are. */
static int32_t lanes_of(int64_t count) {
  return count < FUM_LANES ? (int32_t)count : FUM_LANES;
}

static void find_taken(const uint16_t *of_cells, uint32_t count, uint8_t taken[FUM_ALL_CELLS]) {
  memset(taken, 0, FUM_ALL_CELLS);
  for (uint32_t i = 0; i < count; i++)
    taken[of_cells[i]] = 1;
}

/* Cells along an axis; behind a leaf's last particle there may be others anywhere. */
static fum_vi find_along(const float *places, float lower, float cells_per_metre, int32_t cells) {
  const fum_vi at = __builtin_convertvector((fum_vf_load(places) - lower) * cells_per_metre, fum_vi);
  const fum_vi is_before = at < cells;
  return (at & is_before & (at > 0)) | ((cells - 1) & ~is_before);
}

static uint32_t find(const fum_octree *octree, const fum_octree_node *leaf, const fum_cells *c, uint16_t *out_cells) {
  typedef uint16_t narrow __attribute__((vector_size(2 * FUM_LANES)));
  uint8_t taken[FUM_ALL_CELLS];
  uint32_t count = 0;
  for (uint32_t i = 0; i < leaf->count; i += FUM_LANES) {
    const uint32_t at = leaf->begin + i;
    const fum_vi x = find_along(octree->x + at, c->lower[0], c->cells_per_metre[0], c->cells[0]),
                 y = find_along(octree->y + at, c->lower[1], c->cells_per_metre[1], c->cells[1]),
                 z = find_along(octree->z + at, c->lower[2], c->cells_per_metre[2], c->cells[2]);
    const narrow cells = __builtin_convertvector((z * c->cells[1] + y) * c->cells[0] + x, narrow);
    memcpy(out_cells + i, &cells, (size_t)lanes_of(leaf->count - i) * sizeof *out_cells);
  }
  find_taken(out_cells, leaf->count, taken);
  for (int32_t k = 0; k < c->cell_count; k++)
    count += taken[k];
  return count;
}

/* Sums over the particles of a cell of their masses, optical depth times sigma^2, times x, y and z times (x, y, z, 1),
 * a row each; and in the last row times (sigma^2, y, z, 1). */
enum { ROWS = 4, SUMS = 4 * ROWS };

/* Where particles are, and what they weigh. */
typedef struct parts {
  fum_quad places[FUM_LANES], weights[FUM_LANES]; /* (x, y, z, 1); mass times that */
  float variances[FUM_LANES];
} parts;

static void find_parts(const fum_octree *octree, const fum_cells *c, int64_t first, parts *out) {
  const fum_vf sigma = c->sigma_scale * c->per_metre / fum_vf_load(octree->inverse_sigmas + first);
  const fum_vf variance = sigma * sigma, mass = fum_vf_load(octree->optical_depths + first) * variance;
  const fum_vf x = (fum_vf_load(octree->x + first) - c->lower[0]) * c->per_metre,
               y = (fum_vf_load(octree->y + first) - c->lower[1]) * c->per_metre,
               z = (fum_vf_load(octree->z + first) - c->lower[2]) * c->per_metre;
  fum_quads_from((fum_vf[4]){x, y, z, fum_vf_set(1.0F)}, out->places);
  fum_quads_from((fum_vf[4]){mass * x, mass * y, mass * z, mass}, out->weights);
  fum_vf_store(out->variances, variance);
}

/* Row `row` of the sums of as many cells as there are lanes, a vector for each of its entries. */
static void load_row(const float (*sums)[SUMS], const uint16_t *cells, int32_t count, int row, fum_vf out[4]) {
  float values[4][FUM_LANES];
  for (int32_t k = 0; k < FUM_LANES; k += 4) {
    fum_quad quads[4];
    for (int32_t n = 0; n < 4; n++)
      memcpy(&quads[n], sums[cells[k + n < count ? k + n : 0]] + 4 * row, sizeof *quads);
    fum_quad_transpose(quads);
    for (int32_t n = 0; n < 4; n++)
      memcpy(values[n] + k, &quads[n], sizeof *quads);
  }
  for (int n = 0; n < 4; n++)
    out[n] = fum_vf_load(values[n]);
}

static inline void put(fum_vf values, int32_t count, float *out) {
  if (count == FUM_LANES) {
    fum_vf_store(out, values);
  } else {
    memcpy(out, &values, (size_t)count * sizeof *out);
  }
}

/* The Gaussians with the masses, centroids and second moments of cells, FUM_LANES at most. */
static void emit(const fum_cells *c, const float (*sums)[SUMS], const uint16_t *cells, int32_t count, uint32_t at,
                 fum_octree *out) {
  const float least = 0.25F; /* the narrowest have more: for cells without any mass */
  const float unit = 1.0F / c->per_metre, square = unit * unit;
  const int64_t step = out->count + FUM_OCTREE_PAD;
  fum_vf rows[ROWS][4];
  for (int r = 0; r < ROWS; r++)
    load_row(sums, cells, count, r, rows[r]);
  const fum_vf mass = rows[3][3], per_mass = fum_vf_select(mass > 0.0F, 1.0F / mass, fum_vf_set(0.0F));
  const fum_vf x = rows[0][3] * per_mass, y = rows[1][3] * per_mass, z = rows[2][3] * per_mass;
  const fum_vf xx = rows[0][0] * per_mass - x * x, yy = rows[1][1] * per_mass - y * y,
               zz = rows[2][2] * per_mass - z * z;
  const fum_vf spread = (xx + yy + zz) * 0.33333333F;
  const fum_vf variance = fum_vf_at_least(rows[3][0] * per_mass + spread, least);
  put(c->lower[0] + x * unit, count, out->x + at);
  put(c->lower[1] + y * unit, count, out->y + at);
  put(c->lower[2] + z * unit, count, out->z + at);
  put(c->sigma_scale * c->per_metre / fum_vf_sqrt(variance), count, out->inverse_sigmas + at);
  put(mass / variance, count, out->optical_depths + at);
  put((xx - spread) * square, count, out->stretches + at);
  put((yy - spread) * square, count, out->stretches + step + at);
  put((rows[0][1] * per_mass - x * y) * square, count, out->stretches + 2 * step + at);
  put((rows[0][2] * per_mass - x * z) * square, count, out->stretches + 3 * step + at);
  put((rows[1][2] * per_mass - y * z) * square, count, out->stretches + 4 * step + at);
}

/* Backwards: the first one is the last that is written down. */
static void count_members(const fum_octree *octree, const fum_octree_node *leaf, const uint16_t *of_cells,
                          const uint16_t *cells, int32_t count, uint32_t at, fum_octree *out) {
  uint32_t members[FUM_ALL_CELLS], firsts[FUM_ALL_CELLS];
  for (int32_t k = 0; k < count; k++)
    members[cells[k]] = 0;
  for (uint32_t i = leaf->count; i-- > 0;) {
    members[of_cells[i]]++;
    firsts[of_cells[i]] = octree->indices[leaf->begin + i];
  }
  for (int32_t k = 0; k < count; k++) {
    out->members[at + (uint32_t)k] = members[cells[k]];
    out->indices[at + (uint32_t)k] = firsts[cells[k]];
  }
}

static void add_leaf(const fum_octree *octree, const fum_octree_node *leaf, const fum_cells *c,
                     const uint16_t *of_cells, float (*sums)[SUMS]) {
  for (uint32_t i = 0; i < leaf->count; i += FUM_LANES) {
    const int32_t lanes = lanes_of(leaf->count - i);
    parts p;
    find_parts(octree, c, leaf->begin + i, &p);
    for (int32_t k = 0; k < lanes; k++) {
      fum_quad last = p.places[k];
      last[0] = p.variances[k];
      fum_quad_add_outer(p.places[k], last, p.weights[k], sums[of_cells[i + (uint32_t)k]]);
    }
  }
}

static void fill(const fum_octree *octree, const fum_octree_node *leaf, const fum_cells *c, const uint16_t *of_cells,
                 uint32_t at, fum_octree *out) {
  _Alignas(64) float sums[FUM_ALL_CELLS][SUMS];
  uint16_t cells[FUM_ALL_CELLS];
  uint8_t taken[FUM_ALL_CELLS];
  int32_t count = 0;
  find_taken(of_cells, leaf->count, taken);
  for (int32_t k = 0; k < c->cell_count; k++) {
    cells[count] = (uint16_t)k;
    count += taken[k];
  }
  memset(sums, 0, (size_t)c->cell_count * sizeof *sums);
  add_leaf(octree, leaf, c, of_cells, sums);
  for (int32_t k = 0; k < count; k += FUM_LANES)
    emit(c, (const float(*)[SUMS])sums, cells + k, lanes_of(count - k), at + (uint32_t)k, out);
  if (out->members != NULL) count_members(octree, leaf, of_cells, cells, count, at, out);
}

const fum_cell_loops FUM_CELL_LOOPS_NAME = {find, fill};
