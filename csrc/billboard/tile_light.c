/* SPDX-License-Identifier: GPL-3.0-or-later */
#include "billboard/tile_light.h"

#include "base/vector.h"
#include "lighting/lookup.h"
#include "lighting/panel.h"
#include "lighting/phase.h"

#include <string.h>

/* Where a tile's columns or rows lie between samples. */
typedef struct taps {
  int32_t first[FUM_TILE];
  float weights[4][FUM_TILE];
} taps;

typedef void (*find_taps_fn)(const float *places, float origin, float spacing, taps *out);

/* Weights of the cubic B-splines (lattice_spline.h). */
static void find_spline_taps(const float *places, float origin, float spacing, taps *out) {
  const float sixth = 0.16666667F;
  for (int32_t i = 0; i < FUM_TILE; i++) {
    const float at = (places[i] - origin) / spacing, whole = floorf(at), f = at - whole, rest = 1.0F - f;
    out->first[i] = (int32_t)whole - 1;
    out->weights[0][i] = sixth * rest * rest * rest;
    out->weights[1][i] = sixth * (4.0F + f * f * (3.0F * f - 6.0F));
    out->weights[2][i] = sixth * (4.0F + rest * rest * (3.0F * rest - 6.0F));
    out->weights[3][i] = sixth * f * f * f;
  }
}

/* Catmull and Rom 1974: cubic, through the samples. For what has edges: it hears no sample beyond the four. */
static void find_cubic_taps(const float *places, float origin, float spacing, taps *out) {
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

static bool are_within(const taps *t, int32_t count) {
  int32_t least = t->first[0], most = t->first[0];
  for (int32_t i = 1; i < FUM_TILE; i++) {
    least = t->first[i] < least ? t->first[i] : least;
    most = t->first[i] > most ? t->first[i] : most;
  }
  return least >= 0 && most + 4 <= count;
}

/* Values of a row of samples at the tile's columns. `is_within`: all of them are between samples. */
static void interpolate_row(const taps *across, bool is_within, const float *row, int32_t count, float *out) {
  for (int32_t x = 0; x < FUM_TILE && is_within; x++) {
    const float *at = row + across->first[x];
    out[x] = across->weights[0][x] * at[0] + across->weights[1][x] * at[1] + across->weights[2][x] * at[2] +
             across->weights[3][x] * at[3];
  }
  for (int32_t x = 0; x < FUM_TILE && !is_within; x++) {
    out[x] = 0.0F;
    for (int32_t k = 0; k < 4; k++)
      out[x] += across->weights[k][x] * row[clamp_index(across->first[x] + k, count)];
  }
}

/* Values of a face at the tile's pixels. */
static void interpolate(const fum_lattice_face *face, find_taps_fn find_taps, const float *values, const float *u,
                        const float *v, float *out) {
  taps across, up;
  find_taps(u, face->origin[0], face->spacing[0], &across);
  find_taps(v, face->origin[1], face->spacing[1], &up);
  const bool is_within = are_within(&across, face->columns);
  float rows[4][FUM_TILE]; /* row r of the face is kept at r & 3 */
  int32_t next = up.first[0];
  for (int32_t y = 0; y < FUM_TILE; y++) {
    for (int32_t r = next > up.first[y] ? next : up.first[y]; r < up.first[y] + 4; r++) {
      const float *row = values + face->first + (int64_t)clamp_index(r, face->rows) * face->columns;
      interpolate_row(&across, is_within, row, face->columns, rows[r & 3]);
    }
    next = up.first[y] + 4;
    const float *const around[4] = {rows[up.first[y] & 3], rows[(up.first[y] + 1) & 3], rows[(up.first[y] + 2) & 3],
                                    rows[(up.first[y] + 3) & 3]};
    float along[FUM_TILE];
    for (int32_t x = 0; x < FUM_TILE; x++)
      along[x] = up.weights[0][y] * around[0][x] + up.weights[1][y] * around[1][x] + up.weights[2][y] * around[2][x] +
                 up.weights[3][y] * around[3][x];
    for (int32_t x = 0; x < FUM_TILE; x += FUM_BLOCK)
      memcpy(out + fum_tile_pixel(x, y), along + x, FUM_BLOCK * sizeof *out);
  }
}

/* What the lattice holds of a lamp's optical depth at a face; NaN where a sample that is needed isn't lit. */
static const float *held_on_face(const fum_light_grid *grid, int32_t lamp, int32_t face, fum_tile_held *held) {
  const fum_lattice *lattice = grid->job->lattice;
  float *values = held->values[face & 3];
  if (held->faces[face & 3] == face) return values;
  held->faces[face & 3] = face;
  if (face < 0 || face >= lattice->face_count || lattice->faces[face].columns == 0) {
    for (int32_t i = 0; i < FUM_TILE_PIXELS; i++)
      values[i] = NAN;
    return values;
  }
  interpolate(&lattice->faces[face], find_spline_taps, lattice->depths + lamp * lattice->sample_count, grid->columns,
              grid->rows, values);
  for (int32_t i = 0; i < FUM_TILE_PIXELS; i++)
    values[i] = values[i] < 0.0F ? 0.0F : values[i];
  return values;
}

/* The face's own samples, or those of the face beside it when there is no smoke near it. */
static const fum_lattice_face *face_or(const fum_lattice *lattice, int32_t face, int32_t other) {
  return lattice->faces[face].columns > 0 ? &lattice->faces[face] : &lattice->faces[other];
}

/* Mean of the two faces, for what isn't integrated across the slab. */
static void interpolate_middle(const fum_light_grid *grid, const float *values, int32_t lamp, int32_t slab,
                               float *out) {
  const fum_lattice *lattice = grid->job->lattice;
  const fum_lattice_face *begin = face_or(lattice, slab, slab + 1), *end = face_or(lattice, slab + 1, slab);
  float other[FUM_TILE_PIXELS];
  memset(out, 0, FUM_TILE_PIXELS * sizeof *out);
  if (begin->columns == 0) return;
  interpolate(begin, find_cubic_taps, values + lamp * lattice->sample_count, grid->columns, grid->rows, out);
  interpolate(end, find_cubic_taps, values + lamp * lattice->sample_count, grid->columns, grid->rows, other);
  for (int32_t i = 0; i < FUM_TILE_PIXELS; i++)
    out[i] = 0.5F * (out[i] + other[i]);
}

/* One light as seen from the part of a pixel's ray that lies in a slab. */
typedef struct span {
  const fum_light_grid *grid;
  const fum_lamp *lamp;
  int32_t slab;
  fum_emitter center;
  fum_vec3 start, direction; /* of the ray at the slab's first face, local space */
  float begin, end;          /* of the smoke, m from there */
  float optical_depth;       /* of the smoke between them */
  float lean;                /* extinction at the end less that at the begin, over their sum */
  float length, held[2];     /* of the slab; what the lattice holds on its faces... */
  float bow;                 /* ...and how it runs between them (fum_lattice_bow) */
  float nearest, beside;     /* where the ray passes the light, and how far from it */
  float visible;             /* interpolated */
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
  const double u = (double)grid->u[pixel], v = (double)grid->v[pixel];
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
  const float share = along / s->length;
  const float held = s->held[0] + (s->held[1] - s->held[0]) * share + s->bow * 4.0F * share * (1.0F - share);
  return fum_max(held, 0.0F) * (s->is_per_metre ? hypotf(s->beside, along - s->nearest) : 1.0F);
}

/* Does a solid's shadow end between the samples around? */
static bool is_shadow_edge(const span *s) {
  const fum_tile_job *job = s->grid->job;
  const float blocked = 1.0F - job->solid_shadow_intensity;
  if (job->lattice->visible == NULL) return false;
  return s->visible < 1.0F - FUM_SHADOW_SLACK && fabsf(s->visible - blocked) > FUM_SHADOW_SLACK;
}

enum { PARTS = 16 };

/* The point of the light that part `part` of a span asks for its shadow: all parts together ask for points all over the
 * light, neighbouring slabs for different ones. */
static fum_emitter shadow_sample(const span *s, int32_t part) {
  static const int32_t turns[PARTS] = {0, 8, 4, 12, 2, 10, 6, 14, 1, 9, 5, 13, 3, 11, 7, 15}; /* bits reversed */
  const int32_t count = s->lamp->sample_count;
  return count == 1 ? s->center : fum_lamp_sample(s->lamp, (turns[part] * count / PARTS + s->slab) % count);
}

/* Is a point of the ray in the shadow of a solid, seen from that part's point of the light? */
static bool is_shadowed(const span *s, fum_vec3 point, int32_t part) {
  const fum_emitter sample = shadow_sample(s, part);
  const uint64_t blockers = s->lamp->desc.shadow_sets;
  if (sample.is_directional)
    return fum_solids_occlude(s->grid->job->solids, blockers, point, sample.direction, INFINITY);
  const fum_vec3 line = fum_sub(sample.position, point);
  const float length = fum_length(line);
  const fum_vec3 direction = fum_scaled(line, 1.0F / fum_max(length, 1e-20F));
  return fum_solids_occlude(s->grid->job->solids, blockers, point, direction, length);
}

/* `part` of the span, of PARTS. */
static lit light_at(const span *s, float along, int32_t part) {
  const fum_tile_job *job = s->grid->job;
  const fum_vec3 point = fum_mad(s->direction, along, s->start);
  const fum_vec3 line = s->center.is_directional ? s->center.direction : fum_sub(s->center.position, point);
  const float length = fum_length(line);
  lit l = {.depth = depth_at(s, along), .to_light = fum_scaled(line, 1.0F / fum_max(length, 1e-20F))};
  l.strength = s->is_area ? fum_panel_irradiance(s->lamp, point)
                          : fum_emitter_irradiance(s->lamp, &s->center, point) * (float)s->lamp->sample_count;
  if (job->lattice->visible == NULL || !(l.strength > 0.0F)) return l;
  if (!is_shadow_edge(s)) {
    l.strength *= fum_min(fum_max(s->visible, 0.0F), 1.0F);
  } else if (is_shadowed(s, point, part)) {
    l.strength *= 1.0F - job->solid_shadow_intensity;
  }
  return l;
}

/* Does light change so much along the span that its middle doesn't stand for it? */
static bool is_uneven(const span *s) {
  if (is_shadow_edge(s)) return true;
  if (s->center.is_directional) return false;
  const float *size = s->lamp->desc.area_size, radius = s->is_area ? 0.5F * hypotf(size[0], size[1]) : 0.0F;
  const float clear = fum_max(0.0F, fum_max(s->begin - s->nearest, s->nearest - s->end));
  if (s->end - s->begin > FUM_STEEP * (hypotf(s->beside, clear) - radius)) return true;
  if (s->lamp->desc.type != FUM_LIGHT_SPOT) return false;
  float strengths[3];
  for (int k = 0; k < 3; k++) {
    const fum_vec3 point = fum_mad(s->direction, s->begin + (s->end - s->begin) * 0.5F * (float)k, s->start);
    strengths[k] = fum_emitter_irradiance(s->lamp, &s->center, point);
  }
  const float high = fum_max(strengths[0], fum_max(strengths[1], strengths[2]));
  return fum_min(strengths[0], fum_min(strengths[1], strengths[2])) < 0.8F * high;
}

/* Points that share out the span evenly, or towards a nearby light evenly by angle (Kulla and Fajardo 2012, Importance
 * sampling techniques for path tracing in participating media), and the share of the span that each stands for. */
static void divide(const span *s, float *places, float *weights) {
  const float length = s->end - s->begin, beside = fum_max(s->beside, 1e-3F * length);
  const float from = atanf((s->begin - s->nearest) / beside), to = atanf((s->end - s->nearest) / beside);
  const bool is_even = s->center.is_directional || s->is_area;
  for (int k = 0; k < PARTS; k++) {
    const float share = ((float)k + 0.5F) / (float)PARTS;
    const float slope = is_even ? 0.0F : tanf(from + (to - from) * share);
    places[k] = is_even ? s->begin + length * share : fum_min(fum_max(s->nearest + beside * slope, s->begin), s->end);
    weights[k] = is_even ? 1.0F / (float)PARTS : (to - from) / (float)PARTS * beside * (1.0F + slope * slope) / length;
  }
}

/* What a class scatters towards the camera of light from `to_light`, 1/sr; 0 if the lamp doesn't shine on it. */
static float scattered(const span *s, int32_t class, fum_vec3 to_light) {
  const fum_tile_class *c = &s->grid->job->classes[class];
  if (!fum_has_set(s->lamp->desc.light_sets, c->light_set)) return 0.0F;
  return fum_phase(c->anisotropy, fum_dot(to_light, s->direction));
}

/* Integrates over the span, smoke in front included, and writes it down as light of one depth at both ends. */
static void light_parts(const span *s, int32_t pixel, fum_slab_light *out) {
  const fum_tile_job *job = s->grid->job;
  float places[PARTS], weights[PARTS], least = INFINITY;
  lit parts[PARTS];
  divide(s, places, weights);
  for (int k = 0; k < PARTS; k++) {
    const float share = (places[k] - s->begin) / (s->end - s->begin);
    parts[k] = light_at(s, places[k], k);
    parts[k].depth += s->optical_depth * share * (1.0F - s->lean * (1.0F - share));
    weights[k] *= 1.0F - s->lean * (1.0F - 2.0F * share);
    least = fum_min(least, parts[k].depth);
  }
  out->begin[pixel] = least;
  out->end[pixel] = least - s->optical_depth; /* see add_light in tile_loop.h: the mean becomes 1 */
  for (int k = 0; k < PARTS; k++) {
    const float strength = weights[k] * parts[k].strength * expf(least - parts[k].depth);
    for (int32_t c = 0; c < job->class_count; c++)
      out->strengths[c][pixel] += strength * scattered(s, c, parts[k].to_light);
  }
}

/* The integral of add_light in tile_loop.h takes the depth to the light to be linear in the smoke passed. Where it
 * bends by `bend` * 4 x (1 - x) from that, the integral of exp(-a x) shrinks by exp(-bend) to the mean of 4 x (1 - x)
 * under exp(-a x), which is 2/3 at a = 0 and 4 / |a| far from it. */
static float bent_share(float bend, float a) {
  return expf(-fum_min(fum_max(bend * 4.0F / sqrtf(36.0F + a * a), -1.0F), 1.0F));
}

static void light_middle(const span *s, int32_t pixel, fum_slab_light *out) {
  const fum_tile_job *job = s->grid->job;
  const lit l = light_at(s, 0.5F * (s->begin + s->end), 0);
  const float begin = depth_at(s, s->begin), end = depth_at(s, s->end);
  const float bend = l.depth - 0.5F * (begin + end) + 0.25F * s->lean * (end - begin);
  const float strength = l.strength * bent_share(bend, s->optical_depth + end - begin);
  out->begin[pixel] = begin;
  out->end[pixel] = end;
  for (int32_t c = 0; c < job->class_count; c++)
    out->strengths[c][pixel] = strength * scattered(s, c, l.to_light);
}

/* Mean extinction over the part of a slab that a ray sees; NaN where that is too little to tell. */
static float mean_extinction(const float *depths, int32_t pixel, float begin, float end, float least) {
  return depths != NULL && end - begin > least ? depths[pixel] / (end - begin) : NAN;
}

/* Extinction is taken to be linear across a slab, with the slope towards the slabs beside it: their mean, or the only
 * one there is. */
static float find_lean(const fum_slab_smoke *smoke, const float ranges[4], float near, float far, int32_t pixel) {
  float ends[4];
  for (int k = 0; k < 4; k++)
    ends[k] = fum_min(fum_max(ranges[k], near), far);
  const float length = ends[2] - ends[1], least = 0.25F * length, here = smoke->depth[pixel] / length;
  const float before = mean_extinction(smoke->before, pixel, ends[0], ends[1], least);
  const float next = mean_extinction(smoke->next, pixel, ends[2], ends[3], least);
  const float first = (here - before) * length / (ends[2] - ends[0]),
              second = (next - here) * length / (ends[3] - ends[1]);
  const float change = isnan(first) ? (isnan(second) ? 0.0F : second) : isnan(second) ? first : 0.5F * (first + second);
  return fum_min(fum_max(change / here, -1.0F), 1.0F);
}

void fum_tile_hold(const fum_light_grid *grid, int32_t lamp, int32_t slab, fum_tile_held *held, fum_slab_held *out) {
  const fum_tile_job *job = grid->job;
  for (int32_t k = 0; k < 4; k++) {
    out->faces[k] = held_on_face(grid, lamp, slab - 1 + k, held);
    out->ranges[k] = fum_slabs_range(job->slabs, slab - 1 + k);
  }
  out->visible = NULL;
  if (job->lattice->visible == NULL) return;
  interpolate_middle(grid, job->lattice->visible, lamp, slab, held->visible);
  out->visible = held->visible;
}

void fum_tile_light_pixel(const fum_light_grid *grid, int32_t index, const fum_slab_smoke *smoke,
                          const fum_slab_held *held, int32_t pixel, fum_slab_light *out) {
  const fum_tile_job *job = grid->job;
  const fum_lamp *lamp = &job->lamps->items[index];
  const float *ranges = held->ranges, first = ranges[1], last = ranges[2];
  float around[4];
  for (int k = 0; k < 4; k++)
    around[k] = held->faces[k][pixel];
  fum_lattice_fill(around);
  span s = {.grid = grid,
            .lamp = lamp,
            .slab = smoke->index,
            .center = {.is_directional = lamp->desc.type == FUM_LIGHT_SUN,
                       .position = lamp->position,
                       .direction = lamp->back},
            .optical_depth = smoke->depth[pixel],
            .length = last - first,
            .held = {around[1], around[2]},
            .bow = fum_lattice_bow(around, ranges),
            .visible = held->visible != NULL ? held->visible[pixel] : 1.0F,
            .is_area = lamp->desc.type == FUM_LIGHT_AREA,
            .is_per_metre = fum_lattice_is_per_metre(lamp)};
  /* The near plane or a solid may begin or end the ray within the slab. */
  s.begin = fum_min(last, fum_max(first, grid->near[pixel])) - first;
  s.end = fum_max(s.begin, fum_min(last, grid->far[pixel]) - first);
  s.lean = s.end > s.begin ? find_lean(smoke, ranges, grid->near[pixel], grid->far[pixel], pixel) : 0.0F;
  find_ray(grid, pixel, first, &s.start, &s.direction);
  pass_light(&s);
  for (int32_t c = 0; c < job->class_count; c++)
    out->strengths[c][pixel] = 0.0F;
  (s.end > s.begin && is_uneven(&s) ? light_parts : light_middle)(&s, pixel, out);
}
