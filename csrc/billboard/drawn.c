/* SPDX-License-Identifier: GPL-3.0-or-later */
#include "billboard/drawn.h"

/* Of fewer, each is seen. */
enum { FEWEST = 10000 };

/* Pixels that a bunch's particles are wide at least: what is narrower is widened by itself. */
static const double NARROW_PX = 0.8;
/* Depth over sigma from which on a bunch looks alike to all rays that meet it. */
static const float FAR_AWAY = 60.0F;

static fum_bunch_sight find_sight(const fum_view *view) {
  fum_bunch_sight sight = {
      .depth = {0.0F, 0.0F, 0.0F, 1.0F}, .least = (float)(NARROW_PX * fum_view_pixel(view)), .most = INFINITY};
  if (view->type != FUM_CAMERA_PERSPECTIVE) return sight;
  for (int k = 0; k < 4; k++)
    sight.depth[k] = (float)-view->camera_from_local[8 + k];
  sight.most = 1.0F / FAR_AWAY;
  return sight;
}

/* Extinction times sigma up to which smoke is thin. */
static const double THIN = 0.0127;

/* Side of cells, in sigmas. What a picture is off by grows with its fourth power; and with the root of the thickness,
 * as the fewer particles are seen before all is dark the less their errors even out, but for smoke that is thin. Fitted
 * to pictures without bunches (docs/ACCURACY.md). */
static double find_side(double tolerance, double thickness) {
  const double usual = 1.6, usual_tolerance = 0.01;
  return usual * sqrt(sqrt(tolerance / usual_tolerance * sqrt(THIN / fmax(THIN, thickness))));
}

/* Share of the particles that may be left. Where more are, the gain isn't worth what a picture of thick ones is off by.
 */
static float find_most_left(double thickness) {
  return thickness < 2.0 * THIN ? 0.75F : 0.5F;
}

int32_t fum_drawn_bunch(fum_context *context, const fum_tile_job *job, float tolerance, fum_octree **out_bunched) {
  const double thickness = job->slabs->thickness, side = find_side((double)tolerance, thickness), least = 1.2;
  const fum_bunch_sight sight = find_sight(job->view);
  const fum_bunch_options options = {.sigma_scale = 1.0F,
                                     .side = (float)side,
                                     .most_left = find_most_left(thickness),
                                     .keeps_members = true,
                                     .sight = &sight};
  *out_bunched = NULL;
  if (!job->is_uniform || job->octree->count < FEWEST || side < least) return FUM_OK;
  return fum_octree_bunch(context, job->octree, &options, out_bunched);
}
