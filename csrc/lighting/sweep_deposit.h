/* SPDX-License-Identifier: GPL-3.0-or-later */
/* Casters added to the grid of a patch of the sweep; a part of sweep_loop.h. */

/* The normal distribution function within 3e-5 up to 3.4, beyond FUM_SWEEP_SPREAD (least squares, made even). */
static fum_vf normal_share(fum_vf z) {
  const fum_vf squared = z * z;
  fum_vf p = 6.1057255e-8F * squared - 3.2006239e-6F;
  p = p * squared + 7.4185834e-5F;
  p = p * squared - 1.0250507e-3F;
  p = p * squared + 9.6278776e-3F;
  p = p * squared - 6.6156754e-2F;
  p = p * squared + 0.39884803F;
  return 0.5F + z * p;
}

/* Share of a caster in front of each open face, as a line. */
static void find_line(const patch *p, const footprint *f, float line[FACES]) {
  for (int32_t k = 0; k < FACES; k += FUM_LANES) {
    const fum_vf lane = fum_vf_load(NUMBERS + k), turned = lane - (float)(p->open & (FACES - 1));
    const fum_vf face =
        (float)p->open + turned + fum_vf_select(turned < 0.0F, fum_vf_set((float)FACES), fum_vf_set(0.0F));
    const fum_vf z = (face - f->range) * f->inverse_sigma;
    const fum_vf begun = fum_vf_select(face > (float)f->first, normal_share(z), fum_vf_set(0.0F));
    fum_vf_store(line + k, fum_vf_select(face > (float)f->last, fum_vf_set(1.0F), begun));
  }
}

/* Cells around a caster: a box. */
typedef struct box {
  int32_t x, y, columns, rows; /* from the first cell on */
  int32_t width;               /* 8, 16 or 32, so that rows fill vectors */
} box;

/* False where nothing of the caster is in the patch. */
static bool find_box(const patch *p, const footprint *f, box *out) {
  const int32_t x1 = at_most(f->column + f->reach, p->columns - 1), y1 = at_most(f->row + f->reach, p->rows - 1);
  out->x = at_least(f->column - f->reach, 0);
  out->y = at_least(f->row - f->reach, 0);
  const int32_t columns = x1 - out->x + 1, rows = y1 - out->y + 1;
  if (columns <= 0 || rows <= 0) return false;
  out->columns = columns;
  out->width = columns <= 8 ? 8 : columns <= 16 ? 16 : MOST_COLUMNS;
  out->rows = rows < MOST_COLUMNS ? rows : MOST_COLUMNS;
  return true;
}

/* What a caster adds to cells and faces. */
typedef struct deposit {
  box box;
  float cells[MOST_COLUMNS * MOST_COLUMNS + FUM_LANES]; /* rows one after the other; 0 beyond its reach */
  float line[FACES];
  bool is_empty;
} deposit;

/* Columns and rows of a vector's entries in a box 8 wide, whose rows fill it. */
static const float PAIR_COLUMNS[16] = {0, 1, 2, 3, 4, 5, 6, 7, 0, 1, 2, 3, 4, 5, 6, 7},
                   PAIR_ROWS[16] = {0, 0, 0, 0, 0, 0, 0, 0, 1, 1, 1, 1, 1, 1, 1, 1};

/* What a Gaussian falls to where it ends; behind the box none is as large as that. */
static fum_vf find_edge(const patch *p, const footprint *f, const box *b, fum_vf columns) {
  return fum_vf_select(columns < (float)b->columns, fum_vf_set(f->optical_depth * p->job->edge), fum_vf_set(NAN));
}

/* The plane is flat: that a caster's ray leans on it bends its outline by so little (in tangents) that it doesn't show.
 */
static const float FLAT = 0.01F;

/* Optical depths of a caster at the cells of a box, rows one after the other, where its exponent is of second degree:
 * from one row to the next the Gaussian grows by a factor, which falls off by one that is the same everywhere. */
static void find_flat_cells(const patch *p, const footprint *f, const box *b, float *cells) {
  const int32_t width = b->width, at_once = FUM_LANES > width ? FUM_LANES / width : 1;
  const float across = f->across, up = f->up, both = f->both, step = (float)at_once;
  const fum_vf fall = fum_vf_exp2(fum_vf_set(2.0F * step * step * up));
  const fum_vf y = (at_once > 1 ? fum_vf_load(PAIR_ROWS) : fum_vf_set(0.0F)) + ((float)b->y - f->row);
  for (int32_t column = 0; column < width; column += FUM_LANES) {
    const fum_vf columns = fum_vf_load((at_once > 1 ? PAIR_COLUMNS : NUMBERS) + column);
    const fum_vf x = columns + ((float)b->x - f->column), edge = find_edge(p, f, b, columns);
    fum_vf gauss = f->optical_depth * fum_vf_exp2(across * x * x + both * x * y + up * y * y);
    fum_vf growth = fum_vf_exp2(step * (both * x + up * (2.0F * y + step)));
    for (int32_t row = 0; row < b->rows; row += at_once) {
      fum_vf_store(cells + row * width + column, fum_vf_select(gauss >= edge, gauss, fum_vf_set(0.0F)));
      gauss *= growth;
      growth *= fall;
    }
  }
}

/* Tangent of the angle between a caster's ray and the patch's axis, along columns (0) or rows (1). */
static float find_tangent(const patch *p, const footprint *f, int axis) {
  return p->lower[axis] + (axis == 0 ? f->column : f->row) * p->job->level->cell;
}

/* The same of a light that isn't parallel, whatever the exponent: |centre x ray|^2 over |ray|^2, the quotient by its
 * series. */
static void find_cells(const patch *p, const footprint *f, const box *b, float *cells) {
  const float cell = p->job->level->cell, *columns = b->width == 8 ? PAIR_COLUMNS : NUMBERS;
  const float u = find_tangent(p, f, 0), v = find_tangent(p, f, 1), squared_cosine = 1.0F / (1.0F + u * u + v * v);
  const fum_vf rows = b->width == 8 ? fum_vf_load(PAIR_ROWS) : fum_vf_set(0.0F);
  for (int32_t k = 0; k < b->rows * b->width; k += FUM_LANES) {
    const fum_vf x = fum_vf_load(columns + k % b->width) + ((float)b->x - f->column);
    const fum_vf y = rows + ((float)(b->y + k / b->width) - f->row);
    const fum_vf grown = (2.0F * (u * x + v * y) + cell * (x * x + y * y)) * (cell * squared_cosine);
    const fum_vf flat = f->across * x * x + f->both * x * y + f->up * y * y;
    const fum_vf gauss = f->optical_depth * fum_vf_exp2(flat * (1.0F - grown * (1.0F - grown * (1.0F - grown))));
    const fum_vf edge = find_edge(p, f, b, fum_vf_load(columns + k % b->width));
    fum_vf_store(cells + k, fum_vf_select(gauss >= edge, gauss, fum_vf_set(0.0F)));
  }
}

static void find_deposit(const patch *p, const footprint *f, deposit *d) {
  const float reach = f->reach * p->job->level->cell;
  const float lean = fabsf(find_tangent(p, f, 0)) + fabsf(find_tangent(p, f, 1)) + reach;
  d->is_empty = !find_box(p, f, &d->box);
  if (d->is_empty) return;
  find_line(p, f, d->line);
  (p->job->view->is_parallel || lean * reach < FLAT ? find_flat_cells : find_cells)(p, f, &d->box, d->cells);
}

/* Cells in a row that are added to together: which of them are within reach isn't asked, as that can't be foretold. */
enum { AT_ONCE = 4 };

static bool is_touched(const float *cells) {
  uint64_t pairs[2];
  memcpy(pairs, cells, sizeof pairs);
  return (pairs[0] | pairs[1]) != 0;
}

static void widen(const box *b, area *a) {
  a->left = b->x < a->left ? b->x : a->left;
  a->top = b->y < a->top ? b->y : a->top;
  a->right = b->x + b->columns > a->right ? b->x + b->columns : a->right;
  a->bottom = b->y + b->rows > a->bottom ? b->y + b->rows : a->bottom;
}

static void add_deposit(patch *p, const deposit *d) {
  const box *b = &d->box;
  fum_vf shares[FACES / FUM_LANES];
  if (d->is_empty) return;
  widen(b, &p->shaded);
  for (int32_t k = 0; k < FACES / FUM_LANES; k++)
    shares[k] = fum_vf_load(d->line + k * FUM_LANES);
  for (int32_t y = 0; y < b->rows; y++) {
    float *at = p->lines + ((int64_t)(b->y + y) * p->columns + b->x) * FACES;
    const float *row = d->cells + y * b->width;
    for (int32_t x = 0; x < b->width; x += AT_ONCE) {
      if (!is_touched(row + x)) continue;
      for (int32_t i = x; i < x + AT_ONCE; i++) {
        for (int32_t k = 0; k < FACES / FUM_LANES; k++)
          fum_vf_store(at + i * FACES + k * FUM_LANES,
                       fum_vf_load(at + i * FACES + k * FUM_LANES) + row[i] * shares[k]);
      }
    }
  }
}

/* Adds casters `from` to `to` of the order. While one is added the next is found: neither waits for the other. */
static void add_casters(patch *p, const footprint *footprints, const uint32_t *order, uint32_t from, uint32_t to) {
  deposit deposits[2];
  for (uint32_t k = from; k < to; k++) {
    __builtin_prefetch(&footprints[order[k + AHEAD]]);
    find_deposit(p, &footprints[order[k]], &deposits[k % 2]);
    if (k > from) add_deposit(p, &deposits[(k - 1) % 2]);
  }
  if (to > from) add_deposit(p, &deposits[(to - 1) % 2]);
}
