/* SPDX-License-Identifier: GPL-3.0-or-later */
#include "lighting/emitter.h"

#include <string.h>

static const float GOLDEN_ANGLE = 2.39996323F;

static fum_vec3 to_float(const double v[3]) {
  return (fum_vec3){(float)v[0], (float)v[1], (float)v[2]};
}

/* Rows of the inverse of the matrix's linear part, by cofactors. */
static void invert_linear(const double m[16], fum_vec3 rows[3]) {
  const double a = m[0], b = m[1], c = m[2], d = m[4], e = m[5], f = m[6], g = m[8], h = m[9], i = m[10];
  const double determinant = a * (e * i - f * h) - b * (d * i - f * g) + c * (d * h - e * g);
  const double s = determinant != 0.0 ? 1.0 / determinant : 0.0;
  rows[0] = to_float((double[3]){s * (e * i - f * h), s * (c * h - b * i), s * (b * f - c * e)});
  rows[1] = to_float((double[3]){s * (f * g - d * i), s * (a * i - c * g), s * (c * d - a * f)});
  rows[2] = to_float((double[3]){s * (d * h - e * g), s * (b * g - a * h), s * (a * e - b * d)});
}

/* Distance of the nearest point of the box. */
static double box_distance(fum_vec3 p, const float bounds[6]) {
  const float c[3] = {p.x, p.y, p.z};
  double squared = 0.0;
  for (int axis = 0; axis < 3; axis++) {
    const double below = (double)bounds[axis] - (double)c[axis], above = (double)c[axis] - (double)bounds[3 + axis];
    const double gap = fmax(0.0, fmax(below, above));
    squared += gap * gap;
  }
  return sqrt(squared);
}

/* Largest angular radius at which any receiver sees the light. */
static double angular_radius(const fum_lamp *lamp, const float bounds[6]) {
  const fum_light_desc *d = &lamp->desc;
  if (d->type == FUM_LIGHT_SUN) return 0.5 * (double)d->sun_angle;
  const double radius =
      d->type == FUM_LIGHT_AREA ? 0.5 * hypot((double)d->area_size[0], (double)d->area_size[1]) : (double)d->radius;
  return atan2(radius, box_distance(lamp->position, bounds));
}

void fum_lamp_init(const fum_light_desc *desc, const double origin[3], const float bounds[6], int32_t max_samples,
                   fum_lamp *out_lamp) {
  *out_lamp = (fum_lamp){.desc = *desc};
  memcpy(out_lamp->origin, origin, sizeof out_lamp->origin);
  memcpy(out_lamp->color, desc->intensity, sizeof out_lamp->color);
  const double *m = desc->world_from_light;
  out_lamp->position = to_float((double[3]){m[3] - origin[0], m[7] - origin[1], m[11] - origin[2]});
  double axis[3];
  if (fum_matrix_axis(m, 0, axis)) out_lamp->right = to_float(axis);
  if (fum_matrix_axis(m, 1, axis)) out_lamp->up = to_float(axis);
  if (fum_matrix_axis(m, 2, axis)) out_lamp->back = to_float(axis);
  invert_linear(m, out_lamp->spot_rows);
  const double one_sample_degrees = 2.0;
  const double ratio = angular_radius(out_lamp, bounds) * 180.0 / FUM_PI / one_sample_degrees;
  const double wanted = ceil(ratio * ratio);
  out_lamp->sample_count = wanted < 1.0 ? 1 : wanted < (double)max_samples ? (int32_t)wanted : max_samples;
}

/* Fraction of a sequence that fills 0..1 evenly: radical inverse in base 2. */
static float van_der_corput(uint32_t index) {
  uint32_t bits = index;
  bits = bits << 16 | bits >> 16;
  bits = (bits & 0x00ff00ffU) << 8 | (bits & 0xff00ff00U) >> 8;
  bits = (bits & 0x0f0f0f0fU) << 4 | (bits & 0xf0f0f0f0U) >> 4;
  bits = (bits & 0x33333333U) << 2 | (bits & 0xccccccccU) >> 2;
  bits = (bits & 0x55555555U) << 1 | (bits & 0xaaaaaaaaU) >> 1;
  return (float)((double)bits * 0x1p-32);
}

/* Point of a sunflower spiral over the unit disc. */
static void disc_point(int32_t index, int32_t count, float out[2]) {
  const float radius = count > 1 ? sqrtf(((float)index + 0.5F) / (float)count) : 0.0F;
  const float angle = GOLDEN_ANGLE * (float)index;
  out[0] = radius * cosf(angle);
  out[1] = radius * sinf(angle);
}

/* Point of a fixed cloud that looks like an evenly filled unit disc from every side, so that the samples of a point
 * light stay where they are whoever looks. In three dimensions that density is 1 / sqrt(1 - r^2); with r = sin(t) its
 * distribution function is (2 t - sin 2 t) / pi. */
static fum_vec3 ball_point(int32_t index, int32_t count) {
  if (count == 1) return (fum_vec3){0};
  const float z = 1.0F - 2.0F * ((float)index + 0.5F) / (float)count;
  const float across = sqrtf(fmaxf(0.0F, 1.0F - z * z)), angle = GOLDEN_ANGLE * (float)index;
  const double share = (double)van_der_corput((uint32_t)index) + 0.5 / (double)count;
  double t = cbrt(0.75 * FUM_PI * share); /* right near 0; three steps of Newton's leave 3e-11 anywhere */
  for (int step = 0; step < 3; step++) {
    const double sine = sin(t);
    t -= (2.0 * t - 2.0 * sine * cos(t) - FUM_PI * share) / (4.0 * sine * sine);
  }
  const float radius = (float)sin(t);
  return (fum_vec3){radius * across * cosf(angle), radius * across * sinf(angle), radius * z};
}

static fum_vec3 normalized(fum_vec3 v) {
  const float length = fum_length(v);
  return length > 0.0F ? fum_scaled(v, 1.0F / length) : (fum_vec3){0.0F, 0.0F, 1.0F};
}

fum_emitter fum_lamp_sample(const fum_lamp *lamp, int32_t index) {
  const fum_light_desc *d = &lamp->desc;
  const int32_t count = lamp->sample_count;
  fum_emitter emitter = {.position = lamp->position};
  float uv[2];
  if (d->type == FUM_LIGHT_ENVIRONMENT) {
    emitter.is_directional = true;
    emitter.direction = lamp->environment->parts[index].direction;
  } else if (d->type == FUM_LIGHT_SUN) {
    disc_point(index, count, uv);
    const float radius = tanf(0.5F * fminf(d->sun_angle, 3.0F));
    emitter.is_directional = true;
    emitter.direction = normalized(fum_mad(lamp->right, uv[0] * radius, fum_mad(lamp->up, uv[1] * radius, lamp->back)));
  } else if (d->type == FUM_LIGHT_AREA) {
    if (d->area_shape == FUM_AREA_ELLIPSE) {
      disc_point(index, count, uv);
    } else { /* rank-1 lattice of the golden ratio over [-1, 1]^2 */
      const double turn = (double)index * 0.61803398874989485 + 0.5;
      uv[0] = 2.0F * ((float)index + 0.5F) / (float)count - 1.0F;
      uv[1] = 2.0F * (float)(turn - floor(turn)) - 1.0F;
    }
    emitter.position = fum_mad(lamp->right, 0.5F * uv[0] * d->area_size[0],
                               fum_mad(lamp->up, 0.5F * uv[1] * d->area_size[1], lamp->position));
  } else {
    emitter.position = fum_mad(ball_point(index, count), d->radius, lamp->position);
  }
  return emitter;
}

/* Solid angle of a small patch that shows `area` at the distance, as of a disc that faces the receiver: right far away,
 * and bounded by a half space nearby. */
static float solid_angle(float area, float distance_squared) {
  const float x = area / ((float)FUM_PI * fmaxf(distance_squared, 1e-30F));
  /* 1 - 1 / sqrt(1 + x) without cancellation */
  const float root = sqrtf(1.0F + x);
  return 2.0F * (float)FUM_PI * x / (root * (1.0F + root));
}

static float spot_factor(const fum_lamp *lamp, fum_vec3 direction) {
  const fum_light_desc *d = &lamp->desc;
  const fum_vec3 local =
      normalized((fum_vec3){fum_dot(lamp->spot_rows[0], direction), fum_dot(lamp->spot_rows[1], direction),
                            fum_dot(lamp->spot_rows[2], direction)});
  const float cosine = -local.z, edge = cosf(0.5F * d->spot_angle);
  const float soft = (1.0F - edge) * d->spot_blend;
  float t = soft > 0.0F ? (cosine - edge) / soft : (cosine >= edge ? 1.0F : 0.0F);
  t = t < 0.0F ? 0.0F : t > 1.0F ? 1.0F : t;
  const float smooth = t * t * (3.0F - 2.0F * t);
  return d->spot_cosine != 0 ? smooth * fmaxf(cosine, 0.0F) : smooth;
}

float fum_lamp_spread(const fum_lamp *lamp, float cosine) {
  const double half = 0.5 * (double)lamp->desc.area_spread;
  if (half > FUM_PI / 2.0 - 1e-4) return 1.0F;
  const double tangent = sqrt(fmax(0.0, 1.0 - (double)cosine * (double)cosine)) / (double)cosine;
  return (float)(fmax(0.0, tan(half) - tangent) / (tan(half) - half));
}

/* Mean cosine of the sun's samples, evenly spread over a disc of radius tan(angle / 2) at unit distance: the irradiance
 * that a sun is given by is that of a plane facing it. */
static float sun_mean_cosine(const fum_lamp *lamp) {
  const double half = 0.5 * (double)fminf(lamp->desc.sun_angle, 3.0F);
  if (lamp->sample_count == 1 || half < 1e-3) return 1.0F;
  const double tangent = tan(half);
  return (float)(2.0 * (1.0 / cos(half) - 1.0) / (tangent * tangent));
}

float fum_emitter_irradiance(const fum_lamp *lamp, const fum_emitter *emitter, fum_vec3 point) {
  const fum_light_desc *d = &lamp->desc;
  const float share = 1.0F / (float)lamp->sample_count;
  if (d->type == FUM_LIGHT_SUN) return share / sun_mean_cosine(lamp);
  const fum_vec3 from_light = fum_sub(point, emitter->position);
  const float distance_squared = fum_dot(from_light, from_light);
  if (d->type == FUM_LIGHT_AREA) {
    const float cosine = -fum_dot(normalized(from_light), lamp->back);
    if (!(cosine > 0.0F)) return 0.0F;
    const float shape = d->area_shape == FUM_AREA_ELLIPSE ? (float)(FUM_PI / 4.0) : 1.0F;
    const float patch = shape * d->area_size[0] * d->area_size[1] * share;
    return fum_lamp_spread(lamp, cosine) * solid_angle(patch * cosine, distance_squared);
  }
  /* A disc of radiance I / (pi r^2) that faces the receiver; for r = 0 that is I / d^2. */
  float factor = 0.0F;
  if (d->radius > 0.0F) {
    const fum_vec3 to_centre = fum_sub(point, lamp->position);
    const float area = (float)FUM_PI * d->radius * d->radius;
    factor = share * solid_angle(area, fum_dot(to_centre, to_centre)) / area;
  } else {
    factor = share / fmaxf(distance_squared, 1e-30F);
  }
  return d->type == FUM_LIGHT_SPOT ? factor * spot_factor(lamp, normalized(from_light)) : factor;
}

/* Of a light without a size, which sends alike to all sides. */
static void find_plainly(const float *const places[3], fum_vec3 light, int64_t count, float *restrict out) {
  const float *restrict x = places[0], *restrict y = places[1], *restrict z = places[2];
  for (int64_t k = 0; k < count; k++) {
    const fum_vec3 way = {x[k] - light.x, y[k] - light.y, z[k] - light.z};
    out[k] = 1.0F / fum_max(fum_dot(way, way), 1e-30F);
  }
}

void fum_emitter_irradiances(const fum_lamp *lamp, const fum_emitter *emitter, const float *const places[3],
                             int64_t count, float *out_irradiances) {
  if (lamp->desc.type == FUM_LIGHT_POINT && !(lamp->desc.radius > 0.0F)) {
    find_plainly(places, emitter->position, count, out_irradiances);
    return;
  }
  for (int64_t k = 0; k < count; k++)
    out_irradiances[k] = fum_emitter_irradiance(lamp, emitter, (fum_vec3){places[0][k], places[1][k], places[2][k]});
}
