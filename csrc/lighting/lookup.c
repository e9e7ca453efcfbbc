/* SPDX-License-Identifier: GPL-3.0-or-later */
#include "lighting/lookup.h"

/* Catmull and Rom 1974. Returns the first of the four samples. */
static int32_t find_taps(double place, float origin, float spacing, double weights[4]) {
  const double at = (place - (double)origin) / (double)spacing, whole = floor(at), f = at - whole;
  weights[0] = f * (-0.5 + f * (1.0 - 0.5 * f));
  weights[1] = 1.0 + f * f * (-2.5 + 1.5 * f);
  weights[2] = f * (0.5 + f * (2.0 - 1.5 * f));
  weights[3] = f * f * (-0.5 + 0.5 * f);
  return (int32_t)whole - 1;
}

static int64_t clamp_index(int32_t i, int32_t count) {
  return i < 0 ? 0 : i >= count ? count - 1 : i;
}

static double depth_on_face(const fum_lattice_face *face, const float *depths, const double window[2]) {
  double across[4], up[4], sum = 0.0;
  if (face->columns == 0) return 0.0;
  const int32_t column = find_taps(window[0], face->origin[0], face->spacing[0], across);
  const int32_t row = find_taps(window[1], face->origin[1], face->spacing[1], up);
  for (int32_t r = 0; r < 4; r++) {
    const float *samples = depths + face->first + clamp_index(row + r, face->rows) * face->columns;
    for (int32_t c = 0; c < 4; c++)
      sum += up[r] * across[c] * (double)samples[clamp_index(column + c, face->columns)];
  }
  return fmax(sum, 0.0);
}

double fum_lattice_look_up(const fum_lattice *lattice, const fum_slabs *slabs, int32_t light, const double window[2],
                           double range) {
  const int32_t slab = fum_slab_at(slabs, range);
  const float *depths = lattice->depths + light * lattice->sample_count;
  const fum_lattice_face *near = &lattice->faces[slab], *far = &lattice->faces[slab + 1];
  const double first = (double)slabs->faces[slab].range, last = (double)slabs->faces[slab + 1].range;
  const double begin = depth_on_face(near->columns > 0 ? near : far, depths, window);
  const double end = depth_on_face(far->columns > 0 ? far : near, depths, window);
  const double share = fmin(1.0, fmax(0.0, (range - first) / (last - first)));
  return begin + (end - begin) * share;
}
