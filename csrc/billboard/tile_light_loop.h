/* SPDX-License-Identifier: GPL-3.0-or-later */
/* The part of tile_loop.h that lights a slab, many pixels at once: environments, suns and point lights where they shine
 * evenly enough that the middle of each ray's span stands for it. Everything else is left to fum_tile_light_pixel. */
#include "billboard/tile_light.h"
#include "billboard/tile_rays.h"

static const fum_vf ZERO = {0};

static fum_vi is_held(fum_vf v) {
  return v == v; /* not NaN */
}

/* The part of each ray that lies in a slab, and its smoke. */
typedef struct spans {
  fum_vf begin, end, length; /* m from the slab's first face */
  fum_vf optical_depth, lean;
} spans;

/* Mean extinction before or behind the slab; `out_is_known` where the ray sees enough of it. */
static fum_vf neighbour_extinction(const float *depths, int32_t pixel, fum_vf length, fum_vf least,
                                   fum_vi *out_is_known) {
  if (depths == NULL) {
    *out_is_known = (fum_vi){0};
    return ZERO;
  }
  *out_is_known = length > least;
  return fum_vf_load(depths + pixel) / fum_vf_select(*out_is_known, length, fum_vf_set(1.0F));
}

/* As find_lean in tile_light.c. */
static fum_vf find_leans(const fum_slab_smoke *smoke, const float ranges[4], fum_vf near, fum_vf far, int32_t pixel) {
  fum_vf ends[4];
  for (int k = 0; k < 4; k++)
    ends[k] = fum_vf_min(fum_vf_max(fum_vf_set(ranges[k]), near), far);
  const fum_vf length = ends[2] - ends[1], least = 0.25F * length;
  const fum_vf here = fum_vf_load(smoke->depth + pixel) / fum_vf_max(length, fum_vf_set(1e-30F));
  fum_vi has_before, has_next;
  const fum_vf before = neighbour_extinction(smoke->before, pixel, ends[1] - ends[0], least, &has_before);
  const fum_vf next = neighbour_extinction(smoke->next, pixel, ends[3] - ends[2], least, &has_next);
  const fum_vf first = fum_vf_select(has_before, (here - before) * length / (ends[2] - ends[0]), ZERO);
  const fum_vf second = fum_vf_select(has_next, (next - here) * length / (ends[3] - ends[1]), ZERO);
  const fum_vf share = fum_vf_select(has_before & has_next, fum_vf_set(0.5F), fum_vf_set(1.0F));
  return fum_vf_min(fum_vf_max(share * (first + second) / fum_vf_max(here, fum_vf_set(1e-30F)), fum_vf_set(-1.0F)),
                    fum_vf_set(1.0F));
}

static spans find_spans(const fum_light_grid *grid, const fum_slab_smoke *smoke, const float ranges[4], int32_t pixel) {
  const fum_vf near = fum_vf_load(grid->near + pixel), far = fum_vf_load(grid->far + pixel);
  const fum_vf first = fum_vf_set(ranges[1]), last = fum_vf_set(ranges[2]);
  spans s = {.begin = fum_vf_min(last, fum_vf_max(first, near)) - first,
             .optical_depth = fum_vf_load(smoke->depth + pixel)};
  s.end = fum_vf_max(s.begin, fum_vf_min(last, far) - first);
  s.length = s.end - s.begin;
  s.lean = fum_vf_select(s.length > 0.0F, find_leans(smoke, ranges, near, far, pixel), ZERO);
  return s;
}

/* What the lattice holds along each ray: a parabola (fum_lattice_fill, fum_lattice_bow). */
typedef struct parabolas {
  fum_vf start, rise, bow;
} parabolas;

static parabolas find_parabolas(const float *const held[4], const float ranges[4], int32_t pixel) {
  const float length = ranges[2] - ranges[1];
  const float before_length = ranges[1] - ranges[0], behind_length = ranges[3] - ranges[2];
  const fum_vf before = fum_vf_load(held[0] + pixel), behind = fum_vf_load(held[3] + pixel);
  fum_vf begin = fum_vf_load(held[1] + pixel), end = fum_vf_load(held[2] + pixel);
  begin = fum_vf_select(is_held(begin), begin, fum_vf_select(is_held(end), end, ZERO));
  end = fum_vf_select(is_held(end), end, begin);
  const fum_vf slope = (end - begin) * (1.0F / length);
  const fum_vf first =
      ((begin - before) * (1.0F / before_length) - slope) * (length * length / (4.0F * (ranges[2] - ranges[0])));
  const fum_vf second =
      (slope - (behind - end) * (1.0F / behind_length)) * (length * length / (4.0F * (ranges[3] - ranges[1])));
  const fum_vf both = fum_vf_select(first * second > 0.0F, 0.5F * (first + second), ZERO);
  const fum_vf with_first = fum_vf_select(is_held(second), both, first);
  const fum_vf without = fum_vf_select(is_held(second), second, ZERO);
  return (parabolas){begin, end - begin, fum_vf_select(is_held(first), with_first, without)};
}

/* The lamp as the rays pass it. */
typedef struct passings {
  fum_vf nearest, squared_beside; /* m from the slab's first face; m^2 */
  fum_vf cosine;                  /* of a sun: between ray and the way to it */
  bool is_sun, is_per_metre;      /* an environment passes as a sun does */
} passings;

static passings pass_lamp(const fum_light_grid *grid, const fum_lamp *lamp, float range, int32_t pixel) {
  const fum_view *view = grid->job->view;
  const double *m = view->local_from_camera;
  const bool is_perspective = view->type == FUM_CAMERA_PERSPECTIVE;
  const float position[3] = {lamp->position.x, lamp->position.y, lamp->position.z};
  const float back[3] = {lamp->back.x, lamp->back.y, lamp->back.z};
  const fum_vf u = fum_vf_load(grid->u + pixel), v = fum_vf_load(grid->v + pixel);
  const fum_vf inverse_length = fum_vf_load(grid->inverse_length + pixel);
  passings p = {.is_sun = lamp->desc.type == FUM_LIGHT_SUN || lamp->environment != NULL,
                .is_per_metre = fum_lattice_is_per_metre(lamp)};
  fum_vf line[3], direction[3];
  p.nearest = p.squared_beside = p.cosine = ZERO;
  for (int row = 0; row < 3; row++) {
    const float *back_of = back + row;
    const fum_vf across = (float)m[4 * row] * u + (float)m[4 * row + 1] * v;
    direction[row] = ((is_perspective ? across : ZERO) - (float)m[4 * row + 2]) * inverse_length;
    const fum_vf from_camera = (is_perspective ? ZERO : across) + direction[row] * range;
    line[row] = (float)((double)position[row] - m[4 * row + 3]) - from_camera;
    p.nearest += line[row] * direction[row];
    p.cosine += *back_of * direction[row];
  }
  for (int row = 0; row < 3; row++) {
    const fum_vf beside = line[row] - p.nearest * direction[row];
    p.squared_beside += beside * beside;
  }
  return p;
}

static fum_vf distance_at(const passings *p, fum_vf along) {
  const fum_vf before = along - p->nearest;
  return fum_vf_sqrt(p->squared_beside + before * before);
}

static fum_vf depth_at(const parabolas *held, const passings *p, float slab_length, fum_vf along) {
  const fum_vf share = along * (1.0F / slab_length);
  const fum_vf depth =
      fum_vf_at_least(held->start + held->rise * share + held->bow * (4.0F * share * (1.0F - share)), 0.0F);
  return p->is_per_metre ? depth * distance_at(p, along) : depth;
}

/* Where the middle of a span doesn't stand for it (is_uneven in tile_light.c). */
static fum_vi are_uneven(const fum_light_grid *grid, const spans *s, const passings *p, const float *visible,
                         int32_t pixel) {
  fum_vi uneven = {0};
  if (visible != NULL) {
    const fum_vf seen = fum_vf_load(visible + pixel);
    uneven = (seen < 1.0F - FUM_SHADOW_SLACK) &
             (fum_vf_abs(seen - (1.0F - grid->job->solid_shadow_intensity)) > FUM_SHADOW_SLACK);
  }
  if (!p->is_sun) {
    const fum_vf clear = fum_vf_at_least(fum_vf_max(s->begin - p->nearest, p->nearest - s->end), 0.0F);
    uneven |= s->length * s->length > FUM_STEEP * FUM_STEEP * (p->squared_beside + clear * clear);
  }
  return uneven & (s->length > 0.0F);
}

/* fum_emitter_irradiance of all of a point light; x / (root (1 + root)) is 1 - 1 / root of root^2 = 1 + x. */
static fum_vf point_irradiance(float radius, fum_vf squared_distance) {
  const fum_vf squared = fum_vf_max(squared_distance, fum_vf_set(1e-30F));
  const fum_vf root = fum_vf_sqrt(1.0F + radius * radius / squared);
  return 2.0F / (squared * root * (1.0F + root));
}

/* fum_phase */
static fum_vf phase(float g, fum_vf cosine) {
  const fum_vf base = 1.0F + g * g - 2.0F * g * cosine;
  return (1.0F - g * g) / (4.0F * (float)FUM_PI) / (base * fum_vf_sqrt(base));
}

/* What smoke of the lamp's anisotropy scatters to the camera of an environment's light in the clear: the sum of
 * fum_sky_scatter_wide over its fine parts. */
static fum_vf scatter_around(const fum_light_grid *grid, const fum_lamp *lamp, int32_t pixel) {
  const fum_environment *e = lamp->environment;
  const float g = lamp->anisotropy;
  if (g == 0.0F || e->fine_count == 0) return fum_vf_set(e->total[lamp->channel] / (4.0F * (float)FUM_PI));
  const double *m = grid->job->view->local_from_camera;
  const bool is_perspective = grid->job->view->type == FUM_CAMERA_PERSPECTIVE;
  const fum_vf u = fum_vf_load(grid->u + pixel), v = fum_vf_load(grid->v + pixel);
  const fum_vf inverse_length = fum_vf_load(grid->inverse_length + pixel);
  fum_vf direction[3], sum = ZERO;
  for (int row = 0; row < 3; row++) {
    const fum_vf across = (float)m[4 * row] * u + (float)m[4 * row + 1] * v;
    direction[row] = ((is_perspective ? across : ZERO) - (float)m[4 * row + 2]) * inverse_length;
  }
  for (int32_t i = 0; i < e->fine_count; i++) {
    const fum_sky *part = &e->fine_parts[i];
    const fum_vec3 to = part->direction;
    const fum_vf cosine = to.x * direction[0] + to.y * direction[1] + to.z * direction[2];
    const fum_vf along = cosine * part->closeness;
    const fum_vf across = fum_vf_sqrt(fum_vf_at_least(1.0F - cosine * cosine, 0.0F)) * part->spread;
    sum += (0.5F * part->irradiance[lamp->channel]) * (phase(g, fum_vf_min(along + across, fum_vf_set(1.0F))) +
                                                       phase(g, fum_vf_max(along - across, fum_vf_set(-1.0F))));
  }
  return sum;
}

/* Makes what is held of a lamp ready for a tile. */
static void begin_lamp(const fum_light_grid *grid, const fum_lamp *lamp, fum_tile_held *held) {
  for (int k = 0; k < 4; k++)
    held->faces[k] = FUM_NO_FACE;
  for (int32_t i = 0; i < FUM_TILE_PIXELS && lamp->environment != NULL; i += FUM_LANES)
    fum_vf_store(held->around + i, scatter_around(grid, lamp, i));
}

/* light_middle of tile_light.c. */
static void light_middles(const fum_light_grid *grid, const fum_lamp *lamp, const spans *s, const passings *p,
                          const parabolas *held, float slab_length, fum_vf strength, const float *around, int32_t pixel,
                          fum_slab_light *out) {
  const fum_tile_job *job = grid->job;
  const fum_vf along = 0.5F * (s->begin + s->end), distance = distance_at(p, along);
  const fum_vf begin = depth_at(held, p, slab_length, s->begin), end = depth_at(held, p, slab_length, s->end);
  const fum_vf bend = depth_at(held, p, slab_length, along) - 0.5F * (begin + end) + 0.25F * s->lean * (end - begin);
  const fum_vf a = s->optical_depth + end - begin;
  const fum_vf exponent =
      fum_vf_min(fum_vf_max(bend * (4.0F / fum_vf_sqrt(36.0F + a * a)), fum_vf_set(-1.0F)), fum_vf_set(1.0F));
  const fum_vf shine = p->is_sun ? fum_vf_set(1.0F) : point_irradiance(lamp->desc.radius, distance * distance);
  const fum_vf bent = strength * shine * fum_vf_exp2(exponent * -1.44269504F);
  const fum_vf cosine = p->is_sun ? p->cosine : (p->nearest - along) / fum_vf_max(distance, fum_vf_set(1e-20F));
  fum_vf_store(out->begin + pixel, begin);
  fum_vf_store(out->end + pixel, end);
  for (int32_t c = 0; c < job->class_count; c++) {
    const float g = job->classes[c].anisotropy;
    const bool is_lit = fum_has_set(lamp->desc.light_sets, job->classes[c].light_set);
    const bool is_meant = is_lit && (lamp->environment == NULL || g == lamp->anisotropy);
    const fum_vf scattered = lamp->environment == NULL ? phase(g, cosine) : fum_vf_load(around + pixel);
    fum_vf_store(out->strengths[c] + pixel, is_meant ? bent * scattered : ZERO);
  }
}

static void leave_dark(const fum_tile_job *job, int32_t pixel, fum_slab_light *out) {
  fum_vf_store(out->begin + pixel, ZERO);
  fum_vf_store(out->end + pixel, ZERO);
  for (int32_t c = 0; c < job->class_count; c++)
    fum_vf_store(out->strengths[c] + pixel, ZERO);
}

/* Lights the slab with one lamp. */
static void light_slab(const fum_light_grid *grid, int32_t index, const fum_slab_smoke *smoke, fum_tile_held *held,
                       fum_slab_light *out) {
  const fum_lamp *lamp = &grid->job->lamps->items[index];
  const bool is_around = lamp->environment != NULL;
  const bool is_simple = lamp->desc.type == FUM_LIGHT_SUN || lamp->desc.type == FUM_LIGHT_POINT || is_around;
  fum_slab_held around;
  fum_tile_hold(grid, index, smoke->index, held, &around);
  const fum_emitter centre = {.is_directional = true};
  const float sun = lamp->desc.type == FUM_LIGHT_SUN
                        ? fum_emitter_irradiance(lamp, &centre, lamp->back) * (float)lamp->sample_count
                        : 1.0F;
  out->color = lamp->color;
  for (int32_t i = 0; i < FUM_TILE_PIXELS; i += FUM_LANES) {
    const fum_vi shows =
        (fum_vf_load(smoke->depth + i) > FUM_TILE_THIN) & (fum_vf_load(smoke->front + i) < FUM_TILE_DARK);
    uint32_t left = fum_vi_bits(shows);
    leave_dark(grid->job, i, out);
    if (left == 0) continue;
    if (is_simple) {
      const spans s = find_spans(grid, smoke, around.ranges, i);
      const passings p = pass_lamp(grid, lamp, around.ranges[1], i);
      const parabolas depths = find_parabolas(around.faces, around.ranges, i);
      fum_vf strength = fum_vf_set(sun);
      if (around.visible != NULL)
        strength *= fum_vf_min(fum_vf_at_least(fum_vf_load(around.visible + i), 0.0F), fum_vf_set(1.0F));
      light_middles(grid, lamp, &s, &p, &depths, around.ranges[2] - around.ranges[1], strength, held->around, i, out);
      left &= is_around ? 0 : fum_vi_bits(are_uneven(grid, &s, &p, around.visible, i));
    }
    for (; left != 0; left &= left - 1)
      fum_tile_light_pixel(grid, index, smoke, &around, i + __builtin_ctz(left), out);
  }
}
