/* SPDX-License-Identifier: GPL-3.0-or-later */
/* The loops that see splats, of each instruction set, against single ones in double precision. */
#include "support.h"

#include "base/cpu.h"
#include "billboard/splat_sight.h"
#include "octree/bunch.h"

typedef struct smoke {
  stage stage;
  fum_octree *all, *bunched; /* bunched NULL: all are round */
} smoke;

static smoke smoke_open(const puffs *p, float side) {
  smoke s = {.stage = stage_open()};
  const fum_octree_options options = {64, 1.0F, NULL};
  add_puffs(s.stage.scene, p);
  fum_scene_find_origin(s.stage.scene);
  assert_int_equal(fum_octree_build(s.stage.scene, &options, &s.all), FUM_OK);
  if (side > 0.0F) {
    const fum_bunch_options bunches = {.sigma_scale = 1.0F, .side = side, .most_left = 0.5F, .keeps_members = true};
    assert_int_equal(fum_octree_bunch(s.stage.context, s.all, &bunches, &s.bunched), FUM_OK);
    assert_non_null(s.bunched);
  }
  return s;
}

static void smoke_close(smoke *s) {
  fum_octree_destroy(s->stage.context, s->bunched);
  fum_octree_destroy(s->stage.context, s->all);
  stage_close(&s->stage);
}

typedef struct shot {
  int32_t type, width, height;
  double eye[3], half; /* of the window's width */
  double clip_start, clip_end;
} shot;

static fum_view find_view(const smoke *s, const shot *of) {
  /* turned a little about all axes */
  const double turn[9] = {0.9362934,  -0.2750959, 0.2183507, 0.2896295, 0.9564251,
                          -0.0369570, -0.1986693, 0.0978434, 0.9751703};
  fum_camera camera;
  fum_view view;
  fum_camera_init(&camera);
  camera.type = of->type;
  for (int row = 0; row < 3; row++) {
    for (int column = 0; column < 3; column++)
      camera.world_from_camera[4 * row + column] = turn[3 * row + column];
    for (int k = 0; k < 3; k++)
      camera.world_from_camera[4 * row + 3] += turn[3 * row + k] * of->eye[k];
  }
  const double high = of->half * of->height / of->width, window[4] = {-of->half, of->half, -high, high};
  memcpy(camera.window, window, sizeof window);
  camera.width = of->width;
  camera.height = of->height;
  camera.clip_start = of->clip_start;
  camera.clip_end = of->clip_end;
  assert_int_equal(fum_view_init(s->stage.context, &camera, &view), FUM_OK);
  fum_view_place(&view, s->stage.scene->origin);
  return view;
}

/* What two views of a splat may differ by: `relative`, of metres and pure numbers, and in pixels. */
static const double RELATIVE = 1e-5, PIXELS = 1e-3;

static void check_close(const char *what, int64_t i, double found, double expected, double bound) {
  if (found == expected || fabs(found - expected) <= bound) return;
  fail_msg("splat %d: %s is %.9g, not %.9g", (int)i, what, found, expected);
}

/* Slabs are those of the splat's own reach. */
static void check_slabs(const fum_slabs *slabs, int64_t i, const fum_splat *s) {
  const double wide = (double)s->width * (double)s->width, range = (double)s->range;
  const double reach = (double)s->reach + 8.0 * wide / fmax(range, (double)s->width),
               off = 1e-6 * (fabs(range) + reach);
  const int32_t first[2] = {fum_slab_at(slabs, range - reach - off), fum_slab_at(slabs, range - reach + off)};
  const int32_t last[2] = {fum_slab_at(slabs, range + reach - off), fum_slab_at(slabs, range + reach + off)};
  if (s->first_slab < first[0] || s->first_slab > first[1] || s->last_slab < last[0] || s->last_slab > last[1])
    fail_msg("splat %d: slabs %d to %d, not %d to %d", (int)i, s->first_slab, s->last_slab, first[0], last[1]);
}

/* The tiles that are touched are those of the splat's own box, or of one a thousandth of a pixel larger or smaller. */
static void check_touched(const fum_view *view, int64_t i, const fum_splat *s, fum_touched touched) {
  fum_splat larger = *s, smaller = *s;
  for (int axis = 0; axis < 2; axis++) {
    larger.half_px[axis] += (float)PIXELS;
    smaller.half_px[axis] = fmaxf(s->half_px[axis] - (float)PIXELS, 1e-3F);
  }
  if (touched == fum_touched_find(view, s, false)) return;
  if (touched == fum_touched_find(view, &larger, false)) return;
  if (touched == fum_touched_find(view, &smaller, false)) return;
  fail_msg("splat %d touches %x, not %x", (int)i, touched, fum_touched_find(view, s, false));
}

static void check_stretch(int64_t i, const fum_splat *s, const fum_stretch *found, const fum_stretch *expected) {
  /* in the exponent, where the splat ends */
  const double end = (double)s->footprint * (double)s->width, bound = 1e-4 / (end * end);
  check_close("stretch xx", i, (double)found->xx, (double)expected->xx, bound);
  check_close("stretch xy", i, (double)found->xy, (double)expected->xy, bound);
  check_close("stretch yy", i, (double)found->yy, (double)expected->yy, bound);
}

static void check_splat(int64_t i, const fum_splat *found, const fum_splat *expected) {
  const double range = fabs((double)expected->range);
  const struct {
    const char *name;
    float found, expected;
  } fields[] = {{"sigma", found->sigma, expected->sigma},
                {"width", found->width, expected->width},
                {"optical depth", found->optical_depth, expected->optical_depth},
                {"reach", found->reach, expected->reach},
                {"footprint", found->footprint, expected->footprint},
                {"self shade", found->self_shade, expected->self_shade},
                {"rim", found->rim, expected->rim}};
  for (size_t k = 0; k < sizeof fields / sizeof *fields; k++)
    check_close(fields[k].name, i, (double)fields[k].found, (double)fields[k].expected,
                RELATIVE * fabs((double)fields[k].expected));
  for (int axis = 0; axis < 3; axis++)
    check_close("centre", i, (double)found->center[axis], (double)expected->center[axis], 1e-6 * range);
  check_close("range", i, (double)found->range, (double)expected->range, 1e-6 * range);
  for (int axis = 0; axis < 2; axis++) {
    const double middle = (double)expected->middle_px[axis], half = (double)expected->half_px[axis];
    check_close("middle", i, (double)found->middle_px[axis], middle, PIXELS + RELATIVE * fabs(middle));
    check_close("half", i, (double)found->half_px[axis], half, PIXELS + RELATIVE * half);
  }
}

/* One is seen and the other isn't: only where hardly anything is left of it. */
static bool is_at_edge(const fum_view *view, const fum_splat *s) {
  const int32_t sides[2] = {view->width, view->height};
  for (int axis = 0; axis < 2; axis++) {
    const double half = (double)s->half_px[axis] - 2.0 * PIXELS, middle = (double)s->middle_px[axis];
    const double first = middle - half, last = middle + half;
    if (last < 0.0 || first > sides[axis] - 1 || ceil(first) > floor(last)) return true;
  }
  return false;
}

static void see_at_level(const fum_sight *sight, fum_cpu_level level, fum_splat *splats, fum_stretch *stretches,
                         fum_touched *touched) {
  const int32_t parts[3] = {7, 640, INT32_MAX}; /* none of whose ends is a whole vector but by chance */
  const int32_t count = (int32_t)sight->octree->count;
  int32_t begin = 0;
  fum_cpu_limit(level);
  for (int k = 0; k < 3 && begin < count; k++) {
    const int32_t part = parts[k] < count - begin ? parts[k] : count - begin;
    const fum_sight_out out = {splats + begin, sight->octree->stretches != NULL ? stretches + begin : NULL,
                               touched + begin};
    fum_sight_get()(sight, begin, part, &out);
    begin += part;
  }
  fum_cpu_limit(FUM_CPU_AVX512);
}

/* Returns how many are seen. */
static int64_t check_octree(const fum_octree *octree, const fum_view *view, const fum_slabs *slabs,
                            const fum_splats_options *options) {
  const size_t count = (size_t)octree->count;
  fum_splat *splats = malloc(count * sizeof *splats);
  fum_stretch *stretches = calloc(count, sizeof *stretches);
  fum_touched *touched = malloc(count * sizeof *touched);
  fum_sight sight;
  int64_t seen = 0;
  assert_true(splats != NULL && stretches != NULL && touched != NULL);
  fum_sight_find(octree, view, slabs, options, &sight);
  for (int level = 0; level <= (int)FUM_CPU_AVX512; level++) {
    see_at_level(&sight, (fum_cpu_level)level, splats, stretches, touched);
    seen = 0;
    for (int64_t i = 0; i < octree->count; i++) {
      fum_stretch stretch = {0};
      const fum_splat expected = fum_sight_splat(&sight, i, NULL, &stretch);
      const bool is_seen = fum_splat_is_seen(&expected);
      seen += is_seen;
      if (is_seen != fum_splat_is_seen(&splats[i])) {
        if (!is_at_edge(view, is_seen ? &expected : &splats[i])) fail_msg("splat %d: seen %d", (int)i, !is_seen);
        continue;
      }
      check_touched(view, i, &splats[i], touched[i]);
      check_close("width", i, (double)splats[i].width, (double)expected.width, RELATIVE * (double)expected.width);
      if (!is_seen) continue;
      check_splat(i, &splats[i], &expected);
      check_slabs(slabs, i, &splats[i]);
      if (octree->stretches != NULL) check_stretch(i, &expected, &stretches[i], &stretch);
    }
  }
  free(touched);
  free(stretches);
  free(splats);
  return seen;
}

static void check_smoke(const smoke *s, const shot *of) {
  const fum_splats_options options = {.footprints = fum_footprints_find(4.0, 2.5), .thinnest = 1e-5F};
  const fum_view view = find_view(s, of);
  fum_slabs slabs;
  assert_int_equal(fum_slabs_find(s->stage.context, s->all, &view, NULL, 0.01F, 0.01F, options.thinnest, &slabs),
                   FUM_OK);
  assert_true(slabs.count > 0);
  const fum_octree *octree = s->bunched != NULL ? s->bunched : s->all;
  assert_true(check_octree(octree, &view, &slabs, &options) > octree->count / 50);
  fum_slabs_free(s->stage.context, &slabs);
}

static const shot SHOTS[] = {
    {FUM_CAMERA_PERSPECTIVE, 1920, 1080, {0.1, 0.05, 5.0}, 0.3, 0.1, 100.0},        /* before */
    {FUM_CAMERA_PERSPECTIVE, 300, 200, {0.3, -0.2, 1000.0}, 0.0008, 999.8, 1000.1}, /* far away, cut */
    {FUM_CAMERA_PERSPECTIVE, 640, 480, {0.1, 0.2, 0.3}, 1.0, 0.01, 100.0},          /* inside */
    {FUM_CAMERA_PERSPECTIVE, 8000, 100, {-0.1, 0.0, 0.2}, 20.0, 0.0, 0.7},          /* inside, wide, cut */
    {FUM_CAMERA_PERSPECTIVE, 30, 17, {0.1, 0.05, 5.0}, 0.3, 0.1, 100.0},            /* few pixels */
    {FUM_CAMERA_ORTHOGRAPHIC, 1000, 700, {0.1, 0.2, 3.0}, 0.9, 0.1, 100.0},         /* orthographic */
    {FUM_CAMERA_ORTHOGRAPHIC, 60, 64, {0.0, 0.0, 0.3}, 1.5, 0.0, 1.0},              /* orthographic, cut */
};

enum { SHOT_COUNT = sizeof SHOTS / sizeof *SHOTS };

/* Thin and thick, up to optical depths of hundreds. */
static puffs make_puffs(int64_t count, float radius) {
  puffs p = puffs_random(count, 11, 1.0F, radius, 1.0F);
  for (int64_t i = 0; i < count; i++)
    p.densities[i] = expf(uniform(1000U + (uint64_t)i, -6.0F, 6.0F)) / radius;
  return p;
}

static void check_shots(const puffs *p, float side) {
  smoke s = smoke_open(p, side);
  for (int k = 0; k < SHOT_COUNT; k++)
    check_smoke(&s, &SHOTS[k]);
  smoke_close(&s);
}

static void test_round_splats(void **state) {
  (void)state;
  puffs p = make_puffs(5003, 0.05F);
  check_shots(&p, 0.0F);
  puffs_free(&p);
}

static void test_bunches(void **state) {
  (void)state;
  puffs p = make_puffs(40001, 0.08F);
  for (int64_t i = 0; i < p.count; i++)
    p.radii[i] = 0.12F + 0.02F * (float)(i % 3);
  check_shots(&p, 2.5F);
  puffs_free(&p);
}

/* Tiny and huge scenes, in whose units squares of squares would leave the range of floats. */
static void test_scales(void **state) {
  (void)state;
  const float scales[2] = {1e-9F, 1e9F};
  for (int k = 0; k < 2; k++) {
    puffs p = make_puffs(20001, 0.12F);
    for (int64_t i = 0; i < p.count; i++) {
      for (int axis = 0; axis < 3; axis++)
        p.positions[3 * i + axis] *= scales[k];
      p.radii[i] = (0.12F + 0.02F * (float)(i % 3)) * scales[k];
      p.densities[i] /= scales[k];
    }
    smoke s = smoke_open(&p, 2.5F);
    shot scaled = SHOTS[0];
    for (int axis = 0; axis < 3; axis++)
      scaled.eye[axis] *= (double)scales[k];
    scaled.clip_start *= (double)scales[k];
    scaled.clip_end *= (double)scales[k];
    check_smoke(&s, &scaled);
    smoke_close(&s);
    puffs_free(&p);
  }
}

/* Does what a splat's box and rim leave of it, made larger by so many pixels, touch a tile? */
static bool touches(const fum_splat *s, const fum_splats *splats, int64_t tile, float more, float rim) {
  const int32_t place[2] = {(int32_t)(tile % splats->columns), (int32_t)(tile / splats->columns)};
  fum_splat around = *s;
  float gaps = 0.0F;
  if (!fum_splat_is_seen(s)) return false;
  for (int axis = 0; axis < 2; axis++) {
    const float first = (float)(place[axis] * FUM_TILE), last = first + (float)(FUM_TILE - 1);
    around.half_px[axis] = fmaxf(s->half_px[axis] + more, 1e-3F);
    const float gap = fum_splat_gap(&around, axis, first, last);
    if (gap > 1.0F) return false;
    gaps += gap;
  }
  return gaps <= rim;
}

/* Lists are in order, and hold what touches the wanted tiles of those splats that count. Others are listed whose boxes
 * touch them, or end between pixels beside them, but few: those that touch no second row or column. */
static void check_lists(const fum_splats *splats, const uint8_t *wanted, const uint8_t *counts) {
  const float close = (float)PIXELS;
  int64_t others = 0;
  for (int64_t tile = 0; tile < (int64_t)splats->columns * splats->rows; tile++) {
    int64_t n = splats->tile_begins[tile];
    const int64_t end = splats->tile_begins[tile + 1];
    if (wanted != NULL && !wanted[tile]) assert_int_equal(n, end);
    if (wanted != NULL && !wanted[tile]) continue;
    for (int64_t i = 0; i < splats->count; i++) {
      const bool is_listed = n < end && splats->tile_splats[n] == i;
      const bool is_asked = counts == NULL || counts[i];
      n += is_listed;
      const fum_splat *splat = &splats->splats[i];
      if (is_listed && !(is_asked && touches(splat, splats, tile, 1.0F + close, INFINITY)))
        fail_msg("tile %d lists %d", (int)tile, (int)i);
      if (!is_listed && is_asked && touches(splat, splats, tile, -close, splat->rim))
        fail_msg("tile %d misses %d", (int)tile, (int)i);
      others += is_listed && !touches(splat, splats, tile, close, splat->rim);
    }
    assert_int_equal(n, end);
  }
  assert_true(100 * others < splats->tile_begins[splats->columns * splats->rows]);
}

/* Tiles of a picture, and of one with twice as many pixels a side. Threads make no difference. */
static void test_tiles(void **state) {
  (void)state;
  const shot coarse = {FUM_CAMERA_PERSPECTIVE, 300, 170, {0.1, 0.05, 5.0}, 0.2, 0.1, 100.0};
  shot fine = coarse;
  fine.width *= 2;
  fine.height *= 2;
  puffs p = make_puffs(3001, 0.03F);
  for (int64_t i = 0; i < p.count; i += 50)
    p.radii[i] = 0.5F; /* some reach over many tiles */
  const fum_splats_options options = {.footprints = fum_footprints_find(4.0, 2.5)};
  uint32_t *kept = NULL;
  for (int threads = 1; threads <= 3; threads++) {
    smoke s = smoke_open(&p, 0.0F);
    fum_context *context = s.stage.context;
    assert_int_equal(fum_context_set_threads(context, threads), FUM_OK);
    const fum_view views[2] = {find_view(&s, &coarse), find_view(&s, &fine)};
    fum_slabs slabs;
    fum_splats splats;
    assert_int_equal(fum_slabs_find(context, s.all, &views[0], NULL, 0.01F, 0.01F, 0.0F, &slabs), FUM_OK);
    assert_int_equal(fum_splats_find(context, s.all, &views[0], &slabs, &options, &splats), FUM_OK);
    check_lists(&splats, NULL, NULL);
    const size_t bytes = (size_t)splats.tile_begins[splats.columns * splats.rows] * sizeof *kept;
    if (threads == 1) {
      kept = malloc(bytes);
      assert_non_null(kept);
      memcpy(kept, splats.tile_splats, bytes);
    }
    assert_memory_equal(kept, splats.tile_splats, bytes);

    uint8_t from[10 * 6], wanted[19 * 11], *asked = calloc((size_t)splats.count, 1);
    assert_non_null(asked);
    assert_int_equal(splats.columns * splats.rows, sizeof from);
    for (int64_t tile = 0; tile < (int64_t)sizeof from; tile++) {
      from[tile] = tile % 10 < 5;
      for (int64_t n = splats.tile_begins[tile]; from[tile] && n < splats.tile_begins[tile + 1]; n++)
        asked[splats.tile_splats[n]] = 1;
    }
    for (size_t tile = 0; tile < sizeof wanted; tile++)
      wanted[tile] = tile % 3 != 0;
    const fum_splats_again again = {.from = from, .wanted = wanted, .scale = 2.0F, .shift = {0.5F, 0.5F}};
    assert_int_equal(fum_splats_see_again(context, s.all, &views[1], &slabs, &options, &again, &splats), FUM_OK);
    assert_int_equal(splats.columns * splats.rows, sizeof wanted);
    check_lists(&splats, wanted, asked);
    int64_t asked_count = 0;
    fum_splats anew;
    assert_int_equal(fum_splats_find(context, s.all, &views[1], &slabs, &options, &anew), FUM_OK);
    for (int64_t i = 0; i < splats.count; i++) {
      asked_count += asked[i];
      if (asked[i] && fum_splat_is_seen(&anew.splats[i])) check_splat(i, &splats.splats[i], &anew.splats[i]);
    }
    assert_true(asked_count > 100 && asked_count < splats.count);
    fum_splats_free(context, &anew);
    free(asked);
    fum_splats_free(context, &splats);
    fum_slabs_free(context, &slabs);
    smoke_close(&s);
  }
  free(kept);
  puffs_free(&p);
}

int main(void) {
  const struct CMUnitTest tests[] = {
      cmocka_unit_test(test_round_splats),
      cmocka_unit_test(test_bunches),
      cmocka_unit_test(test_scales),
      cmocka_unit_test(test_tiles),
  };
  return cmocka_run_group_tests(tests, NULL, NULL);
}
