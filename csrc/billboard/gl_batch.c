/* SPDX-License-Identifier: GPL-3.0-or-later */
#include "billboard/gl_batch.h"

#include "lighting/slabs.h"

/* Length of the part of [low, high] within [0, size]. */
static double length_within(double low, double high, double size) {
  const double start = low > 0.0 ? low : 0.0, end = high < size ? high : size;
  return end > start ? end - start : 0.0;
}

/* Pixels of the tile that one axis of a footprint's bounding cube covers. */
static double extent_px(const fum_frame *frame, double center, double radius, double depth, double low, double high,
                        int32_t frame_px, int32_t tile_start, int32_t tile_px) {
  const double pixels = frame_px / (high - low);
  double start = center - radius, end = center + radius;
  if (frame->type == FUM_CAMERA_PERSPECTIVE) {
    if (depth <= radius) return tile_px;
    start /= start < 0 ? depth - radius : depth + radius;
    end /= end > 0 ? depth - radius : depth + radius;
  }
  return length_within((start - low) * pixels - tile_start, (end - low) * pixels - tile_start, tile_px);
}

/* Fragments that a billboard makes in a tile, roughly and rather too many. */
static double estimate_fragments(const fum_frame *frame, const fum_gl_tile *tile, const fum_billboard *billboard,
                                 const fum_billboard_smear *smear) {
  const double footprint = fum_footprint((double)frame->footprint_sigmas, (double)billboard->optical_depth);
  double radius = footprint * (double)billboard->sigma;
  const double depth = -(double)billboard->center[2];
  if (smear != NULL) {
    const float *p = smear->path;
    radius += 0.5 * sqrt((double)(p[0] * p[0] + p[1] * p[1] + p[2] * p[2])) + fabs((double)smear->confusion);
  }
  const float *window = frame->window;
  if (depth + radius <= frame->clip_start || depth - radius >= frame->clip_end) return 0.0;
  return extent_px(frame, billboard->center[0], radius, depth, window[0], window[1], frame->width, tile->x,
                   tile->width) *
         extent_px(frame, billboard->center[1], radius, depth, window[2], window[3], frame->height, tile->y,
                   tile->height);
}

fum_gl_batch fum_gl_batch_next(const fum_frame *frame, const fum_gl_tile *tile, const fum_billboard *billboards,
                               int64_t first, int64_t count, double budget) {
  const double vertex_cost = 64.0;
  fum_gl_batch batch = {.first = first, .bands = 1};
  while (first + batch.count < count && batch.count < FUM_GL_MOST_BILLBOARDS) {
    const int64_t i = first + batch.count;
    const fum_billboard_smear *smear = frame->blur != NULL ? &frame->blur->smears[i] : NULL;
    const double cost = vertex_cost + estimate_fragments(frame, tile, &billboards[i], smear);
    if (batch.count > 0 && batch.cost + cost > budget) break;
    batch.cost += cost;
    batch.count++;
  }
  if (batch.cost > budget) batch.bands = (int32_t)fmin(ceil(batch.cost / budget), tile->height);
  return batch;
}
