/* SPDX-License-Identifier: GPL-3.0-or-later */
#include "scene/view.h"

#include <string.h>

enum { MAX_SIDE = 65536 };

void fum_camera_init(fum_camera *camera) {
  *camera = (fum_camera){.struct_size = sizeof *camera,
                         .window = {-1.0, 1.0, -1.0, 1.0},
                         .clip_start = 0.1,
                         .clip_end = 1000.0,
                         .width = 512,
                         .height = 512,
                         .focus_distance = 10.0,
                         .aperture_ratio = 1.0F};
  for (int i = 0; i < 4; i++)
    camera->world_from_camera[5 * i] = 1.0;
}

static int32_t check_blur(fum_context *context, const fum_camera *c) {
  if (!(c->shutter_open >= -1.0 && c->shutter_open <= c->shutter_close && c->shutter_close <= 1.0)) {
    return fum_fail(context, FUM_ERROR_ARGUMENT, "camera: a shutter from %g to %g frames is not within -1..1",
                    c->shutter_open, c->shutter_close);
  }
  if (!(c->aperture_radius >= 0.0 && isfinite(c->aperture_radius))) {
    return fum_fail(context, FUM_ERROR_ARGUMENT, "camera: aperture_radius is %g, expected at least 0",
                    c->aperture_radius);
  }
  if (!(c->focus_distance > 0.0 && isfinite(c->focus_distance))) {
    return fum_fail(context, FUM_ERROR_ARGUMENT, "camera: focus_distance is %g, expected above 0", c->focus_distance);
  }
  if (c->aperture_blades != 0 && (c->aperture_blades < 3 || c->aperture_blades > 64)) {
    return fum_fail(context, FUM_ERROR_ARGUMENT, "camera: aperture_blades is %d, expected 0 or 3..64",
                    (int)c->aperture_blades);
  }
  if (!isfinite(c->aperture_rotation)) {
    return fum_fail(context, FUM_ERROR_ARGUMENT, "camera: aperture_rotation is %g, expected a number",
                    (double)c->aperture_rotation);
  }
  if (!(c->aperture_ratio > 0.0F && isfinite(c->aperture_ratio))) {
    return fum_fail(context, FUM_ERROR_ARGUMENT, "camera: aperture_ratio is %g, expected above 0",
                    (double)c->aperture_ratio);
  }
  return FUM_OK;
}

static int32_t check(fum_context *context, const fum_camera *c) {
  if (c == NULL || c->struct_size < sizeof *c) {
    return fum_fail(context, FUM_ERROR_ARGUMENT, "camera: the description has no valid struct_size");
  }
  if (c->type != FUM_CAMERA_PERSPECTIVE && c->type != FUM_CAMERA_ORTHOGRAPHIC) {
    return fum_fail(context, FUM_ERROR_ARGUMENT, "camera: type %d is unknown", (int)c->type);
  }
  if (c->width < 1 || c->width > MAX_SIDE || c->height < 1 || c->height > MAX_SIDE) {
    return fum_fail(context, FUM_ERROR_ARGUMENT, "camera: a frame of %d x %d pixels is not within 1..%d a side",
                    (int)c->width, (int)c->height, (int)MAX_SIDE);
  }
  if (!fum_all_finite(c->world_from_camera, 16)) {
    return fum_fail(context, FUM_ERROR_ARGUMENT, "camera: the matrix is not finite");
  }
  if (!fum_all_finite(c->window, 4) || c->window[0] >= c->window[1] || c->window[2] >= c->window[3]) {
    return fum_fail(context, FUM_ERROR_ARGUMENT, "camera: the window %g %g %g %g is empty or not finite", c->window[0],
                    c->window[1], c->window[2], c->window[3]);
  }
  if (!(c->clip_start >= 0.0 && c->clip_start < c->clip_end && isfinite(c->clip_end))) {
    return fum_fail(context, FUM_ERROR_ARGUMENT, "camera: clip range %g..%g is not valid", c->clip_start, c->clip_end);
  }
  return check_blur(context, c);
}

/* Inverse of a matrix whose last row is 0 0 0 1, by cofactors. */
static bool invert(const double m[16], double out[16]) {
  const double c0 = m[5] * m[10] - m[6] * m[9], c1 = m[6] * m[8] - m[4] * m[10], c2 = m[4] * m[9] - m[5] * m[8];
  const double determinant = m[0] * c0 + m[1] * c1 + m[2] * c2;
  if (!(fabs(determinant) > 1e-12)) return false;
  const double s = 1.0 / determinant;
  const double rows[9] = {c0 * s, (m[2] * m[9] - m[1] * m[10]) * s, (m[1] * m[6] - m[2] * m[5]) * s,
                          c1 * s, (m[0] * m[10] - m[2] * m[8]) * s, (m[2] * m[4] - m[0] * m[6]) * s,
                          c2 * s, (m[1] * m[8] - m[0] * m[9]) * s,  (m[0] * m[5] - m[1] * m[4]) * s};
  for (int r = 0; r < 3; r++) {
    const double *a = rows + 3 * r;
    for (int c = 0; c < 3; c++)
      out[4 * r + c] = a[c];
    out[4 * r + 3] = -(a[0] * m[3] + a[1] * m[7] + a[2] * m[11]);
  }
  memcpy(out + 12, (double[4]){0.0, 0.0, 0.0, 1.0}, 4 * sizeof *out);
  return true;
}

int32_t fum_view_init(fum_context *context, const fum_camera *camera, fum_view *out_view) {
  const int32_t status = check(context, camera);
  if (status != FUM_OK) return status;
  fum_view view = {.type = camera->type,
                   .width = camera->width,
                   .height = camera->height,
                   .clip_start = camera->clip_start,
                   .clip_end = camera->clip_end};
  memcpy(view.window, camera->window, sizeof view.window);
  memcpy(view.local_from_camera, camera->world_from_camera, sizeof view.local_from_camera);
  memcpy(view.local_from_camera + 12, (double[4]){0.0, 0.0, 0.0, 1.0}, 4 * sizeof(double));
  for (int column = 0; column < 3; column++) {
    double axis[3] = {0};
    (void)fum_matrix_axis(camera->world_from_camera, column, axis);
    for (int row = 0; row < 3; row++)
      view.local_from_camera[4 * row + column] = axis[row];
  }
  if (!invert(view.local_from_camera, view.camera_from_local)) {
    return fum_fail(context, FUM_ERROR_ARGUMENT, "camera: the matrix has no inverse");
  }
  *out_view = view;
  return FUM_OK;
}

int32_t fum_view_init_moved(fum_context *context, const fum_camera *camera, bool is_next, fum_view *out_view) {
  fum_camera moved = *camera;
  if (camera->moves != 0) {
    const double *matrix = is_next ? camera->next_world_from_camera : camera->previous_world_from_camera;
    memcpy(moved.world_from_camera, matrix, sizeof moved.world_from_camera);
    memcpy(moved.window, is_next ? camera->next_window : camera->previous_window, sizeof moved.window);
  }
  return fum_view_init(context, &moved, out_view);
}

/* Makes the axes of a matrix between two rotations perpendicular again, those of the view first. */
static void straighten(double m[16]) {
  const int order[3] = {2, 0, 1};
  for (int k = 0; k < 3; k++) {
    double axis[3];
    (void)fum_matrix_axis(m, order[k], axis);
    for (int j = 0; j < k; j++) {
      const double *other = m + order[j];
      const double along = axis[0] * other[0] + axis[1] * other[4] + axis[2] * other[8];
      for (int row = 0; row < 3; row++)
        axis[row] -= along * other[4 * row];
    }
    const double length = sqrt(axis[0] * axis[0] + axis[1] * axis[1] + axis[2] * axis[2]);
    for (int row = 0; row < 3; row++)
      m[4 * row + order[k]] = axis[row] / length;
  }
}

int32_t fum_view_init_at(fum_context *context, const fum_camera *camera, double frames, fum_view *out_view) {
  fum_view views[2];
  int32_t status = fum_view_init(context, camera, &views[0]);
  if (status == FUM_OK) status = fum_view_init_moved(context, camera, frames > 0.0, &views[1]);
  if (status != FUM_OK) return status;
  const double share = fabs(frames);
  fum_view view = views[0];
  for (int i = 0; i < 16; i++)
    view.local_from_camera[i] = (1.0 - share) * views[0].local_from_camera[i] + share * views[1].local_from_camera[i];
  for (int i = 0; i < 4; i++)
    view.window[i] = (1.0 - share) * views[0].window[i] + share * views[1].window[i];
  straighten(view.local_from_camera);
  if (!invert(view.local_from_camera, view.camera_from_local)) {
    return fum_fail(context, FUM_ERROR_ARGUMENT, "camera: it turns too far within a frame");
  }
  *out_view = view;
  return FUM_OK;
}

void fum_view_place(fum_view *view, const double origin[3]) {
  double *to_camera = view->camera_from_local;
  for (int row = 0; row < 3; row++) {
    view->local_from_camera[4 * row + 3] -= origin[row];
    const double *m = to_camera + 4 * row;
    to_camera[4 * row + 3] += m[0] * origin[0] + m[1] * origin[1] + m[2] * origin[2];
  }
}

void fum_view_ray(const fum_view *view, double x, double y, double out_start[3], double out_direction[3]) {
  const double *w = view->window, *m = view->local_from_camera;
  const double u = w[0] + (w[1] - w[0]) * x / (double)view->width;
  const double v = w[2] + (w[3] - w[2]) * y / (double)view->height;
  const bool is_perspective = view->type == FUM_CAMERA_PERSPECTIVE;
  for (int row = 0; row < 3; row++) {
    const double *r = m + 4 * row;
    const double across = r[0] * u + r[1] * v;
    out_start[row] = r[3] + (is_perspective ? 0.0 : across);
    out_direction[row] = -r[2] + (is_perspective ? across : 0.0);
  }
}

bool fum_view_project(const fum_view *view, const double local[3], double out_px[2]) {
  double camera[3];
  fum_transform_point(view->camera_from_local, local, camera);
  const bool is_perspective = view->type == FUM_CAMERA_PERSPECTIVE;
  const double *w = view->window, scale = is_perspective ? -1.0 / camera[2] : 1.0;
  if (is_perspective && !(-camera[2] > 1e-6)) return false;
  out_px[0] = (camera[0] * scale - w[0]) / (w[1] - w[0]) * (double)view->width;
  out_px[1] = (camera[1] * scale - w[2]) / (w[3] - w[2]) * (double)view->height;
  return true;
}

/* No fmin and fmax: without their care for NaN they are calls, and this is asked for every particle and face. */
void fum_view_cover(const fum_view *view, const double center[3], double radius, float lower[2], float upper[2]) {
  const double depth = -center[2], near = 1.0 / (depth - radius), far = 1.0 / (depth + radius);
  const bool is_perspective = view->type == FUM_CAMERA_PERSPECTIVE, is_close = depth <= 1.01 * radius;
  for (int axis = 0; axis < 2; axis++) {
    const double *edges = view->window + 2 * axis;
    double low = center[axis] - radius, high = center[axis] + radius;
    if (is_perspective) {
      low = is_close ? edges[0] : low * (low < 0.0 ? near : far);
      high = is_close ? edges[1] : high * (high > 0.0 ? near : far);
    }
    lower[axis] = (float)(low > edges[0] ? low : edges[0]);
    upper[axis] = (float)(high < edges[1] ? high : edges[1]);
  }
}

void fum_view_point(const fum_view *view, double u, double v, double range, double out_local[3]) {
  double camera[3] = {u, v, -range};
  if (view->type == FUM_CAMERA_PERSPECTIVE) {
    const double scale = range / sqrt(1.0 + u * u + v * v);
    camera[0] = u * scale;
    camera[1] = v * scale;
    camera[2] = -scale;
  }
  fum_transform_point(view->local_from_camera, camera, out_local);
}
