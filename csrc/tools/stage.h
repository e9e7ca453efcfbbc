/* SPDX-License-Identifier: GPL-3.0-or-later */
/* A cloud put into a scene: lights around it and the camera before it. */
#ifndef FUM_TOOLS_STAGE_H
#define FUM_TOOLS_STAGE_H

#include "fumarole.h"
#include "tools/cloud.h"

/* A scene that holds the cloud. `*out_scene` may be set on failure too; destroy it. */
int32_t stage_create(fum_context *context, const cloud *c, fum_scene **out_scene);

/* A point light of the given brightness; with the wall of a cloud that has one. `position` in radii from the middle. */
int32_t stage_add_light(fum_scene *scene, const cloud *c, const double position[3], double brightness);

/* Position of light `index` on a ring around the cloud, above its middle: in radii from the middle. */
void stage_ring(int index, double out_position[3]);

/* The same with `count` lights on the ring that are as bright as one. */
int32_t stage_create_ring(fum_context *context, const cloud *c, int count, fum_scene **out_scene);

/* Where a position in radii from the middle is in the world. */
void stage_place(const cloud *c, const double position[3], double out_world[3]);

/* Looks at the cloud along y, so that it fills most of the height. */
fum_camera stage_camera(const cloud *c, int32_t width, int32_t height);

#endif
