/* SPDX-License-Identifier: GPL-3.0-or-later */
#include "billboard/splats.h"

#include "billboard/splat_sight.h"

/* Splats that are seen and sorted together, while they are in the cache. */
enum { CHUNK = 256 };

/* How splats are seen. */
typedef struct seeing {
  fum_sight sight;
  fum_sight_fn see;              /* several */
  const fum_splats_again *again; /* NULL: for the first time */
  uint8_t *asked;                /* [count] those that are seen again; NULL: all are seen as for the first time */
} seeing;

static void see_smeared(const seeing *w, int64_t i, const fum_splat_sorting *s) {
  const fum_splats *splats = s->splats;
  fum_stretch *stretch = splats->stretches != NULL ? &splats->stretches[i] : NULL;
  fum_streak *streak = &splats->streaks[i];
  splats->splats[i] = fum_sight_splat(&w->sight, i, streak, stretch);
  s->touched[i] = fum_touched_find(w->sight.view, &splats->splats[i], streak->kind != FUM_STREAK_NONE);
}

/* None of which is smeared. */
static void see_anew(const seeing *w, int64_t begin, int64_t end, const fum_splat_sorting *s) {
  const fum_splats *splats = s->splats;
  const fum_sight_out out = {splats->splats + begin, splats->stretches != NULL ? splats->stretches + begin : NULL,
                             s->touched + begin};
  w->see(&w->sight, begin, (int32_t)(end - begin), &out);
}

/* Only its place in the picture is another one, unless it was widened. */
static void see_again(const seeing *w, int64_t i, const fum_splat_sorting *s) {
  const fum_splats_again *again = w->again;
  fum_splat *splat = &s->splats->splats[i];
  if (splat->width > splat->sigma) {
    see_anew(w, i, i + 1, s);
    return;
  }
  for (int axis = 0; axis < 2; axis++) {
    splat->middle_px[axis] = splat->middle_px[axis] * again->scale + again->shift[axis];
    splat->half_px[axis] *= again->scale;
  }
  s->touched[i] = fum_touched_find(w->sight.view, splat, false);
}

static void see(const seeing *w, int64_t begin, int64_t end, const fum_splat_sorting *s) {
  if (s->splats->streaks == NULL && w->asked == NULL) {
    see_anew(w, begin, end, s);
    return;
  }
  for (int64_t i = begin; i < end; i++) {
    if (w->asked == NULL) {
      see_smeared(w, i, s);
    } else if (w->asked[i]) {
      see_again(w, i, s);
    }
  }
}

/* What is said of all splats. */
typedef struct census {
  int64_t seen; /* particles */
  bool has_dust;
} census;

static census look_at(const seeing *w, const fum_splats *splats, int64_t begin, int64_t end) {
  census c = {0};
  for (int64_t i = begin; i < end; i++) {
    const fum_splat *s = &splats->splats[i];
    if (w->asked != NULL && !w->asked[i]) continue;
    c.seen += fum_splat_is_seen(s) ? fum_octree_members(w->sight.octree, i) : 0;
    c.has_dust |= s->width > s->sigma;
  }
  return c;
}

/* Sees splats, for which there is room, and sorts them into tiles. */
static int32_t see_and_sort(fum_context *context, const seeing *w, const uint8_t *wanted, fum_splats *splats) {
  fum_splat_sorting s;
  int64_t seen = 0;
  bool has_dust = false;
  int32_t status = fum_splat_sorting_begin(context, w->sight.view, splats, wanted, &s);
  if (status != FUM_OK) goto done;
#pragma omp parallel for num_threads(s.blocks) schedule(static, 1) reduction(+ : seen) reduction(|| : has_dust)
  for (int block = 0; block < s.blocks; block++) {
    const int64_t end = fum_splat_sorting_block(&s, block + 1);
    for (int64_t i = fum_splat_sorting_block(&s, block); i < end; i += CHUNK) {
      const int64_t next = i + CHUNK < end ? i + CHUNK : end;
      if (fum_progress_in_loop(context, i / CHUNK, 1 << 8)) break;
      see(w, i, next, &s);
      fum_splat_sorting_count(&s, block, i, next);
      const census c = look_at(w, splats, i, next);
      seen += c.seen;
      has_dust = has_dust || c.has_dust;
    }
  }
  splats->seen_count = seen;
  splats->has_dust = has_dust;
  status = fum_is_cancelled(context) ? FUM_ERROR_CANCELLED : FUM_OK;
  if (w->again == NULL) status = fum_progress_report(context, FUM_STAGE_SORTING, 0.5F, "Sorting particles into tiles");
  if (status == FUM_OK) status = fum_splat_sorting_write(context, &s);
done:
  fum_splat_sorting_end(context, &s);
  return status;
}

int32_t fum_splats_find(fum_context *context, const fum_octree *octree, const fum_view *view, const fum_slabs *slabs,
                        const fum_splats_options *options, fum_splats *out_splats) {
  fum_splats s = {
      .count = octree->count, .columns = fum_tiles_along(view->width), .rows = fum_tiles_along(view->height)};
  seeing w = {.see = fum_sight_get()};
  fum_sight_find(octree, view, slabs, options, &w.sight);
  int32_t status = fum_alloc(context, s.count, sizeof *s.splats, "splats", &s.splats);
  if (status == FUM_OK && octree->stretches != NULL)
    status = fum_alloc(context, s.count, sizeof *s.stretches, "splats", &s.stretches);
  if (status == FUM_OK && options->smears != NULL)
    status = fum_alloc(context, s.count, sizeof *s.streaks, "splats", &s.streaks);
  if (status == FUM_OK) status = see_and_sort(context, &w, NULL, &s);
  if (status == FUM_OK) {
    *out_splats = s;
  } else {
    fum_splats_free(context, &s);
  }
  return status;
}

/* Marks the splats of some tiles. */
static int32_t ask_for(fum_context *context, const fum_splats *splats, const uint8_t *tiles, uint8_t **out_asked) {
  const int32_t status = fum_alloc(context, splats->count, sizeof **out_asked, "splats", out_asked);
  if (status != FUM_OK) return status;
#pragma omp parallel for num_threads(fum_thread_count(context)) schedule(dynamic)
  for (int64_t tile = 0; tile < (int64_t)splats->columns * splats->rows; tile++) {
    for (int64_t n = splats->tile_begins[tile]; tiles[tile] && n < splats->tile_begins[tile + 1]; n++) {
      uint8_t *at = &(*out_asked)[splats->tile_splats[n]];
#pragma omp atomic write
      *at = 1;
    }
  }
  return FUM_OK;
}

int32_t fum_splats_see_again(fum_context *context, const fum_octree *octree, const fum_view *view,
                             const fum_slabs *slabs, const fum_splats_options *options, const fum_splats_again *again,
                             fum_splats *splats) {
  seeing w = {.see = fum_sight_get(), .again = again};
  int32_t status = FUM_OK;
  fum_sight_find(octree, view, slabs, options, &w.sight);
  if (again->from != NULL) status = ask_for(context, splats, again->from, &w.asked);
  fum_free(context, &splats->tile_begins);
  fum_free(context, &splats->tile_splats);
  splats->columns = fum_tiles_along(view->width);
  splats->rows = fum_tiles_along(view->height);
  if (status == FUM_OK) status = see_and_sort(context, &w, again->wanted, splats);
  fum_free(context, &w.asked);
  return status;
}

void fum_splats_free(fum_context *context, fum_splats *splats) {
  fum_free(context, &splats->splats);
  fum_free(context, &splats->stretches);
  fum_free(context, &splats->streaks);
  fum_free(context, &splats->tile_begins);
  fum_free(context, &splats->tile_splats);
}
