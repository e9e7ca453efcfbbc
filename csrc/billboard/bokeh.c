/* SPDX-License-Identifier: GPL-3.0-or-later */
#include "billboard/bokeh.h"

#include "base/vector.h"

#include <string.h>

/* Sigmas around the aperture's image out to which there is anything. */
static const double REACH = 5.5;

/* A level on its way. */
typedef struct table {
  const fum_aperture *aperture;
  double sigma;        /* of the Gaussian, over the confusion */
  double unit;         /* root of the variance of both */
  double step;         /* from value to value */
  int32_t side, cuts;  /* lines that the aperture is cut into */
  double low, spacing; /* height of the aperture's lowest point, and of a line */
} table;

static void find_heights(const fum_aperture *a, double out[2]) {
  out[0] = -1.0;
  out[1] = 1.0;
  if (a->corner_count == 0) return;
  out[0] = INFINITY;
  out[1] = -INFINITY;
  for (int32_t k = 0; k < a->corner_count; k++) {
    out[0] = fmin(out[0], a->corners[k][1]);
    out[1] = fmax(out[1], a->corners[k][1]);
  }
}

static table make_table(const fum_aperture *aperture, int32_t level) {
  double heights[2];
  find_heights(aperture, heights);
  const double sigma = 1.0 / ((double)FUM_BOKEH_LEAST * pow((double)FUM_BOKEH_STEP, level));
  const double unit = sqrt(aperture->variance + sigma * sigma);
  /* Linear interpolation of a Gaussian of the width s is off by an eighth of (step / s)^2 along each axis. */
  const double step = fmin(0.25 * sigma, unit / 9.0);
  const int32_t half = (int32_t)ceil((aperture->extent + REACH * sigma) / step);
  table t = {aperture, sigma, unit, step, 2 * half + 1, 0, heights[0], 0.0};
  t.cuts = (int32_t)ceil((heights[1] - heights[0]) / (0.125 * sigma));
  t.spacing = (heights[1] - heights[0]) / t.cuts;
  return t;
}

static double normal_share(double x) {
  return x < -6.0 ? 0.0 : x > 6.0 ? 1.0 : 0.5 * erfc(-0.70710678118654752 * x);
}

/* A line through the aperture, blurred along itself, [side]. */
static void blur_line(const table *t, int32_t cut, float *out) {
  double ends[2];
  const bool is_within = fum_aperture_cut(t->aperture, t->low + (cut + 0.5) * t->spacing, ends);
  for (int32_t i = 0; i < t->side; i++) {
    const double x = (i - t->side / 2) * t->step;
    out[i] =
        is_within ? (float)(normal_share((ends[1] - x) / t->sigma) - normal_share((ends[0] - x) / t->sigma)) : 0.0F;
  }
}

/* A row of values: lines near it, weighted with a Gaussian. */
static void blur_row(const table *t, const float *lines, int32_t row, float *out) {
  const double y = (row - t->side / 2) * t->step, reach = REACH * t->sigma;
  const int32_t first = (int32_t)fmax(0.0, floor((y - reach - t->low) / t->spacing));
  const int32_t last = (int32_t)fmin(t->cuts - 1.0, ceil((y + reach - t->low) / t->spacing));
  memset(out, 0, (size_t)t->side * sizeof *out);
  for (int32_t cut = first; cut <= last; cut++) {
    const double away = (t->low + (cut + 0.5) * t->spacing - y) / t->sigma;
    const float weight = (float)exp(-0.5 * away * away), *line = lines + (int64_t)cut * t->side;
    for (int32_t i = 0; i < t->side; i++)
      out[i] += weight * line[i];
  }
}

static int32_t fill(fum_context *context, const table *t, const fum_bokeh_level *level, fum_bokeh *bokeh) {
  float *lines = NULL;
  const int32_t status = fum_alloc(context, (int64_t)t->cuts * t->side, sizeof *lines, "bokeh", &lines);
  if (status != FUM_OK) return status;
#pragma omp parallel num_threads(fum_thread_count(context))
  {
#pragma omp for schedule(static)
    for (int32_t cut = 0; cut < t->cuts; cut++)
      blur_line(t, cut, lines + (int64_t)cut * t->side);
#pragma omp for schedule(static)
    for (int32_t row = 0; row < t->side; row++)
      blur_row(t, lines, row, bokeh->values + (int64_t)(level->first + row) * bokeh->width);
  }
  double sum = 0.0;
  for (int32_t row = 0; row < t->side; row++) {
    const float *values = bokeh->values + (int64_t)(level->first + row) * bokeh->width;
    for (int32_t i = 0; i < t->side; i++)
      sum += (double)values[i];
  }
  const float scale = (float)(2.0 * FUM_PI * t->unit * t->unit / (sum * t->step * t->step));
  for (int32_t row = 0; row < t->side; row++) {
    float *values = bokeh->values + (int64_t)(level->first + row) * bokeh->width;
    for (int32_t i = 0; i < t->side; i++)
      values[i] *= scale;
  }
  fum_free(context, &lines);
  return FUM_OK;
}

int32_t fum_bokeh_find(fum_context *context, const fum_camera *camera, fum_bokeh *out_bokeh) {
  fum_aperture aperture;
  fum_aperture_find(camera, &aperture);
  fum_bokeh bokeh = {.variance = (float)aperture.variance};
  for (int32_t level = 0; level < FUM_BOKEH_LEVELS; level++) {
    const table t = make_table(&aperture, level);
    bokeh.levels[level] = (fum_bokeh_level){bokeh.height, t.side, (float)(t.unit / t.step)};
    bokeh.width = t.side > bokeh.width ? t.side : bokeh.width;
    bokeh.height += t.side;
  }
  int32_t status =
      fum_alloc(context, (int64_t)bokeh.width * bokeh.height, sizeof *bokeh.values, "bokeh", &bokeh.values);
  for (int32_t level = 0; level < FUM_BOKEH_LEVELS && status == FUM_OK; level++) {
    const table t = make_table(&aperture, level);
    status = fill(context, &t, &bokeh.levels[level], &bokeh);
  }
  if (status == FUM_OK) {
    *out_bokeh = bokeh;
  } else {
    fum_bokeh_free(context, &bokeh);
  }
  return status;
}

void fum_bokeh_free(fum_context *context, fum_bokeh *bokeh) {
  fum_free(context, &bokeh->values);
}

fum_bokeh_place fum_bokeh_at(const fum_bokeh *bokeh, double confusion, const double variances[3]) {
  const double radius = fabs(confusion), sign = confusion < 0.0 ? -1.0 : 1.0;
  const double squared_width = sqrt(fmax(variances[0] * variances[2] - variances[1] * variances[1], 0.0));
  const double softest = fmax(squared_width, radius * radius / ((double)FUM_BOKEH_MOST * (double)FUM_BOKEH_MOST));
  const double ratio = fmax(radius / sqrt(softest), (double)FUM_BOKEH_LEAST);
  const double level = log(ratio / (double)FUM_BOKEH_LEAST) / log((double)FUM_BOKEH_STEP);
  const int32_t before = (int32_t)fmin(level, FUM_BOKEH_LEVELS - 2.0);
  const double added = (double)bokeh->variance * radius * radius + softest - squared_width;
  /* The inverse root of the variances of both. */
  const double xx = variances[0] + added, xy = variances[1], yy = variances[2] + added;
  const double area = sqrt(xx * yy - xy * xy), trace = sqrt(xx + yy + 2.0 * area), scale = sign / (area * trace);
  return (fum_bokeh_place){.level = before,
                           .blend = (float)fmin(1.0, level - before),
                           .units = {(float)((yy + area) * scale), (float)(-xy * scale), (float)((xx + area) * scale)},
                           .density = (float)(1.0 / area)};
}
