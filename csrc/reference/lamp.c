/* SPDX-License-Identifier: GPL-3.0-or-later */
#include "reference/lamp.h"

#include "base/vector.h"

static double dot(const double a[3], const double b[3]) {
  return a[0] * b[0] + a[1] * b[1] + a[2] * b[2];
}

/* Inverse of the matrix's linear part, by cofactors. */
static void invert_linear(const double m[16], double out[3][3]) {
  double determinant = 0.0;
  for (int row = 0; row < 3; row++) {
    for (int column = 0; column < 3; column++) {
      const int a = (row + 1) % 3, b = (row + 2) % 3, c = (column + 1) % 3, d = (column + 2) % 3;
      out[column][row] = m[4 * a + c] * m[4 * b + d] - m[4 * a + d] * m[4 * b + c];
    }
    determinant += m[4 * row] * out[0][row];
  }
  for (int i = 0; i < 9; i++)
    out[i / 3][i % 3] *= determinant != 0.0 ? 1.0 / determinant : 0.0;
}

static bool has_size(const fum_light_desc *d) {
  if (d->type == FUM_LIGHT_SUN) return d->sun_angle > 0.0F;
  if (d->type == FUM_LIGHT_ENVIRONMENT) return true;
  if (d->type == FUM_LIGHT_AREA) return d->area_size[0] > 0.0F || d->area_size[1] > 0.0F;
  return d->radius > 0.0F;
}

fum_reference_lamp fum_reference_lamp_make(const fum_light_desc *desc, const double origin[3], int32_t samples) {
  fum_reference_lamp lamp = {.desc = desc, .side = has_size(desc) ? (int32_t)ceil(sqrt((double)samples)) : 1};
  const double *m = desc->world_from_light;
  for (int axis = 0; axis < 3; axis++)
    lamp.position[axis] = m[4 * axis + 3] - origin[axis];
  (void)fum_matrix_axis(m, 0, lamp.right);
  (void)fum_matrix_axis(m, 1, lamp.up);
  (void)fum_matrix_axis(m, 2, lamp.back);
  invert_linear(m, lamp.local_from_world);
  return lamp;
}

/* Point of the unit disc for one of the unit square, areas kept (Shirley and Chiu 1997, "A low distortion map between
 * disk and square"). */
static void square_to_disc(double u, double v, double out[2]) {
  const double a = 2.0 * u - 1.0, b = 2.0 * v - 1.0;
  out[0] = out[1] = 0.0;
  if (a == 0.0 && b == 0.0) return;
  const bool is_wide = fabs(a) > fabs(b);
  const double radius = is_wide ? a : b;
  const double angle = is_wide ? FUM_PI / 4.0 * (b / a) : FUM_PI / 2.0 - FUM_PI / 4.0 * (a / b);
  out[0] = radius * cos(angle);
  out[1] = radius * sin(angle);
}

/* Sample of patch (i, j). No two share a row or a column, so that a straight edge passes them one by one; they lean to
 * alternate sides, so that what leaning changes in one patch is undone in the next. */
static void patch_sample(int32_t i, int32_t j, int32_t side, double out[2]) {
  const double step = 1.0 / (double)side;
  const double lean[2] = {((double)j + 0.5) * step - 0.5, ((double)i + 0.5) * step - 0.5};
  out[0] = ((double)i + 0.5 + (i % 2 == 0 ? lean[0] : -lean[0])) * step;
  out[1] = ((double)j + 0.5 + (j % 2 == 0 ? lean[1] : -lean[1])) * step;
}

/* Two unit vectors across the unit vector w. */
static void make_frame(const double w[3], double u[3], double v[3]) {
  const int axis = fabs(w[0]) < 0.6 ? 0 : 1;
  double squared = 0.0;
  for (int k = 0; k < 3; k++) {
    u[k] = (k == axis ? 1.0 : 0.0) - w[axis] * w[k];
    squared += u[k] * u[k];
  }
  for (int k = 0; k < 3; k++)
    u[k] /= sqrt(squared);
  for (int k = 0; k < 3; k++)
    v[k] = w[(k + 1) % 3] * u[(k + 2) % 3] - w[(k + 2) % 3] * u[(k + 1) % 3];
}

/* Irradiance is that of a plane which faces the sun: samples are spread evenly over a disc at unit distance. */
static void visit_sun(const fum_reference_lamp *lamp, fum_shine_fn visit, void *user) {
  const double radius = lamp->side > 1 ? tan(0.5 * fmin((double)lamp->desc->sun_angle, 3.0)) : 0.0;
  /* 2 (sqrt(1 + r^2) - 1) / r^2 */
  const double mean_cosine = 2.0 / (1.0 + sqrt(1.0 + radius * radius));
  const double share = 1.0 / ((double)lamp->side * (double)lamp->side);
  for (int32_t k = 0; k < lamp->side * lamp->side; k++) {
    double uv[2], disc[2];
    patch_sample(k / lamp->side, k % lamp->side, lamp->side, uv);
    square_to_disc(uv[0], uv[1], disc);
    const double length = sqrt(1.0 + radius * radius * (disc[0] * disc[0] + disc[1] * disc[1]));
    fum_shine shine = {.distance = INFINITY, .strength = share / mean_cosine, .tint = {1.0, 1.0, 1.0}};
    for (int axis = 0; axis < 3; axis++) {
      const double across = lamp->right[axis] * disc[0] + lamp->up[axis] * disc[1];
      shine.direction[axis] = (lamp->back[axis] + radius * across) / length;
    }
    visit(user, &shine);
  }
}

/* Share of a spot's intensity in a direction away from it. */
static double spot_factor(const fum_reference_lamp *lamp, const double direction[3]) {
  const fum_light_desc *d = lamp->desc;
  double local[3];
  for (int row = 0; row < 3; row++)
    local[row] = dot(lamp->local_from_world[row], direction);
  const double cosine = -local[2] / sqrt(dot(local, local)), edge = cos(0.5 * (double)d->spot_angle);
  const double soft = (1.0 - edge) * (double)d->spot_blend;
  const double ramp = soft > 0.0 ? (cosine - edge) / soft : (cosine >= edge ? 1.0 : 0.0);
  const double t = fmin(fmax(ramp, 0.0), 1.0), smooth = t * t * (3.0 - 2.0 * t);
  return d->spot_cosine != 0 ? smooth * fmax(cosine, 0.0) : smooth;
}

/* Point and spot lights are discs of radiance I / (pi r^2) that face the point. They are divided into patches of the
 * same solid angle. */
static void visit_disc(const fum_reference_lamp *lamp, const double point[3], fum_shine_fn visit, void *user) {
  const double radius = (double)lamp->desc->radius;
  double w[3] = {0.0, 0.0, 1.0}, u[3], v[3];
  const double to_centre[3] = {lamp->position[0] - point[0], lamp->position[1] - point[1],
                               lamp->position[2] - point[2]};
  const double distance = sqrt(dot(to_centre, to_centre));
  for (int axis = 0; axis < 3 && distance > 0.0; axis++)
    w[axis] = to_centre[axis] / distance;
  make_frame(w, u, v);
  const double edge = hypot(distance, radius); /* distance of the disc's edge */
  double strength = 1.0 / fmax(distance * distance, 1e-30), one_minus_cosine = 0.0;
  if (lamp->side > 1 || radius > 0.0) {
    one_minus_cosine = radius / edge * (radius / (edge + distance));
    strength = 2.0 / (edge * (edge + distance)) / ((double)lamp->side * (double)lamp->side);
  }
  for (int32_t k = 0; k < lamp->side * lamp->side; k++) {
    double uv[2], disc[2];
    patch_sample(k / lamp->side, k % lamp->side, lamp->side, uv);
    square_to_disc(uv[0], uv[1], disc);
    const double squared = disc[0] * disc[0] + disc[1] * disc[1];
    const double cosine = 1.0 - squared * one_minus_cosine;
    const double across = sqrt(one_minus_cosine * (1.0 + cosine));
    fum_shine shine = {.distance = distance / cosine, .strength = strength, .tint = {1.0, 1.0, 1.0}};
    double away[3];
    for (int axis = 0; axis < 3; axis++) {
      shine.direction[axis] = w[axis] * cosine + across * (u[axis] * disc[0] + v[axis] * disc[1]);
      away[axis] = -shine.direction[axis];
    }
    if (lamp->desc->type == FUM_LIGHT_SPOT) shine.strength *= spot_factor(lamp, away);
    if (shine.strength > 0.0) visit(user, &shine);
  }
}

static double spread_factor(double spread, double cosine) {
  const double half = 0.5 * spread;
  if (half > FUM_PI / 2.0 - 1e-4) return 1.0;
  const double tangent = sqrt(fmax(0.0, 1.0 - cosine * cosine)) / cosine;
  return fmax(0.0, tan(half) - tangent) / (tan(half) - half);
}

/* An area light as one point sees it. */
typedef struct area_view {
  const fum_reference_lamp *lamp;
  const double *point;
  fum_shine_fn visit;
  void *user;
  double size[2], area;
} area_view;

enum { MAX_DIVISIONS = 10 };

/* One patch of the lamp's square: side length `step`, sample at (u, v), lower corner at (u0, v0). */
static void visit_patch(const area_view *a, double u0, double v0, double u, double v, double step, int divisions) {
  const fum_reference_lamp *lamp = a->lamp;
  double across[2] = {2.0 * u - 1.0, 2.0 * v - 1.0};
  if (lamp->desc->area_shape == FUM_AREA_ELLIPSE) square_to_disc(u, v, across);
  double way[3];
  for (int axis = 0; axis < 3; axis++) {
    const double offset = lamp->right[axis] * across[0] * a->size[0] + lamp->up[axis] * across[1] * a->size[1];
    way[axis] = lamp->position[axis] + 0.5 * offset - a->point[axis];
  }
  const double squared = fmax(dot(way, way), 1e-30), distance = sqrt(squared);
  if (divisions < MAX_DIVISIONS && 8.0 * step * fmax(a->size[0], a->size[1]) > distance) {
    const double half = 0.5 * step;
    for (int k = 0; k < 4; k++) {
      const double u1 = u0 + (k & 1) * half, v1 = v0 + (k >> 1) * half;
      visit_patch(a, u1, v1, u1 + 0.5 * half, v1 + 0.5 * half, half, divisions + 1);
    }
    return;
  }
  fum_shine shine = {.distance = distance, .tint = {1.0, 1.0, 1.0}};
  for (int axis = 0; axis < 3; axis++)
    shine.direction[axis] = way[axis] / distance;
  const double cosine = dot(shine.direction, lamp->back); /* of the way back, to the light's -Z */
  if (!(cosine > 0.0)) return;
  shine.strength = spread_factor((double)lamp->desc->area_spread, cosine) * a->area * step * step * cosine / squared;
  if (shine.strength > 0.0) a->visit(a->user, &shine);
}

static void visit_area(const fum_reference_lamp *lamp, const double point[3], fum_shine_fn visit, void *user) {
  const double size[2] = {(double)lamp->desc->area_size[0], (double)lamp->desc->area_size[1]};
  const double shape = lamp->desc->area_shape == FUM_AREA_ELLIPSE ? FUM_PI / 4.0 : 1.0;
  const area_view a = {lamp, point, visit, user, {size[0], size[1]}, shape * size[0] * size[1]};
  const double from_lamp[3] = {point[0] - lamp->position[0], point[1] - lamp->position[1],
                               point[2] - lamp->position[2]};
  if (!(a.area > 0.0) || !(dot(from_lamp, lamp->back) < 0.0)) return; /* shines to one side */
  const double step = 1.0 / (double)lamp->side;
  for (int32_t k = 0; k < lamp->side * lamp->side; k++) {
    double uv[2];
    patch_sample(k / lamp->side, k % lamp->side, lamp->side, uv);
    visit_patch(&a, (double)(k / lamp->side) * step, (double)(k % lamp->side) * step, uv[0], uv[1], step, 0);
  }
}

/* Turns a direction of the lamp's own into one of the world. */
static void turn(const fum_reference_lamp *lamp, const double own[3], double out[3]) {
  for (int row = 0; row < 3; row++)
    out[row] = lamp->right[row] * own[0] + lamp->up[row] * own[1] + lamp->back[row] * own[2];
}

/* White all around: patches of the same solid angle. */
static void divide_sphere(fum_reference_lamp *lamp) {
  for (int32_t k = 0; k < lamp->sky_count; k++) {
    fum_shine *shine = &lamp->sky[k];
    double uv[2];
    patch_sample(k / lamp->side, k % lamp->side, lamp->side, uv);
    const double z = 2.0 * uv[0] - 1.0, across = sqrt(1.0 - z * z), angle = 2.0 * FUM_PI * uv[1];
    *shine =
        (fum_shine){.distance = INFINITY, .strength = 4.0 * FUM_PI / (double)lamp->sky_count, .tint = {1.0, 1.0, 1.0}};
    turn(lamp, (double[3]){across * cos(angle), across * sin(angle), z}, shine->direction);
  }
}

/* Adds a pixel to a patch's shine: its direction is a sum yet. */
static void add_pixel(const fum_light_desc *d, int32_t x, int32_t y, fum_shine *shine) {
  const float *rgb = d->environment_pixels + 3 * ((int64_t)y * d->environment_width + x);
  const double low = FUM_PI * ((double)y / d->environment_height - 0.5);
  const double high = FUM_PI * ((double)(y + 1) / d->environment_height - 0.5);
  const double angle = 2.0 * FUM_PI / d->environment_width * (sin(high) - sin(low)), elevation = 0.5 * (low + high);
  const double azimuth = FUM_PI - 2.0 * FUM_PI * (x + 0.5) / d->environment_width;
  double weight = 0.0;
  for (int c = 0; c < 3; c++) {
    shine->tint[c] += angle * (double)rgb[c];
    weight += angle * (double)rgb[c] * (double)d->intensity[c];
  }
  shine->direction[0] += weight * cos(elevation) * cos(azimuth);
  shine->direction[1] += weight * cos(elevation) * sin(azimuth);
  shine->direction[2] += weight * sin(elevation);
}

/* Blocks of a picture's pixels; those that shine are kept. */
static void divide_picture(int32_t columns, int32_t rows, fum_reference_lamp *lamp) {
  const fum_light_desc *d = lamp->desc;
  int32_t count = 0;
  for (int32_t block = 0; block < columns * rows; block++) {
    const int64_t column = block % columns, row = block / columns;
    fum_shine shine = {.distance = INFINITY, .strength = 1.0};
    const int32_t x1 = (int32_t)((column + 1) * d->environment_width / columns);
    const int32_t y1 = (int32_t)((row + 1) * d->environment_height / rows);
    for (int32_t y = (int32_t)(row * d->environment_height / rows); y < y1; y++) {
      for (int32_t x = (int32_t)(column * d->environment_width / columns); x < x1; x++)
        add_pixel(d, x, y, &shine);
    }
    const double length = sqrt(dot(shine.direction, shine.direction));
    if (!(shine.tint[0] + shine.tint[1] + shine.tint[2] > 0.0)) continue;
    double own[3] = {0.0, 0.0, 1.0}; /* of a block that shines evenly from all around */
    for (int axis = 0; axis < 3 && length > 0.0; axis++)
      own[axis] = shine.direction[axis] / length;
    turn(lamp, own, shine.direction);
    lamp->sky[count++] = shine;
  }
  lamp->sky_count = count;
}

int32_t fum_reference_sky_find(fum_context *context, fum_reference_lamp *lamp) {
  const fum_light_desc *d = lamp->desc;
  if (d->type != FUM_LIGHT_ENVIRONMENT) return FUM_OK;
  const bool has_picture = d->environment_pixels != NULL;
  const int32_t columns = has_picture && d->environment_width < lamp->side ? d->environment_width : lamp->side;
  const int32_t rows = has_picture && d->environment_height < lamp->side ? d->environment_height : lamp->side;
  const int32_t status = fum_alloc(context, columns * rows, sizeof *lamp->sky, "reference", &lamp->sky);
  if (status != FUM_OK) return status;
  lamp->sky_count = columns * rows;
  if (has_picture) {
    divide_picture(columns, rows, lamp);
  } else {
    divide_sphere(lamp);
  }
  return FUM_OK;
}

int32_t fum_reference_lamp_samples(const fum_reference_lamp *lamp) {
  return lamp->desc->type == FUM_LIGHT_ENVIRONMENT ? lamp->sky_count : lamp->side * lamp->side;
}

void fum_reference_lamp_visit(const fum_reference_lamp *lamp, const double point[3], fum_shine_fn visit, void *user) {
  switch (lamp->desc->type) {
  case FUM_LIGHT_SUN:
    visit_sun(lamp, visit, user);
    break;
  case FUM_LIGHT_AREA:
    visit_area(lamp, point, visit, user);
    break;
  case FUM_LIGHT_ENVIRONMENT:
    for (int32_t k = 0; k < lamp->sky_count; k++)
      visit(user, &lamp->sky[k]);
    break;
  default:
    visit_disc(lamp, point, visit, user);
    break;
  }
}

/* Where a line enters and leaves a spot's cone: local z^2 = cos^2 |p|^2. Gives how many. */
static int cone_breaks(const fum_reference_lamp *lamp, const double to_light[3], const double direction[3],
                       double out[2]) {
  const double cosine = cos(0.5 * (double)lamp->desc->spot_angle), square = cosine * cosine;
  double p[3], u[3];
  for (int row = 0; row < 3; row++) {
    p[row] = -dot(lamp->local_from_world[row], to_light);
    u[row] = dot(lamp->local_from_world[row], direction);
  }
  const double a = u[2] * u[2] - square * dot(u, u), b = u[2] * p[2] - square * dot(u, p);
  const double c = p[2] * p[2] - square * dot(p, p), root = sqrt(fmax(b * b - a * c, 0.0));
  if (!(b * b > a * c) || a == 0.0) return 0;
  out[0] = (-b - root) / a;
  out[1] = (-b + root) / a;
  return 2;
}

int fum_reference_lamp_breaks(const fum_reference_lamp *lamp, const double start[3], const double direction[3],
                              double out_breaks[FUM_LAMP_BREAKS]) {
  if (lamp->desc->type == FUM_LIGHT_SUN || lamp->desc->type == FUM_LIGHT_ENVIRONMENT) return 0;
  const double d[3] = {lamp->position[0] - start[0], lamp->position[1] - start[1], lamp->position[2] - start[2]};
  int count = 0;
  out_breaks[count++] = dot(d, direction);
  if (lamp->desc->type == FUM_LIGHT_POINT) return count;
  if (lamp->desc->type == FUM_LIGHT_SPOT) count += cone_breaks(lamp, d, direction, out_breaks + count);
  const double facing = dot(direction, lamp->back), behind = dot(d, lamp->back), sine = 1.0 - facing * facing;
  if (sine > 1e-12) out_breaks[count++] = (dot(d, direction) - facing * behind) / sine;
  if (fabs(facing) > 1e-12) out_breaks[count++] = behind / facing;
  return count;
}
