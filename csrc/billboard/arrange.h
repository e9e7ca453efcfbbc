/* SPDX-License-Identifier: GPL-3.0-or-later */
/* Particles, lit, become billboards in the order in which they are drawn. */
#ifndef FUM_BILLBOARD_ARRANGE_H
#define FUM_BILLBOARD_ARRANGE_H

#include "billboard/billboard.h"
#include "lighting/smears.h"

/* The order of the particles that can be seen: their ranks in `octree` (of all particles), farthest first; ties in the
 * order of the scene, that is by id. `footprint_sigmas` as in fum_frame; `smears` NULL: nothing is blurred. */
int32_t fum_arrange_order(const fum_scene *scene, const fum_octree *octree, const fum_view *view,
                          const fum_smears *smears, float footprint_sigmas, uint32_t **out_ranks, int64_t *out_count);

/* Billboards of the particles `ranks`; `light` [3 count of the octree] as fum_inscatter gives it. */
void fum_arrange_billboards(const fum_scene *scene, const fum_octree *octree, const fum_view *view, const float *light,
                            int64_t count, const uint32_t *ranks, fum_billboard *out_billboards);

/* How the maps of the particles `ranks` are seen. `out_maps` is zeroed, and freed also on failure. */
int32_t fum_arrange_maps(const fum_scene *scene, const fum_octree *octree, const fum_view *view, int64_t count,
                         const uint32_t *ranks, fum_billboard_maps *out_maps);
void fum_arrange_free_maps(fum_context *context, fum_billboard_maps *maps);

/* Puts billboards into the middle of their paths. */
void fum_arrange_smears(fum_context *context, const fum_smears *smears, int64_t count, const uint32_t *ranks,
                        fum_billboard *billboards, fum_billboard_smear *out_smears);

#endif
