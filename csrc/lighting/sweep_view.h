/* SPDX-License-Identifier: GPL-3.0-or-later */
/* How a light sees casters: the planes before it, and how large they look. */
#ifndef FUM_LIGHTING_SWEEP_VIEW_H
#define FUM_LIGHTING_SWEEP_VIEW_H

#include "lighting/emitter.h"
#include "lighting/medium.h"

/* A plane before the light: of all the light's view where that is narrow or parallel, else a side of a cube. */
typedef struct fum_sweep_face {
  fum_vec3 right, up, axis; /* unit; the axis points away from the light */
  float offset[3];          /* of the middle of the casters from the light, along them */
  float lower[2], upper[2]; /* window: in tangents, of a parallel light in m */
  int32_t columns, rows;    /* of patches */
  int64_t first_patch;
} fum_sweep_face;

enum { FUM_SWEEP_FACES = 6 };

/* Casters near a light, too large as seen from it for a footprint, or too near for ranges. */
typedef struct fum_sweep_vicinity {
  int64_t count;
  double reach;    /* m from the light, beyond which all of them are in front of a receiver */
  double smallest; /* sigma over distance */
} fum_sweep_vicinity;

/* How a light sees casters and receivers: as points relative to `middle`. */
typedef struct fum_sweep_view {
  bool is_parallel;
  fum_vec3 middle;             /* of the casters, local space */
  double to_middle[3];         /* from the light */
  double nearest, farthest;    /* of the casters' centres, from the light, but those in its vicinity */
  double reference;            /* distance d at which ranges are 0. They grow with the logarithm of the distance:
                                  2 (x + x^3 / 3 + x^5 / 5 + x^7 / 7) of x = (d - reference) / (d + reference) */
  float reach;                 /* sigmas across the rays over which casters are put into a grid */
  double reach_m;              /* that of the largest caster */
  float smallest, largest;     /* of... */
  float *sigmas;               /* ...[casters] sigmas in tangents, of a parallel light in m; 0: not to be seen */
  float *widest;               /* [casters] sigmas where they are widest, at most, m */
  fum_sweep_vicinity vicinity; /* of the light: those casters aren't to be seen either */
  int32_t face_count;
  fum_sweep_face faces[FUM_SWEEP_FACES];
} fum_sweep_view;

/* The range at a distance; as find_places in sweep_places.h. */
static inline double fum_sweep_range(const fum_sweep_view *view, double distance) {
  const double x = (distance - view->reference) / (distance + view->reference), squared = x * x;
  return 2.0 * x * (1.0 + squared * (1.0 / 3.0 + squared * (0.2 + squared / 7.0)));
}

/* Places the light and finds out how the casters are seen. `*out_is_clear` is false, and there may be nothing to free,
 * where there are none but those in the light's vicinity. */
int32_t fum_sweep_view_find(fum_context *context, const fum_medium *medium, const fum_emitter *emitter,
                            fum_sweep_view *out_view, bool *out_is_clear);
void fum_sweep_view_free(fum_context *context, fum_sweep_view *view);

#endif
