/* SPDX-License-Identifier: GPL-3.0-or-later */
/* Where the camera sees particles while its shutter is open, and how far they are out of focus. What a camera does
 * meanwhile is done by the particles the other way round: all is in the space of the camera as it stands now. */
#ifndef FUM_LIGHTING_SMEARS_H
#define FUM_LIGHTING_SMEARS_H

#include "octree/octree.h"
#include "scene/view.h"

typedef struct fum_smear {
  float center[3]; /* middle of the path, camera space */
  float path[3];   /* from where the shutter opens to where it closes */
  float confusion; /* at the centre: factor on the aperture, whose corners are at 1, of its image at the particle's
                      depth, m; below 0 it is upside down */
} fum_smear;

typedef struct fum_smears {
  fum_smear *items;           /* [octree->count]; NULL: nothing is blurred */
  double confusion_per_depth; /* change of the confusion */
  double extent;              /* of the aperture: of what lies farthest from its centre */
  double aperture_deviation;  /* root of its second moments' mean */
  double worst; /* sigmas, or pixels where these are larger, by which what is seen of a particle is off from where it
                   stands now: the root mean square of the particle where that is most */
} fum_smears;

/* Does the camera see more than one instant from more than one point? */
bool fum_camera_blurs(const fum_camera *camera);

/* `view` is that of the camera, placed in the octree's space. */
int32_t fum_smears_find(const fum_scene *scene, const fum_octree *octree, const fum_camera *camera,
                        const fum_view *view, fum_smears *out_smears);
void fum_smears_free(fum_context *context, fum_smears *smears);

/* The confusion at `depth` metres behind the smear's centre. */
static inline double fum_smear_confusion(const fum_smears *smears, const fum_smear *smear, double depth) {
  return (double)smear->confusion + smears->confusion_per_depth * depth;
}

#endif
