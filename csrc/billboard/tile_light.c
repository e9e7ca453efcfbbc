/* SPDX-License-Identifier: GPL-3.0-or-later */
#include "billboard/tile_light.h"

#include "lighting/inscatter.h"

#include <string.h>

/* Rows that a tile can see of a face: samples are at least a pixel apart, and cubic interpolation takes two beyond. */
enum { MAX_ROWS = FUM_TILE + 8 };

/* Where a tile's columns or rows lie between samples. */
typedef struct taps {
  int32_t first[FUM_TILE];
  float weights[4][FUM_TILE];
} taps;

/* Catmull and Rom 1974: cubic, through the samples. */
static void find_taps(const float *places, float origin, float spacing, taps *out) {
  for (int32_t i = 0; i < FUM_TILE; i++) {
    const float at = (places[i] - origin) / spacing, whole = floorf(at), f = at - whole;
    out->first[i] = (int32_t)whole - 1;
    out->weights[0][i] = f * (-0.5F + f * (1.0F - 0.5F * f));
    out->weights[1][i] = 1.0F + f * f * (-2.5F + 1.5F * f);
    out->weights[2][i] = f * (0.5F + f * (2.0F - 1.5F * f));
    out->weights[3][i] = f * f * (-0.5F + 0.5F * f);
  }
}

static int32_t clamp_index(int32_t i, int32_t count) { return i < 0 ? 0 : i >= count ? count - 1 : i; }

/* Values of a face at the tile's pixels. */
static void interpolate(const fum_lattice_face *face, const float *values, const float *u, const float *v, float *out) {
  taps across, up;
  find_taps(u, face->origin[0], face->spacing[0], &across);
  find_taps(v, face->origin[1], face->spacing[1], &up);
  const int32_t first_row = up.first[0], row_count = up.first[FUM_TILE - 1] + 4 - first_row;
  float rows[MAX_ROWS][FUM_TILE];
  for (int32_t r = 0; r < row_count && r < MAX_ROWS; r++) {
    const float *row = values + face->first + (int64_t)clamp_index(first_row + r, face->rows) * face->columns;
    for (int32_t x = 0; x < FUM_TILE; x++) {
      float sum = 0.0F;
      for (int32_t k = 0; k < 4; k++) sum += across.weights[k][x] * row[clamp_index(across.first[x] + k, face->columns)];
      rows[r][x] = sum;
    }
  }
  for (int32_t y = 0; y < FUM_TILE; y++) {
    const int32_t base = up.first[y] - first_row;
    for (int32_t x = 0; x < FUM_TILE; x++) {
      float sum = 0.0F;
      for (int32_t k = 0; k < 4; k++) sum += up.weights[k][y] * rows[base + k][x];
      out[y * FUM_TILE + x] = sum;
    }
  }
}

/* The face's own samples, or those of the face beside it when there is no smoke near it. */
static const fum_lattice_face *face_or(const fum_lattice *lattice, int32_t face, int32_t other) {
  return lattice->faces[face].columns > 0 ? &lattice->faces[face] : &lattice->faces[other];
}

static void interpolate_depth(const fum_light_grid *grid, int32_t light, int32_t face, int32_t other, float *out) {
  const fum_lattice *lattice = grid->job->lattice;
  const fum_lattice_face *from = face_or(lattice, face, other);
  if (from->columns == 0) {
    memset(out, 0, FUM_TILE_PIXELS * sizeof *out);
    return;
  }
  interpolate(from, lattice->depths + light * lattice->sample_count, grid->u, grid->v, out);
  for (int32_t i = 0; i < FUM_TILE_PIXELS; i++) out[i] = fmaxf(out[i], 0.0F);
}

/* Mean of the two faces, for what isn't integrated across the slab. */
static void interpolate_middle(const fum_light_grid *grid, const float *values, int32_t light, int32_t slab, float *out) {
  const fum_lattice *lattice = grid->job->lattice;
  const fum_lattice_face *begin = face_or(lattice, slab, slab + 1), *end = face_or(lattice, slab + 1, slab);
  float other[FUM_TILE_PIXELS];
  memset(out, 0, FUM_TILE_PIXELS * sizeof *out);
  if (begin->columns == 0) return;
  interpolate(begin, values + light * lattice->sample_count, grid->u, grid->v, out);
  interpolate(end, values + light * lattice->sample_count, grid->u, grid->v, other);
  for (int32_t i = 0; i < FUM_TILE_PIXELS; i++) out[i] = 0.5F * (out[i] + other[i]);
}

/* Point of a pixel's ray in local space and the ray's direction. */
static fum_vec3 find_point(const fum_light_grid *grid, int32_t pixel, float range, fum_vec3 *out_direction) {
  const fum_view *view = grid->job->view;
  const double *m = view->local_from_camera;
  const double u = (double)grid->u[pixel % FUM_TILE], v = (double)grid->v[pixel / FUM_TILE];
  const bool is_perspective = view->type == FUM_CAMERA_PERSPECTIVE;
  const double scale = (double)range * (double)grid->inverse_length[pixel];
  const double c[3] = {is_perspective ? u * scale : u, is_perspective ? v * scale : v, is_perspective ? -scale : -(double)range};
  double p[3], d[3];
  fum_transform_point(m, c, p);
  for (int row = 0; row < 3; row++) {
    const double across = is_perspective ? m[4 * row] * u + m[4 * row + 1] * v : 0.0;
    d[row] = (across - m[4 * row + 2]) * (double)grid->inverse_length[pixel];
  }
  *out_direction = (fum_vec3){(float)d[0], (float)d[1], (float)d[2]};
  return (fum_vec3){(float)p[0], (float)p[1], (float)p[2]};
}

/* Where a solid's shadow ends between samples, each pixel asks for itself. */
static float find_visible(const fum_tile_job *job, float interpolated, fum_vec3 point, fum_vec3 to_light, float distance) {
  const float blocked = 1.0F - job->solid_shadow_intensity, slack = 1e-3F;
  if (interpolated > 1.0F - slack) return 1.0F;
  if (interpolated < blocked + slack && interpolated > blocked - slack) return blocked;
  return fum_solids_occlude(job->solids, point, to_light, distance) ? blocked : 1.0F;
}

void fum_tile_light_slab(const fum_light_grid *grid, int32_t light, int32_t slab_index, const float *slab,
                         const float *front, float *depths, fum_slab_light *out_light) {
  const fum_tile_job *job = grid->job;
  const fum_lamp *lamp = &job->lamps[light];
  const fum_emitter center = {.is_directional = lamp->desc.type == FUM_LIGHT_SUN,
                              .position = lamp->position,
                              .direction = lamp->back};
  const bool is_area = lamp->desc.type == FUM_LIGHT_AREA, is_hard = lamp->sample_count == 1;
  const float first = job->slabs->faces[slab_index].range, last = job->slabs->faces[slab_index + 1].range;
  float visible[FUM_TILE_PIXELS], sent[FUM_TILE_PIXELS];
  interpolate_depth(grid, light, slab_index, slab_index + 1, depths);
  interpolate_depth(grid, light, slab_index + 1, slab_index, depths + FUM_TILE_PIXELS);
  if (job->lattice->visible != NULL) interpolate_middle(grid, job->lattice->visible, light, slab_index, visible);
  if (is_area) interpolate_middle(grid, job->lattice->sent, light, slab_index, sent);
  out_light->begin = depths;
  out_light->end = depths + FUM_TILE_PIXELS;
  out_light->color = lamp->desc.intensity;
  for (int32_t i = 0; i < FUM_TILE_PIXELS; i++) {
    const float dark = 12.0F, thin = 1e-7F;
    for (int32_t k = 0; k < job->class_count; k++) out_light->strengths[k][i] = 0.0F;
    if (!(slab[i] > thin && front[i] < dark)) continue;
    /* A solid may end the ray within the slab. */
    const float end = fmaxf(first, fminf(last, grid->far[i]));
    depths[FUM_TILE_PIXELS + i] = depths[i] + (depths[FUM_TILE_PIXELS + i] - depths[i]) * (end - first) / (last - first);
    fum_vec3 direction;
    const fum_vec3 point = find_point(grid, i, 0.5F * (first + end), &direction);
    const fum_vec3 line = center.is_directional ? center.direction : fum_sub(center.position, point);
    const float length = fum_length(line);
    const fum_vec3 to_light = fum_scaled(line, 1.0F / fmaxf(length, 1e-20F));
    float strength = is_area ? fmaxf(sent[i], 0.0F)
                             : fum_emitter_irradiance(lamp, &center, point) * (float)lamp->sample_count;
    if (job->lattice->visible != NULL) {
      const float distance = center.is_directional ? INFINITY : length;
      strength *= is_hard ? find_visible(job, visible[i], point, to_light, distance) : fminf(fmaxf(visible[i], 0.0F), 1.0F);
    }
    for (int32_t k = 0; k < job->class_count; k++) {
      out_light->strengths[k][i] = strength * fum_phase(job->anisotropies[k], fum_dot(to_light, direction));
    }
  }
}
