/* SPDX-License-Identifier: GPL-3.0-or-later */
#include "lighting/panel.h"

static fum_vec3 cross(fum_vec3 a, fum_vec3 b) {
  return (fum_vec3){a.y * b.z - a.z * b.y, a.z * b.x - a.x * b.z, a.x * b.y - a.y * b.x};
}

/* Van Oosterom and Strackee 1983, The solid angle of a plane triangle. */
static float triangle_solid_angle(fum_vec3 a, fum_vec3 b, fum_vec3 c) {
  const float la = fum_length(a), lb = fum_length(b), lc = fum_length(c);
  const float volume = fabsf(fum_dot(a, cross(b, c)));
  const float rest = la * lb * lc + fum_dot(a, b) * lc + fum_dot(b, c) * la + fum_dot(c, a) * lb;
  return 2.0F * atan2f(volume, rest);
}

/* The light as the point sees it: corners are relative to the point. */
typedef struct panel {
  const fum_lamp *lamp;
  fum_vec3 center, right, up; /* right and up reach half across */
  bool is_spread;             /* it shines to all sides alike */
} panel;

static fum_vec3 corner(const panel *p, float across, float along) {
  return fum_mad(p->right, across, fum_mad(p->up, along, p->center));
}

/* Solid angle of a triangle, times the share that the light sends from its middle to the point. */
static float triangle(const panel *p, fum_vec3 a, fum_vec3 b, fum_vec3 c) {
  const float angle = triangle_solid_angle(a, b, c);
  if (p->is_spread) return angle;
  const fum_vec3 middle = fum_scaled(fum_mad(a, 1.0F, fum_mad(b, 1.0F, c)), 1.0F / 3.0F);
  const float length = fum_length(middle), cosine = fum_dot(middle, p->lamp->back) / fmaxf(length, 1e-20F);
  return cosine > 0.0F ? angle * fum_lamp_spread(p->lamp, cosine) : 0.0F;
}

static float rectangle(const panel *p) {
  const int cells = p->is_spread ? 1 : 6;
  const float step = 2.0F / (float)cells;
  float sum = 0.0F;
  for (int row = 0; row < cells; row++) {
    for (int column = 0; column < cells; column++) {
      const float x = -1.0F + step * (float)column, y = -1.0F + step * (float)row;
      const fum_vec3 a = corner(p, x, y), b = corner(p, x + step, y);
      const fum_vec3 c = corner(p, x + step, y + step), d = corner(p, x, y + step);
      sum += triangle(p, a, b, c) + triangle(p, a, c, d);
    }
  }
  return sum;
}

/* A fan of triangles with the ellipse's area; with rings where the light isn't the same to all sides. */
static float ellipse(const panel *p) {
  enum { SIDES = 24 };
  const int rings = p->is_spread ? 1 : 4;
  const double turn = 2.0 * FUM_PI / SIDES;
  const float cosine = (float)cos(turn), sine = (float)sin(turn), widen = (float)sqrt(turn / sin(turn));
  float sum = 0.0F;
  for (int ring = 0; ring < rings; ring++) {
    const float inner = widen * (float)ring / (float)rings, outer = widen * (float)(ring + 1) / (float)rings;
    float x = 1.0F, y = 0.0F;
    for (int side = 0; side < SIDES; side++) {
      const float next_x = cosine * x - sine * y, next_y = sine * x + cosine * y;
      const fum_vec3 a = corner(p, inner * x, inner * y), b = corner(p, outer * x, outer * y);
      const fum_vec3 c = corner(p, outer * next_x, outer * next_y), d = corner(p, inner * next_x, inner * next_y);
      sum += triangle(p, a, b, c) + (ring > 0 ? triangle(p, a, c, d) : 0.0F);
      x = next_x;
      y = next_y;
    }
  }
  return sum;
}

static bool is_inside(const panel *p, float across, float along) {
  const float *size = p->lamp->desc.area_size;
  const float x = 2.0F * across / size[0], y = 2.0F * along / size[1];
  return p->lamp->desc.area_shape == FUM_AREA_ELLIPSE ? x * x + y * y < 1.0F : fabsf(x) < 1.0F && fabsf(y) < 1.0F;
}

/* Where the light reaches farther than the cone in which it shines, all of that cone is gone through: rings around the
 * light's axis, `ahead` and aside of whose middle the point stands. */
static float cone(const panel *p, float ahead) {
  enum { RINGS = 12, STEPS = 48 };
  const float half = 0.5F * p->lamp->desc.area_spread;
  const float across = -fum_dot(p->center, p->lamp->right), along = -fum_dot(p->center, p->lamp->up);
  const float turn = 2.0F * (float)FUM_PI / STEPS, ring_angle = half / RINGS;
  const float cosine = cosf(turn), sine = sinf(turn);
  float sum = 0.0F;
  for (int ring = 0; ring < RINGS; ring++) {
    const float angle = ring_angle * ((float)ring + 0.5F), radius = ahead * tanf(angle);
    float x = radius, y = 0.0F;
    int inside = 0;
    for (int step = 0; step < STEPS; step++) {
      const float next = cosine * x - sine * y;
      y = sine * x + cosine * y;
      x = next;
      inside += is_inside(p, across + x, along + y);
    }
    sum += (float)inside * turn * ring_angle * sinf(angle) * fum_lamp_spread(p->lamp, cosf(angle));
  }
  return sum;
}

float fum_panel_irradiance(const fum_lamp *lamp, fum_vec3 point) {
  const float *size = lamp->desc.area_size;
  const panel p = {.lamp = lamp,
                   .center = fum_sub(lamp->position, point),
                   .right = fum_scaled(lamp->right, 0.5F * size[0]),
                   .up = fum_scaled(lamp->up, 0.5F * size[1]),
                   .is_spread = (double)lamp->desc.area_spread > FUM_PI - 2e-4};
  const float far_away = 12.0F; /* sizes: its middle stands for it within 0.1 % */
  const float length = fum_length(p.center), ahead = fum_dot(p.center, lamp->back);
  const bool is_ellipse = lamp->desc.area_shape == FUM_AREA_ELLIPSE;
  if (!(ahead > 0.0F)) return 0.0F;
  if (!p.is_spread && ahead * tanf(0.5F * lamp->desc.area_spread) < fmaxf(size[0], size[1])) return cone(&p, ahead);
  if (length <= far_away * fmaxf(size[0], size[1])) return is_ellipse ? ellipse(&p) : rectangle(&p);
  const float area = (is_ellipse ? (float)FUM_PI / 4.0F : 1.0F) * size[0] * size[1], cosine = ahead / length;
  return fum_lamp_spread(lamp, cosine) * area * cosine / (length * length);
}
