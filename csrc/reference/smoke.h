/* SPDX-License-Identifier: GPL-3.0-or-later */
/* The reference's own smoke: every particle of the scene in double precision, and a list of cells to find those near a
 * ray. Nothing else of the renderer is used. */
#ifndef FUM_REFERENCE_SMOKE_H
#define FUM_REFERENCE_SMOKE_H

#include "reference/map.h"

typedef struct fum_gaussian {
  double centre[3]; /* relative to the scene's origin */
  double sigma;     /* m */
  double density;   /* peak extinction, mean of red, green and blue, 1/m */
  double tint[3];   /* theirs over it */
  double cut;       /* m; what lies farther from the centre than this is left out */
  int64_t index;    /* in its set */
  int32_t set;
} fum_gaussian;

/* Neighbours of about the same size, and the ball outside which none of them is heard. */
typedef struct fum_smoke_cell {
  double centre[3], radius;
  int64_t begin, end;
} fum_smoke_cell;

typedef struct fum_smoke {
  const fum_scene *scene;
  int64_t count, cell_count;
  fum_gaussian *gaussians;
  fum_smoke_cell *cells;
  double smallest_sigma;   /* INFINITY: no particles */
  const fum_view *view;    /* of the camera that sees maps on particles; NULL: nobody looks */
  fum_reference_map *maps; /* [sets of particles] */
} fum_smoke;

/* A straight way through the smoke. */
typedef struct fum_way {
  double start[3];
  double direction[3]; /* unit */
  double length;       /* m; may be INFINITY */
} fum_way;

/* Gaussian of which a way's distance from the centre has been taken into account: along the way it is one-dimensional.
 */
typedef struct fum_heard {
  double along; /* m from the way's start to the point nearest to the centre */
  double sigma, cut;
  double density; /* there, 1/m */
  double tint[3];
  double scattering[3], glow[3]; /* albedo times extinction; emission, there */
  int32_t set;
} fum_heard;

/* The ones heard along a way, in the order in which they begin to be heard. */
typedef struct fum_heard_list {
  fum_heard *items;
  int64_t count, capacity;
} fum_heard_list;

/* Particles that neither absorb nor shine are left out. A Gaussian is cut where less than `lost` of its optical depth,
 * or of one if that is more, lies beyond. scene->origin must be current. Freed with fum_smoke_free also on failure. */
int32_t fum_smoke_init(fum_scene *scene, double lost, fum_smoke *out_smoke);
void fum_smoke_free(fum_smoke *smoke);

/* Readies the maps for fum_smoke_listen. `view` is to live as long as the smoke. */
int32_t fum_smoke_look(fum_smoke *smoke, const fum_view *view);

/* Integral of the unit Gaussian exp(-t^2 / (2 sigma^2)) from a to b, by erfc so that tails don't cancel. */
double fum_gaussian_integral(double sigma, double a, double b);

/* Optical depth, along a way to a light, of the particles in `shadow_sets` for red, green and blue, by the closed form.
 * Ends early once all are beyond FUM_DARK_DEPTH. */
void fum_smoke_depth(const fum_smoke *smoke, const fum_way *way, uint64_t shadow_sets, double out_depths[3]);

/* Nothing is seen through this optical depth. */
#define FUM_DARK_DEPTH 100.0

/* Fills the list with what the camera sees; false without memory. */
bool fum_smoke_listen(const fum_smoke *smoke, const fum_way *way, fum_heard_list *list);

#endif
