/* SPDX-License-Identifier: GPL-3.0-or-later */
/* What a drawing back end gets: Gaussian billboards in camera space, ordered, and the frame they are drawn in. */
#ifndef FUM_BILLBOARD_BILLBOARD_H
#define FUM_BILLBOARD_BILLBOARD_H

#include "billboard/bokeh.h"
#include "billboard/map_look.h"

/* One particle as drawn: the source function fills its Gaussian of optical depth. Camera space looks along -Z. */
typedef struct fum_billboard {
  float center[3];     /* camera space, m */
  float sigma;         /* m, above 0 */
  float optical_depth; /* through the centre, from end to end: density sigma sqrt(2 pi) */
  float source[3];     /* source function: radiance that a fully opaque particle shows */
} fum_billboard;

/* Maps on billboards. */
typedef struct fum_billboard_maps {
  int32_t count;
  const fum_map **maps; /* [count] */
  fum_map_look *looks;  /* [billboards]; each begins at its texel of all maps one after the other, fum_billboard_rows
                           apart; width 0: no map */
} fum_billboard_maps;

/* All maps together are kept in rows of this many texels. */
enum { FUM_MAP_ROW = 4096 };

static inline int64_t fum_billboard_rows(const fum_map *map) {
  return (map->texel_count + FUM_MAP_ROW - 1) / FUM_MAP_ROW;
}

/* What the shutter and the lens do to a billboard; its centre is the middle of the path then. As in fum_smear. */
typedef struct fum_billboard_smear {
  float path[3]; /* m */
  float confusion;
} fum_billboard_smear;

/* Of a picture that is blurred. */
typedef struct fum_frame_blur {
  const fum_billboard_smear *smears; /* one for each billboard */
  float confusion_per_depth;         /* as these in fum_smears */
  float extent;
  const fum_bokeh *bokeh;
} fum_frame_blur;

/* The picture's geometry; see fum_camera. */
typedef struct fum_frame {
  int32_t type; /* FUM_CAMERA_ */
  int32_t width, height;
  float window[4]; /* left, right, bottom, top at unit depth or in metres */
  float clip_start, clip_end;
  float footprint_sigmas; /* a thin billboard is drawn out to this many sigmas from its centre; see fum_footprint */
  const float
      *solid_depths; /* [height][width] depth along the axis of the nearest solid (clip_end if none); NULL: none */
  const fum_billboard_maps *maps; /* NULL: none */
  const fum_frame_blur *blur;     /* NULL: billboards are as they are */
} fum_frame;

#endif
