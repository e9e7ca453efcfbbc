/* SPDX-License-Identifier: GPL-3.0-or-later */
#include "lighting/lookup.h"

/* Weights of the cubic B-splines (lattice_spline.h). Returns the first of the four samples. */
static int32_t find_taps(double place, float origin, float spacing, double weights[4]) {
  const double at = (place - (double)origin) / (double)spacing, whole = floor(at), f = at - whole, rest = 1.0 - f;
  weights[0] = rest * rest * rest / 6.0;
  weights[1] = (4.0 + f * f * (3.0 * f - 6.0)) / 6.0;
  weights[2] = (4.0 + rest * rest * (3.0 * rest - 6.0)) / 6.0;
  weights[3] = f * f * f / 6.0;
  return (int32_t)whole - 1;
}

static int64_t clamp_index(int32_t i, int32_t count) {
  return i < 0 ? 0 : i >= count ? count - 1 : i;
}

/* NaN where a sample that is needed isn't lit. */
static float held_on_face(const fum_lattice *lattice, const float *depths, int32_t face, const double window[2]) {
  double across[4], up[4], sum = 0.0;
  if (face < 0 || face >= lattice->face_count || lattice->faces[face].columns == 0) return NAN;
  const fum_lattice_face *grid = &lattice->faces[face];
  const int32_t column = find_taps(window[0], grid->origin[0], grid->spacing[0], across);
  const int32_t row = find_taps(window[1], grid->origin[1], grid->spacing[1], up);
  for (int32_t r = 0; r < 4; r++) {
    const float *samples = depths + grid->first + clamp_index(row + r, grid->rows) * grid->columns;
    for (int32_t c = 0; c < 4; c++)
      sum += up[r] * across[c] * (double)samples[clamp_index(column + c, grid->columns)];
  }
  return sum < 0.0 ? 0.0F : (float)sum;
}

double fum_lattice_look_up(const fum_lattice *lattice, const fum_slabs *slabs, int32_t light, const double window[2],
                           double range) {
  const int32_t slab = fum_slab_at(slabs, range);
  const float *depths = lattice->depths + light * lattice->sample_count;
  float held[4], ranges[4];
  for (int32_t k = 0; k < 4; k++) {
    held[k] = held_on_face(lattice, depths, slab - 1 + k, window);
    ranges[k] = fum_slabs_range(slabs, slab - 1 + k);
  }
  fum_lattice_fill(held);
  const double length = (double)ranges[2] - (double)ranges[1];
  const double share = fmin(1.0, fmax(0.0, (range - (double)ranges[1]) / length));
  const double bow = (double)fum_lattice_bow(held, ranges);
  return fmax(0.0, (double)held[1] + ((double)held[2] - (double)held[1]) * share + bow * 4.0 * share * (1.0 - share));
}

double fum_lattice_depth(const fum_lattice *lattice, const fum_slabs *slabs, const fum_lamp *lamp, int32_t light,
                         const double window[2], double range, const double position[3]) {
  const double held = fum_lattice_look_up(lattice, slabs, light, window, range);
  if (!fum_lattice_is_per_metre(lamp)) return held;
  const double x = position[0] - (double)lamp->position.x, y = position[1] - (double)lamp->position.y;
  const double z = position[2] - (double)lamp->position.z;
  return held * sqrt(x * x + y * y + z * z);
}
