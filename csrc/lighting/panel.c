/* SPDX-License-Identifier: GPL-3.0-or-later */
#include "lighting/panel.h"

enum { ELLIPSE_SIDES = 24 };

/* The light's outline on its plane, around the foot of the point's perpendicular and in units of its length, so that
 * what the point sees of it stands at (x, y, 1). */
typedef struct outline {
  int32_t count;
  double corners[ELLIPSE_SIDES][2];
} outline;

static outline find_outline(const fum_lamp *lamp, fum_vec3 to_middle, double ahead) {
  const bool is_ellipse = lamp->desc.area_shape == FUM_AREA_ELLIPSE;
  /* of 90 or 15 degrees */
  const double cosine = is_ellipse ? 0.96592582628906829 : 0.0, sine = is_ellipse ? 0.25881904510252076 : 1.0;
  const double scale = 1.0 / ahead;
  const double middle[2] = {scale * (double)fum_dot(to_middle, lamp->right),
                            scale * (double)fum_dot(to_middle, lamp->up)};
  const double half_size[2] = {0.5 * scale * (double)lamp->desc.area_size[0],
                               0.5 * scale * (double)lamp->desc.area_size[1]};
  /* the polygon has the ellipse's area */
  double x = is_ellipse ? sqrt(2.0 * FUM_PI / ELLIPSE_SIDES / sine) : 1.0, y = is_ellipse ? 0.0 : 1.0;
  outline o = {.count = is_ellipse ? ELLIPSE_SIDES : 4};
  for (int32_t i = 0; i < o.count; i++) {
    o.corners[i][0] = middle[0] + half_size[0] * x;
    o.corners[i][1] = middle[1] + half_size[1] * y;
    const double next_x = cosine * x - sine * y;
    y = cosine * y + sine * x;
    x = next_x;
  }
  return o;
}

/* Van Oosterom and Strackee 1983, The solid angle of a plane triangle. */
static double triangle_solid_angle(const double a[2], const double b[2], const double c[2]) {
  const double la = sqrt(1.0 + a[0] * a[0] + a[1] * a[1]), lb = sqrt(1.0 + b[0] * b[0] + b[1] * b[1]),
               lc = sqrt(1.0 + c[0] * c[0] + c[1] * c[1]);
  const double volume = (b[0] - a[0]) * (c[1] - a[1]) - (b[1] - a[1]) * (c[0] - a[0]);
  const double ab = 1.0 + a[0] * b[0] + a[1] * b[1], bc = 1.0 + b[0] * c[0] + b[1] * c[1],
               ca = 1.0 + c[0] * a[0] + c[1] * a[1];
  return 2.0 * atan2(volume, la * lb * lc + ab * lc + bc * la + ca * lb);
}

static double solid_angle(const outline *o) {
  double sum = 0.0;
  for (int32_t i = 2; i < o->count; i++)
    sum += triangle_solid_angle(o->corners[0], o->corners[i - 1], o->corners[i]);
  return sum;
}

/* What a plane that shines with fum_lamp_spread sends from within `radius` of the foot, per radian around it: the
 * integral of (limit - r) / (limit - half) r / (1 + r^2)^1.5. */
static double sector(double radius, double limit, double half) {
  const double root = sqrt(1.0 + radius * radius);
  return (limit * (1.0 - 1.0 / root) - log(radius + root) + radius / root) / (limit - half);
}

/* The integral of sector() over the angle, along a line that passes the foot at a distance, from place `from` to place
 * `to` of it: r^2 dangle = distance dplace. Gauss and Legendre's 6 points of asinh(place). */
static double sectors_along(double distance, double from, double to, double limit, double half) {
  static const double points[3] = {0.2386191860831969, 0.6612093864662645, 0.9324695142031521};
  static const double weights[3] = {0.4679139345726910, 0.3607615730481386, 0.1713244923791704};
  if (!(from < to)) return 0.0;
  const double middle = 0.5 * (asinh(to) + asinh(from)), reach = 0.5 * (asinh(to) - asinh(from));
  double sum = 0.0;
  for (int k = 0; k < 6; k++) {
    const double grown = exp(middle + (k % 2 == 0 ? reach : -reach) * points[k / 2]);
    const double place = 0.5 * (grown - 1.0 / grown), slope = 0.5 * (grown + 1.0 / grown);
    const double squared = distance * distance + place * place;
    if (squared > 0.0) sum += weights[k / 2] * slope * sector(sqrt(squared), limit, half) / squared;
  }
  return sum * reach * distance;
}

/* Light from between the foot and an edge; beyond `limit` no more of it comes. */
static double edge(const double a[2], const double b[2], double limit, double half) {
  const double length = hypot(b[0] - a[0], b[1] - a[1]);
  if (!(length > 0.0)) return 0.0;
  const double way[2] = {(b[0] - a[0]) / length, (b[1] - a[1]) / length};
  const double distance = a[0] * way[1] - a[1] * way[0];
  const double from = a[0] * way[0] + a[1] * way[1], to = from + length;
  const double reach = sqrt(fmax(0.0, limit * limit - distance * distance));
  const double first = fmin(fmax(from, -reach), reach), last = fmin(fmax(to, -reach), reach),
               middle = fmin(fmax(0.0, first), last);
  const double beyond = atan2(distance * length, distance * distance + from * to) -
                        atan2(distance * (last - first), distance * distance + first * last);
  return beyond * sector(limit, limit, half) + sectors_along(distance, first, middle, limit, half) +
         sectors_along(distance, middle, last, limit, half);
}

static double spread_light(const outline *o, double half) {
  double sum = 0.0;
  for (int32_t i = 0; i < o->count; i++)
    sum += edge(o->corners[i], o->corners[(i + 1) % o->count], tan(half), half);
  return fmax(0.0, sum);
}

float fum_panel_irradiance(const fum_lamp *lamp, fum_vec3 point) {
  const float *size = lamp->desc.area_size;
  const fum_vec3 to_middle = fum_sub(lamp->position, point);
  const float far_away = 12.0F; /* sizes: its middle stands for it within 0.2 %, if it shines to all sides alike */
  const float length = fum_length(to_middle), ahead = fum_dot(to_middle, lamp->back);
  const double half = 0.5 * (double)lamp->desc.area_spread;
  const bool is_even = half > 0.5 * FUM_PI - 1e-4; /* as fum_lamp_spread has it */
  if (!(ahead > 0.0F)) return 0.0F;
  if (is_even && length > far_away * fmaxf(size[0], size[1])) {
    const float shape = lamp->desc.area_shape == FUM_AREA_ELLIPSE ? (float)FUM_PI / 4.0F : 1.0F;
    return shape * size[0] * size[1] * ahead / (length * length * length);
  }
  const outline o = find_outline(lamp, to_middle, (double)ahead);
  return (float)(is_even ? solid_angle(&o) : spread_light(&o, half));
}
