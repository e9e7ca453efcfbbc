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

static int32_t clamp_index(int32_t i, int32_t count) {
  return i < 0 ? 0 : i >= count ? count - 1 : i;
}

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
      for (int32_t k = 0; k < 4; k++)
        sum += across.weights[k][x] * row[clamp_index(across.first[x] + k, face->columns)];
      rows[r][x] = sum;
    }
  }
  for (int32_t y = 0; y < FUM_TILE; y++) {
    const int32_t base = up.first[y] - first_row;
    for (int32_t x = 0; x < FUM_TILE; x++) {
      float sum = 0.0F;
      for (int32_t k = 0; k < 4; k++)
        sum += up.weights[k][y] * rows[base + k][x];
      out[y * FUM_TILE + x] = sum;
    }
  }
}

/* The face's own samples, or those of the face beside it when there is no smoke near it. */
static const fum_lattice_face *face_or(const fum_lattice *lattice, int32_t face, int32_t other) {
  return lattice->faces[face].columns > 0 ? &lattice->faces[face] : &lattice->faces[other];
}

/* What the lattice holds of a light's optical depth at one face of a slab. */
static void interpolate_depth(const fum_light_grid *grid, int32_t light, int32_t face, int32_t other, float *out) {
  const fum_lattice *lattice = grid->job->lattice;
  const fum_lattice_face *from = face_or(lattice, face, other);
  if (from->columns == 0) {
    memset(out, 0, FUM_TILE_PIXELS * sizeof *out);
    return;
  }
  interpolate(from, lattice->depths + light * lattice->sample_count, grid->u, grid->v, out);
  for (int32_t i = 0; i < FUM_TILE_PIXELS; i++)
    out[i] = fmaxf(out[i], 0.0F);
}

/* Mean of the two faces, for what isn't integrated across the slab. */
static void interpolate_middle(const fum_light_grid *grid, const float *values, int32_t light, int32_t slab,
                               float *out) {
  const fum_lattice *lattice = grid->job->lattice;
  const fum_lattice_face *begin = face_or(lattice, slab, slab + 1), *end = face_or(lattice, slab + 1, slab);
  float other[FUM_TILE_PIXELS];
  memset(out, 0, FUM_TILE_PIXELS * sizeof *out);
  if (begin->columns == 0) return;
  interpolate(begin, values + light * lattice->sample_count, grid->u, grid->v, out);
  interpolate(end, values + light * lattice->sample_count, grid->u, grid->v, other);
  for (int32_t i = 0; i < FUM_TILE_PIXELS; i++)
    out[i] = 0.5F * (out[i] + other[i]);
}

/* One light as seen from the part of a pixel's ray that lies in a slab. */
typedef struct span {
  const fum_light_grid *grid;
  const fum_lamp *lamp;
  fum_emitter center;
  fum_vec3 start, direction; /* of the ray at the slab's first face, local space */
  float begin, end;          /* of the smoke, m from there */
  float optical_depth;       /* of the smoke between them */
  float held[2];             /* what the lattice holds at begin and end */
  float nearest, beside;     /* where the ray passes the light, and how far from it */
  float visible, sent;       /* interpolated */
  bool is_area, is_per_metre;
} span;

/* Light at one point of a span. */
typedef struct lit {
  float depth;    /* optical depth to the light */
  float strength; /* irradiance past solids */
  fum_vec3 to_light;
} lit;

static void find_ray(const fum_light_grid *grid, int32_t pixel, float range, fum_vec3 *out_start,
                     fum_vec3 *out_direction) {
  const fum_view *view = grid->job->view;
  const double *m = view->local_from_camera;
  const double u = (double)grid->u[pixel % FUM_TILE], v = (double)grid->v[pixel / FUM_TILE];
  const bool is_perspective = view->type == FUM_CAMERA_PERSPECTIVE;
  double p[3], d[3];
  for (int row = 0; row < 3; row++) {
    const double across = m[4 * row] * u + m[4 * row + 1] * v;
    d[row] = ((is_perspective ? across : 0.0) - m[4 * row + 2]) * (double)grid->inverse_length[pixel];
    p[row] = m[4 * row + 3] + (is_perspective ? 0.0 : across) + d[row] * (double)range;
  }
  *out_start = (fum_vec3){(float)p[0], (float)p[1], (float)p[2]};
  *out_direction = (fum_vec3){(float)d[0], (float)d[1], (float)d[2]};
}

static void pass_light(span *s) {
  if (s->center.is_directional) return;
  const fum_vec3 line = fum_sub(s->center.position, s->start);
  s->nearest = fum_dot(line, s->direction);
  s->beside = fum_length(fum_mad(s->direction, -s->nearest, line));
}

static float depth_at(const span *s, float along) {
  const float share = s->end > s->begin ? (along - s->begin) / (s->end - s->begin) : 0.0F;
  const float held = s->held[0] + (s->held[1] - s->held[0]) * share;
  return s->is_per_metre ? held * hypotf(s->beside, along - s->nearest) : held;
}

/* Does a solid's shadow end between the samples around? */
static bool is_shadow_edge(const span *s) {
  const fum_tile_job *job = s->grid->job;
  const float blocked = 1.0F - job->solid_shadow_intensity, slack = 1e-3F;
  if (job->lattice->visible == NULL || s->lamp->sample_count > 1) return false;
  return s->visible < 1.0F - slack && fabsf(s->visible - blocked) > slack;
}

static lit light_at(const span *s, float along) {
  const fum_tile_job *job = s->grid->job;
  const fum_vec3 point = fum_mad(s->direction, along, s->start);
  const fum_vec3 line = s->center.is_directional ? s->center.direction : fum_sub(s->center.position, point);
  const float length = fum_length(line);
  lit l = {.depth = depth_at(s, along), .to_light = fum_scaled(line, 1.0F / fmaxf(length, 1e-20F))};
  l.strength = s->is_area ? fmaxf(s->sent, 0.0F)
                          : fum_emitter_irradiance(s->lamp, &s->center, point) * (float)s->lamp->sample_count;
  if (job->lattice->visible == NULL || !(l.strength > 0.0F)) return l;
  if (is_shadow_edge(s)) {
    const float distance = s->center.is_directional ? INFINITY : length;
    const bool is_blocked = fum_solids_occlude(job->solids, point, l.to_light, distance);
    l.strength *= is_blocked ? 1.0F - job->solid_shadow_intensity : 1.0F;
  } else {
    l.strength *= fminf(fmaxf(s->visible, 0.0F), 1.0F);
  }
  return l;
}

/* Does light change so much along the span that its middle doesn't stand for it? */
static bool is_uneven(const span *s) {
  if (is_shadow_edge(s)) return true;
  if (s->center.is_directional || s->is_area) return false;
  const float clear = fmaxf(0.0F, fmaxf(s->begin - s->nearest, s->nearest - s->end)), steep = 0.25F;
  if (s->end - s->begin > steep * hypotf(s->beside, clear)) return true;
  if (s->lamp->desc.type != FUM_LIGHT_SPOT) return false;
  float strengths[3];
  for (int k = 0; k < 3; k++) {
    const fum_vec3 point = fum_mad(s->direction, s->begin + (s->end - s->begin) * 0.5F * (float)k, s->start);
    strengths[k] = fum_emitter_irradiance(s->lamp, &s->center, point);
  }
  const float high = fmaxf(strengths[0], fmaxf(strengths[1], strengths[2]));
  return fminf(strengths[0], fminf(strengths[1], strengths[2])) < 0.8F * high;
}

enum { PARTS = 16 };

/* Points that share out the span evenly, or towards a nearby light evenly by angle (Kulla and Fajardo 2012, Importance
 * sampling techniques for path tracing in participating media), and the share of the span that each stands for. */
static void divide(const span *s, float *places, float *weights) {
  const float length = s->end - s->begin, beside = fmaxf(s->beside, 1e-3F * length);
  const float from = atanf((s->begin - s->nearest) / beside), to = atanf((s->end - s->nearest) / beside);
  const bool is_even = s->center.is_directional || s->is_area;
  for (int k = 0; k < PARTS; k++) {
    const float share = ((float)k + 0.5F) / (float)PARTS;
    const float slope = is_even ? 0.0F : tanf(from + (to - from) * share);
    places[k] = is_even ? s->begin + length * share : fminf(fmaxf(s->nearest + beside * slope, s->begin), s->end);
    weights[k] = is_even ? 1.0F / (float)PARTS : (to - from) / (float)PARTS * beside * (1.0F + slope * slope) / length;
  }
}

/* Integrates over the span, smoke in front included, and writes it down as light of one depth at both ends. */
static void light_parts(const span *s, int32_t pixel, float *depths, fum_slab_light *out_light) {
  const fum_tile_job *job = s->grid->job;
  float places[PARTS], weights[PARTS], least = INFINITY;
  lit parts[PARTS];
  divide(s, places, weights);
  for (int k = 0; k < PARTS; k++) {
    parts[k] = light_at(s, places[k]);
    parts[k].depth += s->optical_depth * (places[k] - s->begin) / (s->end - s->begin);
    least = fminf(least, parts[k].depth);
  }
  depths[pixel] = least;
  depths[FUM_TILE_PIXELS + pixel] = least - s->optical_depth; /* see add_light in tile_loop.h: the mean becomes 1 */
  for (int k = 0; k < PARTS; k++) {
    const float strength = weights[k] * parts[k].strength * expf(least - parts[k].depth);
    for (int32_t c = 0; c < job->class_count; c++) {
      out_light->strengths[c][pixel] +=
          strength * fum_phase(job->anisotropies[c], fum_dot(parts[k].to_light, s->direction));
    }
  }
}

static void light_middle(const span *s, int32_t pixel, float *depths, fum_slab_light *out_light) {
  const fum_tile_job *job = s->grid->job;
  const lit l = light_at(s, 0.5F * (s->begin + s->end));
  depths[pixel] = depth_at(s, s->begin);
  depths[FUM_TILE_PIXELS + pixel] = depth_at(s, s->end);
  for (int32_t c = 0; c < job->class_count; c++) {
    out_light->strengths[c][pixel] = l.strength * fum_phase(job->anisotropies[c], fum_dot(l.to_light, s->direction));
  }
}

void fum_tile_light_slab(const fum_light_grid *grid, int32_t light, int32_t slab_index, const float *slab,
                         const float *front, float *depths, fum_slab_light *out_light) {
  const fum_tile_job *job = grid->job;
  const fum_lamp *lamp = &job->lamps[light];
  span s = {.grid = grid,
            .lamp = lamp,
            .center = {.is_directional = lamp->desc.type == FUM_LIGHT_SUN,
                       .position = lamp->position,
                       .direction = lamp->back},
            .is_area = lamp->desc.type == FUM_LIGHT_AREA,
            .is_per_metre = fum_lattice_is_per_metre(lamp)};
  const float first = job->slabs->faces[slab_index].range, last = job->slabs->faces[slab_index + 1].range;
  float visible[FUM_TILE_PIXELS], sent[FUM_TILE_PIXELS];
  interpolate_depth(grid, light, slab_index, slab_index + 1, depths);
  interpolate_depth(grid, light, slab_index + 1, slab_index, depths + FUM_TILE_PIXELS);
  if (job->lattice->visible != NULL) interpolate_middle(grid, job->lattice->visible, light, slab_index, visible);
  if (s.is_area) interpolate_middle(grid, job->lattice->sent, light, slab_index, sent);
  out_light->begin = depths;
  out_light->end = depths + FUM_TILE_PIXELS;
  out_light->color = lamp->desc.intensity;
  for (int32_t i = 0; i < FUM_TILE_PIXELS; i++) {
    for (int32_t c = 0; c < job->class_count; c++)
      out_light->strengths[c][i] = 0.0F;
    if (!(slab[i] > FUM_TILE_THIN && front[i] < FUM_TILE_DARK)) continue;
    /* The near plane or a solid may begin or end the ray within the slab. */
    s.begin = fminf(last, fmaxf(first, grid->near[i])) - first;
    s.end = fmaxf(s.begin, fminf(last, grid->far[i]) - first);
    const float change = (depths[FUM_TILE_PIXELS + i] - depths[i]) / (last - first);
    s.held[0] = depths[i] + change * s.begin;
    s.held[1] = depths[i] + change * s.end;
    s.optical_depth = slab[i];
    if (job->lattice->visible != NULL) s.visible = visible[i];
    if (s.is_area) s.sent = sent[i];
    find_ray(grid, i, first, &s.start, &s.direction);
    pass_light(&s);
    (s.end > s.begin && is_uneven(&s) ? light_parts : light_middle)(&s, i, depths, out_light);
  }
}
