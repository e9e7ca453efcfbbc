/* SPDX-License-Identifier: GPL-3.0-or-later */
#include "lighting/environment.h"

#include "lighting/phase.h"

#include <string.h>

/* Sums over a picture's pixels from the first one on: energy, and energy times direction in its own coordinates. */
typedef struct sums {
  double energy, moment[3];
} sums;

/* A picture on its way. */
typedef struct picture {
  const fum_light_desc *light;
  int32_t width, height;
  sums *before; /* [height + 1][width + 1] of the pixels below and left of a corner */
} picture;

/* A rectangle of pixels. */
typedef struct region {
  int32_t x0, x1, y0, y1;
  double energy, unevenness; /* energy times (1 - closeness): what one direction for all of it makes wrong */
} region;

/* Towards a place of the picture: 0..1 from its left and from its bottom. */
static void direction_at(double u, double v, double out[3]) {
  const double around = FUM_PI * (1.0 - 2.0 * u), up = FUM_PI * (v - 0.5);
  out[0] = cos(up) * cos(around);
  out[1] = cos(up) * sin(around);
  out[2] = sin(up);
}

/* Solid angle of a pixel in a row. */
static double solid_angle(const picture *p, int32_t row) {
  const double below = FUM_PI * ((double)row / p->height - 0.5), above = FUM_PI * ((double)(row + 1) / p->height - 0.5);
  return 2.0 * FUM_PI / p->width * (sin(above) - sin(below));
}

static const float *pixel_at(const picture *p, int32_t x, int32_t y) {
  return p->light->environment_pixels + 3 * ((int64_t)y * p->width + x);
}

/* What a pixel sends, of all channels together. */
static double energy_at(const picture *p, int32_t x, int32_t y) {
  const float *rgb = pixel_at(p, x, y), *factor = p->light->intensity;
  return solid_angle(p, y) *
         ((double)rgb[0] * (double)factor[0] + (double)rgb[1] * (double)factor[1] + (double)rgb[2] * (double)factor[2]);
}

static sums *before(const picture *p, int32_t x, int32_t y) {
  return &p->before[(int64_t)y * (p->width + 1) + x];
}

/* Summed areas (Crow 1984, Summed-area tables for texture mapping). */
static void add_up(picture *p) {
  for (int32_t y = 0; y < p->height; y++) {
    sums row = {0};
    for (int32_t x = 0; x < p->width; x++) {
      const double energy = energy_at(p, x, y);
      const sums *below = before(p, x + 1, y);
      sums *here = before(p, x + 1, y + 1);
      double direction[3];
      direction_at((x + 0.5) / p->width, (y + 0.5) / p->height, direction);
      row.energy += energy;
      here->energy = below->energy + row.energy;
      for (int axis = 0; axis < 3; axis++) {
        row.moment[axis] += energy * direction[axis];
        here->moment[axis] = below->moment[axis] + row.moment[axis];
      }
    }
  }
}

static region measure(const picture *p, int32_t x0, int32_t x1, int32_t y0, int32_t y1) {
  const sums *a = before(p, x0, y0), *b = before(p, x1, y0), *c = before(p, x0, y1), *d = before(p, x1, y1);
  region r = {.x0 = x0, .x1 = x1, .y0 = y0, .y1 = y1};
  double squared = 0.0;
  for (int axis = 0; axis < 3; axis++) {
    const double moment = d->moment[axis] - b->moment[axis] - c->moment[axis] + a->moment[axis];
    squared += moment * moment;
  }
  r.energy = fmax(0.0, d->energy - b->energy - c->energy + a->energy);
  r.unevenness = (x1 - x0) * (y1 - y0) > 1 ? fmax(0.0, r.energy - sqrt(squared)) : 0.0;
  return r;
}

static void cut_at(const picture *p, const region *r, bool is_across, int32_t place, region out[2]) {
  out[0] = is_across ? measure(p, r->x0, place, r->y0, r->y1) : measure(p, r->x0, r->x1, r->y0, place);
  out[1] = is_across ? measure(p, place, r->x1, r->y0, r->y1) : measure(p, r->x0, r->x1, place, r->y1);
}

/* Cuts where each half has half of the energy, across or along: what leaves less unevenness. False if neither can be.
 */
static bool halve(const picture *p, const region *r, region out[2]) {
  double least = INFINITY;
  for (int way = 0; way < 2; way++) {
    const bool is_across = way == 0;
    const int32_t first = is_across ? r->x0 : r->y0, last = is_across ? r->x1 : r->y1;
    int32_t low = first + 1, high = last - 1;
    region parts[2];
    if (low > high) continue;
    while (low < high) {
      const int32_t middle = (low + high) / 2;
      cut_at(p, r, is_across, middle, parts);
      if (parts[0].energy < 0.5 * r->energy) {
        low = middle + 1;
      } else {
        high = middle;
      }
    }
    /* The line before may be nearer to the half; a single bright row or column is parted from the rest on both sides.
     */
    for (int32_t place = low > first + 1 ? low - 1 : low; place <= low; place++) {
      cut_at(p, r, is_across, place, parts);
      if (parts[0].unevenness + parts[1].unevenness >= least) continue;
      least = parts[0].unevenness + parts[1].unevenness;
      memcpy(out, parts, sizeof parts);
    }
  }
  return least < INFINITY;
}

/* Divides the picture, always where it is least even (after Debevec 2005, A median cut algorithm for light probe
 * sampling). Returns how many regions there are. */
static int32_t divide(const picture *p, int32_t wanted, region *regions) {
  int32_t count = 1;
  regions[0] = measure(p, 0, p->width, 0, p->height);
  const double even = 1e-9 * regions[0].energy;
  while (count < wanted) {
    int32_t worst = 0;
    region halves[2];
    for (int32_t i = 1; i < count; i++)
      worst = regions[i].unevenness > regions[worst].unevenness ? i : worst;
    if (!(regions[worst].unevenness > even) || !halve(p, &regions[worst], halves)) break;
    regions[worst] = halves[0];
    regions[count++] = halves[1];
  }
  return count;
}

static void set_closeness(double closeness, fum_sky *part) {
  part->closeness = (float)closeness;
  part->spread = (float)sqrt(0.5 * (1.0 - closeness * closeness));
}

/* Sums the region's pixels. False if none shines. */
static bool make_part(const picture *p, const region *r, fum_sky *out) {
  double rgb[3] = {0.0}, moment[3] = {0.0}, world[3] = {0.0}, energy = 0.0;
  for (int32_t y = r->y0; y < r->y1; y++) {
    const double angle = solid_angle(p, y);
    for (int32_t x = r->x0; x < r->x1; x++) {
      const double weight = energy_at(p, x, y);
      double direction[3];
      if (!(weight > 0.0)) continue;
      direction_at((x + 0.5) / p->width, (y + 0.5) / p->height, direction);
      energy += weight;
      for (int k = 0; k < 3; k++) {
        rgb[k] += angle * (double)pixel_at(p, x, y)[k] * (double)p->light->intensity[k];
        moment[k] += weight * direction[k];
      }
    }
  }
  if (!(energy > 0.0)) return false;
  const double length = sqrt(moment[0] * moment[0] + moment[1] * moment[1] + moment[2] * moment[2]);
  /* Opposite halves of the sky: any direction is as wrong. */
  if (!(length > 1e-6 * energy)) memcpy(moment, (double[3]){0.0, 0.0, 1.0}, sizeof moment);
  for (int column = 0; column < 3; column++) {
    double axis[3];
    if (!fum_matrix_axis(p->light->world_from_light, column, axis)) return false;
    for (int row = 0; row < 3; row++)
      world[row] += axis[row] * moment[column];
  }
  const double scale = 1.0 / sqrt(world[0] * world[0] + world[1] * world[1] + world[2] * world[2]);
  out->direction = (fum_vec3){(float)(world[0] * scale), (float)(world[1] * scale), (float)(world[2] * scale)};
  for (int c = 0; c < 3; c++)
    out->irradiance[c] = (float)rgb[c];
  set_closeness(fmin(1.0, length / energy), out);
  return true;
}

static int32_t part_picture(fum_context *context, const picture *p, int32_t wanted, int32_t *out_count,
                            fum_sky **out_parts) {
  region *regions = NULL;
  fum_sky *parts = NULL;
  int32_t count = 0;
  int32_t status = fum_alloc(context, wanted, sizeof *regions, "light from all around", &regions);
  if (status == FUM_OK) status = fum_alloc(context, wanted, sizeof *parts, "light from all around", &parts);
  if (status == FUM_OK) {
    const int32_t divided = divide(p, wanted, regions);
    for (int32_t i = 0; i < divided; i++)
      count += make_part(p, &regions[i], &parts[count]);
    *out_parts = parts;
    *out_count = count;
    parts = NULL;
  }
  fum_free(context, &regions);
  fum_free(context, &parts);
  return status;
}

static int32_t choose_from_picture(fum_context *context, const fum_light_desc *light, int32_t count, int32_t fine_count,
                                   fum_environment *e) {
  picture p = {.light = light, .width = light->environment_width, .height = light->environment_height};
  const int64_t corners = ((int64_t)p.width + 1) * ((int64_t)p.height + 1);
  int32_t status = fum_alloc(context, corners, sizeof *p.before, "light from all around", &p.before);
  if (status == FUM_OK) {
    add_up(&p);
    status = part_picture(context, &p, count, &e->count, &e->parts);
  }
  if (status == FUM_OK) status = part_picture(context, &p, fine_count, &e->fine_count, &e->fine_parts);
  fum_free(context, &p.before);
  return status;
}

/* Evenly spread: a spiral from pole to pole, each part as large as any other (Swinbank and Purser 2006, Fibonacci
 * grids).
 */
static int32_t spread_evenly(fum_context *context, const fum_light_desc *light, int32_t count, fum_environment *e) {
  const double golden_angle = 2.39996322972865332;
  const float *radiance = light->intensity;
  if (radiance[0] <= 0.0F && radiance[1] <= 0.0F && radiance[2] <= 0.0F) return FUM_OK;
  const int32_t status = fum_alloc(context, count, sizeof *e->parts, "light from all around", &e->parts);
  if (status != FUM_OK) return status;
  e->count = count;
  for (int32_t i = 0; i < count; i++) {
    const double z = 1.0 - (2.0 * i + 1.0) / count, across = sqrt(1.0 - z * z), around = golden_angle * i;
    fum_sky *part = &e->parts[i];
    part->direction = (fum_vec3){(float)(across * cos(around)), (float)(across * sin(around)), (float)z};
    for (int c = 0; c < 3; c++)
      part->irradiance[c] = (float)(4.0 * FUM_PI * (double)radiance[c] / count);
    set_closeness(1.0 - 1.0 / count, part); /* of a round cap of its size */
  }
  return FUM_OK;
}

int32_t fum_environment_choose(fum_context *context, const fum_light_desc *light, int32_t count, int32_t fine_count,
                               fum_environment *out_environment) {
  fum_environment e = {0};
  const int32_t status = light->environment_pixels != NULL ? choose_from_picture(context, light, count, fine_count, &e)
                                                           : spread_evenly(context, light, count, &e);
  if (status != FUM_OK) {
    fum_environment_free(context, &e);
    return status;
  }
  float sent = 0.0F;
  for (int32_t i = 0; i < e.count; i++) {
    const float *rgb = e.parts[i].irradiance, all = rgb[0] + rgb[1] + rgb[2];
    for (int c = 0; c < 3; c++)
      e.total[c] += rgb[c];
    e.mean = fum_mad(e.parts[i].direction, all * e.parts[i].closeness, e.mean);
    sent += all;
  }
  e.mean = fum_scaled(e.mean, sent > 0.0F ? 1.0F / sent : 0.0F);
  *out_environment = e;
  return FUM_OK;
}

void fum_environment_free(fum_context *context, fum_environment *environment) {
  fum_free(context, &environment->parts);
  fum_free(context, &environment->fine_parts);
}

/* The mean over a part is that over four points around its direction, as far from it as its own parts are in the mean:
 * two and two of them see the same. */
float fum_sky_scatter_wide(const fum_sky *part, int32_t channel, float anisotropy, fum_vec3 to_viewer) {
  if (anisotropy == 0.0F) return part->irradiance[channel] * fum_phase(0.0F, 0.0F);
  const float cosine = -fum_dot(part->direction, to_viewer), sine = sqrtf(fmaxf(0.0F, 1.0F - cosine * cosine));
  const float along = cosine * part->closeness, across = sine * part->spread;
  return part->irradiance[channel] * 0.5F *
         (fum_phase(anisotropy, fminf(along + across, 1.0F)) + fum_phase(anisotropy, fmaxf(along - across, -1.0F)));
}

float fum_sky_scatter(const fum_sky *part, int32_t channel, float anisotropy, fum_vec3 to_viewer) {
  const float cosine = anisotropy != 0.0F ? -fum_dot(part->direction, to_viewer) : 0.0F;
  return part->irradiance[channel] * fum_phase(anisotropy, cosine);
}

fum_sky_peak fum_environment_peak(const fum_environment *e, int32_t channel, float anisotropy, fum_vec3 to_viewer) {
  fum_sky_peak peak = {0, 0.0F};
  float nearest = -INFINITY;
  for (int32_t i = 0; i < e->count && anisotropy != 0.0F; i++) {
    const float closeness = -anisotropy * fum_dot(e->parts[i].direction, to_viewer);
    if (closeness > nearest) peak.part = i;
    nearest = fmaxf(nearest, closeness);
    peak.lacking += fum_sky_scatter_wide(&e->parts[i], channel, anisotropy, to_viewer) -
                    fum_sky_scatter(&e->parts[i], channel, anisotropy, to_viewer);
  }
  return peak;
}
