/* SPDX-License-Identifier: GPL-3.0-or-later */
/* The meter of blur. A smear has the mean optical depth that a particle has while the shutter is open and over the
 * aperture; what a camera gathers is the mean of transmittances, which is more. The meter looks along rays at times and
 * through places of the aperture, and compares the two in some pixels: for the picture as one, and as the mean of
 * several that have a part of the shutter and of the aperture each. */
#ifndef FUM_BILLBOARD_BLUR_METER_H
#define FUM_BILLBOARD_BLUR_METER_H

#include "octree/octree.h"
#include "scene/view.h"
#include "solid/solid.h"

enum { FUM_BLUR_MOST_SAMPLES = 64 };

/* Errors of the opacity of smeared pictures: root mean squares over pixels with smoke, relative to that of the opacity.
 */
typedef struct fum_blur_errors {
  double of[3]; /* of one picture, of 4, of 16 */
} fum_blur_errors;

/* `octree` of the particles that the camera sees; `view` is placed. */
int32_t fum_blur_meter_read(const fum_scene *scene, const fum_octree *octree, const fum_solids *solids,
                            const fum_camera *camera, const fum_view *view, fum_blur_errors *out_errors);

/* The least number of pictures with an error of at most `tolerance`, 1 to FUM_BLUR_MOST_SAMPLES. */
int32_t fum_blur_samples_needed(const fum_blur_errors *errors, double tolerance);

#endif
