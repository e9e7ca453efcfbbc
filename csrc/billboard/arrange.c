/* SPDX-License-Identifier: GPL-3.0-or-later */
#include "billboard/arrange.h"

#include "base/radix.h"
#include "billboard/dust.h"
#include "lighting/slabs.h"

#include <string.h>

enum { CHECK_STRIDE = 1 << 17 };

static void to_camera(const fum_octree *octree, const fum_view *view, uint32_t rank, double out[3]) {
  const double local[3] = {(double)octree->x[rank], (double)octree->y[rank], (double)octree->z[rank]};
  fum_transform_point(view->camera_from_local, local, out);
}

/* Does a sphere of this radius show between the sides of the frame? Perspective: distance from the plane through the
 * camera and each side. */
static bool is_in_frame(const fum_view *view, const double center[3], double radius) {
  const double depth = -center[2], *w = view->window;
  if (depth + radius < view->clip_start || depth - radius > view->clip_end) return false;
  const bool is_perspective = view->type == FUM_CAMERA_PERSPECTIVE;
  for (int axis = 0; axis < 2; axis++) {
    for (int side = 0; side < 2; side++) {
      const double edge = w[2 * axis + side], sign = side == 0 ? 1.0 : -1.0;
      const double inside = is_perspective ? sign * (center[axis] - edge * depth) / sqrt(1.0 + edge * edge)
                                           : sign * (center[axis] - edge);
      if (inside < -radius) return false;
    }
  }
  return true;
}

static uint32_t float_bits(float value) {
  uint32_t bits;
  memcpy(&bits, &value, sizeof bits);
  return bits;
}

/* Ascending keys put the farthest first: the bits of floats >= 0 grow with their value. In an orthographic view depth
 * may be negative where a particle reaches over the camera. */
static uint32_t order_key(const fum_view *view, const double center[3]) {
  const bool is_perspective = view->type == FUM_CAMERA_PERSPECTIVE;
  const double distance =
      is_perspective ? sqrt(center[0] * center[0] + center[1] * center[1] + center[2] * center[2]) : -center[2];
  const uint32_t bits = float_bits((float)fabs(distance));
  return distance < 0.0 ? 0x80000000U + bits : 0x7fffffffU - bits;
}

/* How far a smeared particle is seen around the middle of its path, beyond its footprint. */
static double find_spread(const fum_smears *smears, const fum_smear *smear) {
  const float *p = smear->path;
  const double path = 0.5 * sqrt((double)(p[0] * p[0] + p[1] * p[1] + p[2] * p[2]));
  return path + smears->extent * (fabs((double)smear->confusion) + smears->confusion_per_depth * path);
}

int32_t fum_arrange_order(const fum_scene *scene, const fum_octree *octree, const fum_view *view,
                          const fum_smears *smears, float footprint_sigmas, uint32_t **out_ranks, int64_t *out_count) {
  fum_context *context = scene->context;
  const uint64_t unseen = UINT64_MAX;
  /* A billboard thinner than a pixel is widened to about one. */
  const double pixel = fum_view_pixel(view);
  uint64_t *keys = NULL;
  uint32_t *ranks = NULL;
  int64_t seen = 0;
  const int64_t places = scene->particle_count;
  int32_t status = fum_alloc(context, places, sizeof *keys, "order of the particles", &keys);
  if (status != FUM_OK) goto done;
  if (octree->count < places) memset(keys, 0xff, (size_t)places * sizeof *keys); /* some are in no octree: unseen */
#pragma omp parallel for num_threads(fum_thread_count(context)) schedule(static) reduction(+ : seen)
  for (int64_t rank = 0; rank < octree->count; rank++) {
    double center[3];
    if (fum_progress_in_loop(context, rank, CHECK_STRIDE)) continue;
    to_camera(octree, view, (uint32_t)rank, center);
    for (int axis = 0; axis < 3 && smears != NULL; axis++)
      center[axis] = (double)smears->items[rank].center[axis];
    const double spread = smears != NULL ? find_spread(smears, &smears->items[rank]) : 0.0;
    const double depth = view->type == FUM_CAMERA_PERSPECTIVE ? fmax(0.0, -center[2]) : 1.0;
    const double sigma = fmax(1.0 / (double)octree->inverse_sigmas[rank], pixel * depth);
    const double footprint = fum_footprint((double)footprint_sigmas, (double)octree->optical_depths[rank]);
    const bool in_frame = is_in_frame(view, center, sigma * footprint + spread);
    keys[octree->indices[rank]] = in_frame ? (uint64_t)order_key(view, center) << 32 | (uint64_t)rank : unseen;
    seen += in_frame;
  }
  status = fum_radix_sort(context, places, 32, keys, NULL);
  if (status == FUM_OK) status = fum_alloc(context, seen, sizeof *ranks, "order of the particles", &ranks);
  if (status != FUM_OK) goto done;
#pragma omp parallel for num_threads(fum_thread_count(context)) schedule(static)
  for (int64_t i = 0; i < seen; i++)
    ranks[i] = (uint32_t)keys[i];
  *out_ranks = ranks;
  *out_count = seen;
done:
  fum_free(context, &keys);
  return status;
}

/* Source function S = albedo * in-scattered light + emission / density (DESIGN.md, section 1). Something that glows
 * without absorbing gets an extinction too thin to be seen, so that S stays finite. */
static void shade(const fum_particles *set, int64_t i, const float *light, double density, fum_billboard *out) {
  const float *albedo = set->albedos != NULL ? set->albedos + 3 * i : set->albedo;
  const float *emission = set->emissions != NULL ? set->emissions + 3 * i : set->emission;
  for (int c = 0; c < 3; c++) {
    const double glow = density > 0.0 ? (double)emission[c] / density : 0.0;
    out->source[c] = (float)((double)albedo[c] * (double)light[c] + glow);
  }
}

void fum_arrange_billboards(const fum_scene *scene, const fum_octree *octree, const fum_view *view, const float *light,
                            int64_t count, const uint32_t *ranks, fum_billboard *out_billboards) {
#pragma omp parallel for num_threads(fum_thread_count(scene->context)) schedule(static)
  for (int64_t n = 0; n < count; n++) {
    if (fum_progress_in_loop(scene->context, n, CHECK_STRIDE)) continue;
    const uint32_t rank = ranks[n], index = octree->indices[rank];
    const fum_particles *set = fum_scene_particles_of(scene, index);
    const int64_t i = index - set->offset;
    const float *emission = set->emissions != NULL ? set->emissions + 3 * i : set->emission;
    const bool glows = emission[0] > 0.0F || emission[1] > 0.0F || emission[2] > 0.0F;
    const double sigma = (double)set->sigmas[i], thin = 1e-5 / (sigma * FUM_SQRT_2PI);
    const double density = glows ? fmax((double)set->densities[i], thin) : (double)set->densities[i];
    fum_billboard *b = &out_billboards[n];
    double center[3];
    to_camera(octree, view, rank, center);
    for (int axis = 0; axis < 3; axis++)
      b->center[axis] = (float)center[axis];
    b->sigma = (float)fmax(sigma, 1e-18);
    b->optical_depth = (float)fmin(density * sigma * FUM_SQRT_2PI, 1e30);
    shade(set, i, light + 3 * (int64_t)rank, density, b);
  }
}

/* Lists the maps of the scene and where each begins among all texels, by set. */
static int32_t list_maps(const fum_scene *scene, int64_t *begins, fum_billboard_maps *out) {
  int64_t rows = 0;
  for (int32_t s = 0; s < scene->particles_count; s++) {
    const fum_map *map = scene->particles[s].map;
    int32_t first = 0; /* set that has it */
    while (scene->particles[first].map != map)
      first++;
    begins[s] = first < s ? begins[first] : rows * FUM_MAP_ROW;
    if (map == NULL || first < s) continue;
    out->maps[out->count++] = map;
    rows += fum_billboard_rows(map);
  }
  if (rows * FUM_MAP_ROW <= INT32_MAX) return FUM_OK;
  return fum_fail(scene->context, FUM_ERROR_MEMORY, "maps of %lld texels are too many for OpenGL",
                  (long long)(rows * FUM_MAP_ROW));
}

int32_t fum_arrange_maps(const fum_scene *scene, const fum_octree *octree, const fum_view *view, int64_t count,
                         const uint32_t *ranks, fum_billboard_maps *out_maps) {
  fum_context *context = scene->context;
  const double pixel = fum_view_pixel(view);
  int64_t *begins = NULL;
  int32_t status = fum_alloc(context, scene->particles_count, sizeof *begins, "maps", &begins);
  if (status == FUM_OK)
    status = fum_alloc(context, scene->particles_count, sizeof *out_maps->maps, "maps", &out_maps->maps);
  if (status == FUM_OK) status = fum_alloc(context, count, sizeof *out_maps->looks, "maps", &out_maps->looks);
  if (status == FUM_OK) status = list_maps(scene, begins, out_maps);
  if (status != FUM_OK) goto done;
#pragma omp parallel for num_threads(fum_thread_count(context)) schedule(static)
  for (int64_t n = 0; n < count; n++) {
    if (fum_progress_in_loop(context, n, CHECK_STRIDE)) continue;
    const uint32_t rank = ranks[n], index = octree->indices[rank];
    const fum_particles *set = fum_scene_particles_of(scene, index);
    double center[3];
    if (set->map == NULL) continue;
    to_camera(octree, view, rank, center);
    const double sigma = (double)set->sigmas[index - set->offset];
    const double depth = view->type == FUM_CAMERA_PERSPECTIVE ? fmax(0.0, -center[2]) : 1.0;
    const double width = fmax(sigma, FUM_MIN_SIGMA_PIXELS * pixel * depth);
    fum_map_look_find(set, index - set->offset, view, center, sigma, width, &out_maps->looks[n]);
    out_maps->looks[n].begin += (int32_t)begins[set - scene->particles];
  }
  if (fum_is_cancelled(context)) status = FUM_ERROR_CANCELLED;
done:
  fum_free(context, &begins);
  return status;
}

void fum_arrange_free_maps(fum_context *context, fum_billboard_maps *maps) {
  fum_free(context, &maps->maps);
  fum_free(context, &maps->looks);
}

void fum_arrange_smears(fum_context *context, const fum_smears *smears, int64_t count, const uint32_t *ranks,
                        fum_billboard *billboards, fum_billboard_smear *out_smears) {
#pragma omp parallel for num_threads(fum_thread_count(context)) schedule(static)
  for (int64_t n = 0; n < count; n++) {
    const fum_smear *smear = &smears->items[ranks[n]];
    memcpy(billboards[n].center, smear->center, sizeof smear->center);
    memcpy(out_smears[n].path, smear->path, sizeof smear->path);
    out_smears[n].confusion = smear->confusion;
  }
}
