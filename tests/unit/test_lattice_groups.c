/* SPDX-License-Identifier: GPL-3.0-or-later */
#include "support.h"

#include "lighting/lattice_groups.h"
#include "lighting/receivers.h"

enum { FACES = 11 };

/* Faces over about the same window with samples ever farther apart; one has none, one is small. */
static fum_lattice lay_lattice(fum_lattice_face faces[FACES]) {
  fum_lattice lattice = {.face_count = FACES, .faces = faces};
  for (int32_t f = 0; f < FACES; f++) {
    const float spacing = 0.01F + 0.0003F * (float)f, begin = f == 6 ? 0.2F : -0.5F;
    faces[f] = (fum_lattice_face){.first = lattice.sample_count,
                                  .origin = {floorf(begin / spacing) * spacing, floorf(begin / spacing) * spacing},
                                  .spacing = {spacing, spacing}};
    if (f == 3) continue;
    faces[f].columns = (int32_t)ceilf((0.5F - faces[f].origin[0]) / spacing) + 1;
    faces[f].rows = (int32_t)ceilf((0.3F - faces[f].origin[1]) / spacing) + 1;
    lattice.sample_count += (int64_t)faces[f].columns * faces[f].rows;
  }
  return lattice;
}

/* Marks samples; returns how many. */
static int64_t mark(const fum_lattice *lattice, uint32_t one_in, fum_marks *marks, uint8_t *is_marked) {
  int64_t count = 0;
  for (int32_t f = 0; f < lattice->face_count; f++) {
    const fum_lattice_face *grid = &lattice->faces[f];
    for (int64_t i = 0; i < (int64_t)grid->columns * grid->rows; i++) {
      const int64_t column = i % grid->columns, row = i / grid->columns;
      if (fum_hash64((uint64_t)(grid->first + i)) % one_in != 0) continue;
      marks->words[marks->firsts[f] + row / 8 * fum_blocks_across(grid) + column / 8] |= UINT64_C(1)
                                                                                         << (row % 8 * 8 + column % 8);
      is_marked[grid->first + i] = 1;
      count++;
    }
  }
  return count;
}

/* Where a sample is in the window; its face. */
static int32_t find_place(const fum_lattice *lattice, uint32_t sample, float out[2]) {
  int32_t f = FACES - 1;
  while (lattice->faces[f].first > sample || lattice->faces[f].columns == 0)
    f--;
  const fum_lattice_face *grid = &lattice->faces[f];
  out[0] = grid->origin[0] + grid->spacing[0] * (float)((sample - grid->first) % grid->columns);
  out[1] = grid->origin[1] + grid->spacing[1] * (float)((sample - grid->first) / grid->columns);
  return f;
}

static void check_group(const fum_lattice *lattice, int64_t group) {
  const uint32_t begin = lattice->group_begins[group], end = lattice->group_begins[group + 1];
  float lower[2] = {INFINITY, INFINITY}, upper[2] = {-INFINITY, -INFINITY};
  int32_t faces[2] = {FACES, -1};
  assert_true(begin < end && end - begin <= FUM_GROUP_SIZE);
  for (uint32_t n = begin; n < end; n++) {
    float place[2];
    const int32_t f = find_place(lattice, lattice->samples[n], place);
    faces[0] = f < faces[0] ? f : faces[0];
    faces[1] = f > faces[1] ? f : faces[1];
    for (int axis = 0; axis < 2; axis++) {
      lower[axis] = fminf(lower[axis], place[axis]);
      upper[axis] = fmaxf(upper[axis], place[axis]);
    }
  }
  assert_int_equal(faces[0] / 4, faces[1] / 4);
  /* Blocks of other faces stand up to half a block off, at the ends of faces that aren't as wide up to another. */
  for (int axis = 0; axis < 2; axis++)
    assert_true(upper[axis] - lower[axis] < 2.5F * 8.0F * lattice->faces[faces[1]].spacing[axis]);
}

/* Every sample that is marked is in one group; groups are small, compact and, where all are marked, nearly full. The
 * number of threads changes nothing. */
static void test_groups_hold_what_is_marked(void **state) {
  (void)state;
  fum_context *context = NULL;
  assert_int_equal(fum_context_create(&context), FUM_OK);
  for (uint32_t one_in = 1; one_in <= 16; one_in *= 4) {
    uint32_t *first = NULL;
    for (int32_t threads = 1; threads <= 3; threads++) {
      fum_lattice_face faces[FACES];
      fum_lattice lattice = lay_lattice(faces);
      fum_marks marks = {0};
      uint8_t *is_marked = calloc((size_t)lattice.sample_count, 1);
      assert_non_null(is_marked);
      assert_int_equal(fum_context_set_threads(context, threads), FUM_OK);
      assert_int_equal(fum_marks_begin(context, &lattice, &marks), FUM_OK);
      const int64_t count = mark(&lattice, one_in, &marks, is_marked);
      assert_int_equal(fum_lattice_group(context, &marks, &lattice), FUM_OK);
      assert_int_equal(lattice.lit_count, count);
      for (int64_t n = 0; n < count; n++)
        assert_int_equal(is_marked[lattice.samples[n]]--, 1);
      assert_int_equal(lattice.group_begins[0], 0);
      assert_int_equal(lattice.group_begins[lattice.group_count], count);
      for (int64_t group = 0; group < lattice.group_count; group++)
        check_group(&lattice, group);
      if (one_in == 1) assert_true(count > 40 * lattice.group_count);
      if (first == NULL) {
        first = lattice.samples;
        lattice.samples = NULL;
      } else {
        assert_memory_equal(lattice.samples, first, (size_t)count * sizeof *first);
      }
      lattice.faces = NULL; /* not of the heap */
      fum_lattice_free(context, &lattice);
      fum_marks_end(context, &marks);
      free(is_marked);
    }
    fum_free(context, &first);
  }
  fum_context_destroy(context);
}

int main(void) {
  const struct CMUnitTest tests[] = {cmocka_unit_test(test_groups_hold_what_is_marked)};
  return cmocka_run_group_tests(tests, NULL, NULL);
}
