/* SPDX-License-Identifier: GPL-3.0-or-later */
/* The camera, checked and turned into what drawing and the camera's rays need. */
#ifndef FUM_SCENE_VIEW_H
#define FUM_SCENE_VIEW_H

#include "base/context.h"
#include "base/vector.h"

typedef struct fum_view {
  int32_t type, width, height;
  double window[4], clip_start, clip_end;
  double local_from_camera[16]; /* local: relative to the scene's origin */
  double camera_from_local[16];
} fum_view;

int32_t fum_view_init(fum_context *context, const fum_camera *camera, fum_view *out_view);

/* Where a camera that moves is one frame before, or after. */
int32_t fum_view_init_moved(fum_context *context, const fum_camera *camera, bool is_next, fum_view *out_view);

/* Where it is `frames` later, -1..1: between where it is now and where it is one frame before or after. */
int32_t fum_view_init_at(fum_context *context, const fum_camera *camera, double frames, fum_view *out_view);

/* Moves the view to coordinates relative to `origin`. */
void fum_view_place(fum_view *view, const double origin[3]);

/* The ray through a point of the picture (in pixels, 0, 0 is its lower left corner): start at the camera and direction
 * with unit depth along the axis, so that its parameter is Blender's depth. In local space. */
void fum_view_ray(const fum_view *view, double x, double y, double out_start[3], double out_direction[3]);

/* Where a point is in the picture, in pixels; false if it isn't in front of the camera. */
bool fum_view_project(const fum_view *view, const double local[3], double out_px[2]);

/* Rectangle of the window that a sphere (camera space) may cover, within the window; all of it when the sphere is near
 * the camera. Empty (lower >= upper) when the sphere isn't in the frame. */
void fum_view_cover(const fum_view *view, const double center[3], double radius, float lower[2], float upper[2]);

/* Longer side of a pixel at unit depth, in an orthographic view at any. */
static inline double fum_view_pixel(const fum_view *view) {
  return fmax((view->window[1] - view->window[0]) / (double)view->width,
              (view->window[3] - view->window[2]) / (double)view->height);
}

/* The point on the ray through (u, v) of the window at a range: the distance along the ray, in an orthographic view the
 * depth. In local space. */
void fum_view_point(const fum_view *view, double u, double v, double range, double out_local[3]);

#endif
