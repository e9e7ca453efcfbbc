/* SPDX-License-Identifier: GPL-3.0-or-later */
/* What a drawing back end gets: Gaussian billboards in camera space, ordered, and the frame they are drawn in. */
#ifndef FUM_BILLBOARD_BILLBOARD_H
#define FUM_BILLBOARD_BILLBOARD_H

#include "fumarole.h"

/* One particle as drawn: the source function fills its Gaussian of optical depth. Camera space looks along -Z. */
typedef struct fum_billboard {
  float center[3];     /* camera space, m */
  float sigma;         /* m, above 0 */
  float optical_depth; /* through the centre, from end to end: density sigma sqrt(2 pi) */
  float source[3];     /* source function: radiance that a fully opaque particle shows */
} fum_billboard;

/* The picture's geometry; see fum_camera. */
typedef struct fum_frame {
  int32_t type; /* FUM_CAMERA_ */
  int32_t width, height;
  float window[4]; /* left, right, bottom, top at unit depth or in metres */
  float clip_start, clip_end;
  float footprint_sigmas; /* a thin billboard is drawn out to this many sigmas from its centre; see fum_footprint */
  const float
      *solid_depths; /* [height][width] depth along the axis of the nearest solid (clip_end if none); NULL: none */
} fum_frame;

#endif
