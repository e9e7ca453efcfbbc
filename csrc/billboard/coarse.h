/* SPDX-License-Identifier: GPL-3.0-or-later */
/* Smoke that is smooth against pixels, drawn on a coarser grid and interpolated. Particles are Gaussians, hence nearly
 * band-limited: where all are wide against the step, splines through every 2nd, 4th or 8th pixel are the picture. Where
 * they aren't, tiles are drawn pixel by pixel. */
#ifndef FUM_BILLBOARD_COARSE_H
#define FUM_BILLBOARD_COARSE_H

#include "billboard/tiles.h"

/* How a picture was drawn. */
typedef struct fum_coarse_report {
  int32_t step;       /* pixels from one that was drawn to the next; 1: all were */
  int64_t tile_count; /* with smoke... */
  int64_t fine_count; /* ...and those of them that were drawn pixel by pixel */
  int64_t seen_count; /* particles */
  double draw_s;      /* the rest of the time went into sorting */
} fum_coarse_report;

/* Draws all of a picture without smears and deep pixels: finds the splats for `job`, and leaves them as the last tiles
 * needed them in `splats`, which is the job's. `tolerance` is the relative error of the picture. */
int32_t fum_coarse_draw(fum_context *context, fum_tile_job *job, const fum_splats_options *options, float tolerance,
                        fum_splats *splats, fum_coarse_report *out);

#endif
