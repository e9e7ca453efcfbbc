/* SPDX-License-Identifier: GPL-3.0-or-later */
#include "scene/aperture.h"

#include "base/vector.h"

static void find_polygon(const fum_camera *camera, fum_aperture *a) {
  const int32_t count = camera->aperture_blades;
  double moments = 0.0;
  a->corner_count = count;
  for (int32_t k = 0; k < count; k++) {
    const double angle = (double)camera->aperture_rotation + 2.0 * FUM_PI * k / count;
    a->corners[k][0] = cos(angle) / (double)camera->aperture_ratio;
    a->corners[k][1] = sin(angle);
    a->extent = fmax(a->extent, hypot(a->corners[k][0], a->corners[k][1]));
  }
  for (int32_t k = 0; k < count; k++) {
    const double *p = a->corners[k], *q = a->corners[(k + 1) % count];
    const double twice = p[0] * q[1] - q[0] * p[1]; /* the area between them and the centre */
    a->area += 0.5 * twice;
    for (int axis = 0; axis < 2; axis++)
      moments += twice / 12.0 * (p[axis] * p[axis] + p[axis] * q[axis] + q[axis] * q[axis]);
  }
  a->variance = 0.5 * moments / a->area;
}

void fum_aperture_find(const fum_camera *camera, fum_aperture *out_aperture) {
  const double half_width = 1.0 / (double)camera->aperture_ratio;
  fum_aperture a = {.half_width = half_width};
  if (camera->aperture_blades > 0) {
    find_polygon(camera, &a);
  } else {
    a.area = FUM_PI * half_width;
    a.extent = fmax(half_width, 1.0);
    a.variance = 0.125 * (half_width * half_width + 1.0);
  }
  *out_aperture = a;
}

bool fum_aperture_cut(const fum_aperture *aperture, double y, double out_ends[2]) {
  if (aperture->corner_count == 0) {
    if (!(fabs(y) < 1.0)) return false;
    out_ends[1] = aperture->half_width * sqrt(1.0 - y * y);
    out_ends[0] = -out_ends[1];
    return true;
  }
  out_ends[0] = INFINITY;
  out_ends[1] = -INFINITY;
  for (int32_t k = 0; k < aperture->corner_count; k++) {
    const double *p = aperture->corners[k], *q = aperture->corners[(k + 1) % aperture->corner_count];
    if ((p[1] <= y) == (q[1] <= y)) continue;
    const double x = p[0] + (q[0] - p[0]) * (y - p[1]) / (q[1] - p[1]);
    out_ends[0] = fmin(out_ends[0], x);
    out_ends[1] = fmax(out_ends[1], x);
  }
  return out_ends[0] < out_ends[1];
}
