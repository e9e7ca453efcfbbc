/* SPDX-License-Identifier: GPL-3.0-or-later */
#include "api/attributes.h"
#include "api/particle_light.h"
#include "api/smeared.h"
#include "billboard/arrange.h"
#include "billboard/gl.h"

#include <string.h>

static int32_t light_particles(fum_rendering *r, float **out_light) {
  const double start_s = fum_now_s();
  const fum_octree *all = r->scene->caches->all;
  fum_lighting lighting = {0};
  float *light = NULL;
  int32_t status = fum_alloc(r->context, all->count, 3 * sizeof *light, "light of the particles", &light);
  if (status == FUM_OK) status = fum_lighting_begin(r->scene, &r->settings, all, &lighting);
  if (status == FUM_OK) status = fum_light_particles(r, &lighting, NULL, light);
  if (status != FUM_OK) goto done;
  r->stats.light_points = all->count;
  fum_note_lighting(&lighting, r);
  r->stats.light_s = fum_now_s() - start_s - r->stats.meter_s;
  *out_light = light;
  light = NULL;
done:
  fum_lighting_end(r->context, &lighting);
  fum_free(r->context, &light);
  return status;
}

/* Billboards are squares around their footprint, and hold more than tiles would of the same. */
static fum_frame make_frame(const fum_rendering *r) {
  const fum_view *view = &r->view;
  fum_frame frame = {.type = view->type,
                     .width = view->width,
                     .height = view->height,
                     .clip_start = (float)view->clip_start,
                     .clip_end = (float)view->clip_end,
                     .footprint_sigmas = fum_footprint_sigmas(r->scene, 0.25F * r->settings.tolerance),
                     .solid_depths = r->solid.depths};
  for (int i = 0; i < 4; i++)
    frame.window[i] = (float)view->window[i];
  return frame;
}

static int64_t pixel_count(const fum_rendering *r) {
  return (int64_t)r->view.width * r->view.height;
}

/* Billboards in their order, for drawing them again with other values. */
typedef struct arranged {
  fum_rendering *r;
  fum_frame frame;
  int64_t count;
  const uint32_t *ranks;
  fum_billboard *billboards;
  fum_billboard_maps *maps; /* NULL: none */
} arranged;

static void note_through(const fum_rendering *r, const float *rgba, float *through) {
  for (int64_t i = 0; i < pixel_count(r) && through != NULL; i++)
    through[i] = 1.0F - rgba[4 * i + 3];
}

/* Draws up to the nearer solid in each pixel, and where edges run what is beside it as well. `through` is as of the
 * rendering. */
static int32_t draw_up_to_solids(const arranged *a, float *const through[2], float *out_rgba) {
  fum_rendering *r = a->r;
  fum_frame frame = a->frame;
  float *beside = NULL;
  int32_t status = fum_gl_draw(r->context, &frame, a->count, a->billboards, out_rgba, r->stats.device);
  if (status == FUM_OK) note_through(r, out_rgba, through[0]);
  if (status != FUM_OK || r->solid.shares == NULL) return status;
  status = fum_alloc(r->context, pixel_count(r), 4 * sizeof *beside, "picture beside solids", &beside);
  frame.solid_depths = r->solid.behind;
  if (status == FUM_OK) status = fum_gl_draw(r->context, &frame, a->count, a->billboards, beside, r->stats.device);
  for (int64_t i = 0; i < 4 * pixel_count(r) && status == FUM_OK; i++) {
    const float share = r->solid.shares[i / 4];
    if (share < 1.0F) out_rgba[i] = share * out_rgba[i] + (1.0F - share) * beside[i];
  }
  if (status == FUM_OK) note_through(r, beside, through[1]);
  fum_free(r->context, &beside);
  return status;
}

/* A fum_draw_values_fn. */
static int32_t draw_values(void *user, const float *values, bool are_colors, float *out_rgba) {
  float *const nowhere[2] = {NULL, NULL};
  const arranged *a = user;
  for (int64_t n = 0; n < a->count; n++)
    memcpy(a->billboards[n].source, values + 3 * (int64_t)a->ranks[n], sizeof a->billboards[n].source);
  for (int64_t n = 0; n < a->count && a->maps != NULL; n++)
    a->maps->looks[n].is_colored = are_colors;
  return draw_up_to_solids(a, nowhere, out_rgba);
}

static int32_t draw_billboards(fum_rendering *r, const float *light) {
  const fum_octree *all = r->scene->caches->all;
  const bool has_maps = fum_scene_map_traits(r->scene).has_maps;
  fum_frame frame = make_frame(r);
  fum_billboard_maps maps = {0};
  fum_smeared smeared = {0};
  fum_billboard_smear *smears = NULL;
  uint32_t *ranks = NULL;
  fum_billboard *billboards = NULL;
  int64_t count = 0;
  double start_s = fum_now_s();
  int32_t status = fum_progress_report(r->context, FUM_STAGE_SORTING, 0.0F, "Sorting particles by depth");
  if (status != FUM_OK) goto done;
  status = fum_smeared_find(r, &smeared);
  if (status != FUM_OK) goto done;
  const bool is_blurred = smeared.smears.items != NULL;
  status = fum_arrange_order(r->scene, all, &r->view, is_blurred ? &smeared.smears : NULL, frame.footprint_sigmas,
                             &ranks, &count);
  if (status == FUM_OK && is_blurred) status = fum_alloc(r->context, count, sizeof *smears, "billboards", &smears);
  if (status == FUM_OK) status = fum_alloc(r->context, count, sizeof *billboards, "billboards", &billboards);
  if (status != FUM_OK) goto done;
  fum_arrange_billboards(r->scene, all, &r->view, light, count, ranks, billboards);
  const fum_frame_blur blur = {.smears = smears,
                               .confusion_per_depth = (float)smeared.smears.confusion_per_depth,
                               .extent = (float)smeared.smears.extent,
                               .bokeh = &smeared.bokeh};
  if (is_blurred) {
    fum_arrange_smears(r->context, &smeared.smears, count, ranks, billboards, smears);
    frame.blur = &blur;
  } else if (has_maps) {
    status = fum_arrange_maps(r->scene, all, &r->view, count, ranks, &maps);
    if (status != FUM_OK) goto done;
    frame.maps = &maps;
  }
  r->stats.drawn_count = count;
  r->stats.sort_s = fum_now_s() - start_s;
  start_s = fum_now_s();
  arranged all_of_them = {r, frame, count, ranks, billboards, frame.maps != NULL ? &maps : NULL};
  status = draw_up_to_solids(&all_of_them, r->through, r->combined);
  r->stats.draw_s = fum_now_s() - start_s;
  if (status == FUM_OK) status = fum_attributes_make(r, draw_values, &all_of_them);
done:
  fum_arrange_free_maps(r->context, &maps);
  fum_smeared_free(r->context, &smeared);
  fum_free(r->context, &smears);
  fum_free(r->context, &billboards);
  fum_free(r->context, &ranks);
  return status;
}

int32_t fum_combine_with_gl(fum_rendering *r) {
  float *light = NULL;
  int32_t status = light_particles(r, &light);
  if (status == FUM_OK) status = draw_billboards(r, light);
  fum_free(r->context, &light);
  return status;
}
