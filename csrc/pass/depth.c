/* SPDX-License-Identifier: GPL-3.0-or-later */
#include "pass/depth.h"

#include "billboard/map_look.h"
#include "lighting/pairs.h"
#include "octree/beam.h"

#include <omp.h>
#include <stdlib.h>

static const float HALF_DEPTH = 0.69314718F; /* ln 2 */

enum { TILE = 8, BLOCK = 64 };

/* A particle that a tile's rays meet. */
typedef struct heard {
  float along; /* m along the beam */
  uint32_t particle;
} heard;

/* Neighbours along the beam, summed together. */
typedef struct block {
  float first, last;  /* m along the beam, of the centres */
  float widest_sigma; /* m */
  float whole_depth;  /* optical depth of all of it along the pixel's line; NAN until somebody asks */
} block;

/* A particle with a map among those that were heard. */
typedef struct mapped {
  int64_t place; /* in the arrays */
  const fum_map *map;
  fum_map_look look;
} mapped;

/* One thread's tile: the particles near its rays, sorted along them. */
typedef struct tile {
  const fum_scene *scene;
  const fum_view *view;
  const fum_octree *octree;
  const fum_pairs *pairs;
  fum_beam beam;
  float bend; /* largest |direction - axis| */
  heard *heard;
  int64_t count, capacity;
  float *arrays; /* x, y, z, inverse sigma, optical depth, each block_count * BLOCK long */
  block *blocks;
  int64_t block_count, block_capacity;
  bool has_maps;
  mapped *mapped; /* [mapped_count], room for `capacity` if there are maps */
  int64_t mapped_count;
  bool is_out_of_memory;
  fum_depth_of of;
} tile;

static bool collect(void *user, const fum_octree_node *node, float reach) {
  tile *t = user;
  const uint32_t begin = node->begin, end = begin + node->count;
  const int64_t needed = t->count + (end - begin);
  if (needed > t->capacity) {
    heard *grown = realloc(t->heard, (size_t)(2 * needed) * sizeof *grown);
    if (grown == NULL) {
      t->is_out_of_memory = true;
      return false;
    }
    t->heard = grown;
    if (t->has_maps) {
      mapped *more = realloc(t->mapped, (size_t)(2 * needed) * sizeof *more);
      if (more == NULL) {
        t->is_out_of_memory = true;
        return false;
      }
      t->mapped = more;
    }
    t->capacity = 2 * needed;
  }
  const fum_octree *octree = t->octree;
  for (uint32_t i = begin; i < end; i++) {
    const fum_vec3 d = fum_sub((fum_vec3){octree->x[i], octree->y[i], octree->z[i]}, t->beam.start);
    const float s = fum_dot(d, t->beam.axis);
    const fum_vec3 offset = fum_mad(t->beam.axis, -s, d);
    if (fum_length(offset) > 1.00001F * fum_beam_hearing(&t->beam, s, reach)) continue;
    t->heard[t->count++] = (heard){s, i};
  }
  return true;
}

static int compare_along(const void *a, const void *b) {
  const heard *x = a, *y = b;
  if (x->along != y->along) return x->along < y->along ? -1 : 1;
  return (x->particle > y->particle) - (x->particle < y->particle);
}

static bool grow_blocks(tile *t) {
  t->block_count = (t->count + BLOCK - 1) / BLOCK;
  if (t->block_count <= t->block_capacity) return true;
  const size_t capacity = (size_t)(2 * t->block_count);
  float *arrays = realloc(t->arrays, 5 * BLOCK * capacity * sizeof *arrays);
  if (arrays != NULL) t->arrays = arrays;
  block *blocks = realloc(t->blocks, capacity * sizeof *blocks);
  if (blocks != NULL) t->blocks = blocks;
  if (arrays == NULL || blocks == NULL) return false;
  t->block_capacity = (int64_t)capacity;
  return true;
}

/* Sorts what was heard and lays it out in blocks for the loops. */
static bool lay_out(tile *t) {
  if (!grow_blocks(t)) return false;
  qsort(t->heard, (size_t)t->count, sizeof *t->heard, compare_along);
  const fum_octree *octree = t->octree;
  const int64_t stride = t->block_count * BLOCK;
  const float *from[5] = {octree->x, octree->y, octree->z, octree->inverse_sigmas, octree->optical_depths};
  for (int a = 0; a < 5; a++) {
    float *to = t->arrays + a * stride;
    for (int64_t i = 0; i < t->count; i++)
      to[i] = from[a][t->heard[i].particle];
    for (int64_t i = t->count; i < stride; i++)
      to[i] = a == 3 ? 1.0F : 0.0F;
  }
  for (int64_t b = 0; b < t->block_count; b++) {
    const int64_t begin = b * BLOCK, end = begin + BLOCK < t->count ? begin + BLOCK : t->count;
    float narrowest = INFINITY;
    for (int64_t i = begin; i < end; i++)
      narrowest = fminf(narrowest, t->arrays[3 * stride + i]);
    t->blocks[b] = (block){t->heard[begin].along, t->heard[end - 1].along, 1.0F / narrowest, NAN};
  }
  return true;
}

/* Notes which of those that were heard have maps, and how these are seen. */
static void find_maps(tile *t) {
  const fum_octree *octree = t->octree;
  t->mapped_count = 0;
  for (int64_t i = 0; i < t->count && t->has_maps; i++) {
    const uint32_t rank = t->heard[i].particle, index = octree->indices[rank];
    const fum_particles *set = fum_scene_particles_of(t->scene, index);
    if (set->map == NULL) continue;
    const double local[3] = {(double)octree->x[rank], (double)octree->y[rank], (double)octree->z[rank]};
    const double sigma = 1.0 / (double)octree->inverse_sigmas[rank];
    double center[3];
    mapped *m = &t->mapped[t->mapped_count++];
    fum_transform_point(t->view->camera_from_local, local, center);
    m->place = i;
    m->map = set->map;
    fum_map_look_find(set, index - set->offset, t->view, center, sigma, sigma, &m->look);
  }
}

/* Gives particles with maps the optical depth that they have where the pixel's ray passes. */
static void read_maps(tile *t, int32_t x, int32_t y) {
  const fum_view *view = t->view;
  const double *w = view->window;
  const float u = (float)(w[0] + (w[1] - w[0]) * (x + 0.5) / view->width);
  const float v = (float)(w[2] + (w[3] - w[2]) * (y + 0.5) / view->height);
  const float inverse_length = view->type == FUM_CAMERA_PERSPECTIVE ? 1.0F / sqrtf(1.0F + u * u + v * v) : 1.0F;
  float *depths = t->arrays + 4 * t->block_count * BLOCK;
  for (int64_t n = 0; n < t->mapped_count; n++) {
    const mapped *m = &t->mapped[n];
    const float place[2] = {0.5F + fum_map_across(m->look.across, u, v) * inverse_length,
                            0.5F + fum_map_across(m->look.up, u, v) * inverse_length};
    const float depth = t->octree->optical_depths[t->heard[m->place].particle];
    depths[m->place] = depth * fum_map_read(m->map, &m->look, place[0], place[1])[3];
  }
}

static float sum_block(const tile *t, fum_pairs_fn loop, const fum_segment *segment, int64_t b) {
  const int64_t stride = t->block_count * BLOCK;
  const float *a = t->arrays + b * BLOCK;
  const fum_sources sources = {BLOCK, a, a + stride, a + 2 * stride, a + 3 * stride, a + 4 * stride};
  return loop(&sources, segment);
}

/* Optical depth along the segment. Blocks that lie well within it are summed once for each pixel. */
static float depth_along(tile *t, const fum_segment *segment) {
  const float clear_sigmas = 5.0F;
  float depth = 0.0F;
  for (int64_t i = 0; i < t->block_count; i++) {
    block *b = &t->blocks[i];
    const float clear = clear_sigmas * b->widest_sigma + t->bend * (fabsf(b->first) + fabsf(b->last) + segment->length);
    if (b->first - clear > segment->length) continue;
    if (b->first - clear > 0.0F && b->last + clear < segment->length) {
      if (isnan(b->whole_depth)) b->whole_depth = sum_block(t, t->pairs->line, segment, i);
      depth += b->whole_depth;
    } else {
      depth += sum_block(t, t->pairs->segment, segment, i);
    }
  }
  return depth;
}

/* The optical depth that is looked for on a ray with that of `whole`; above it where it isn't reached. */
static float wanted_depth(fum_depth_of of, float whole) {
  static const float shares[] = {
      [FUM_DEPTH_OF_FRONT] = 0.05F, [FUM_DEPTH_OF_MIDDLE] = 0.5F, [FUM_DEPTH_OF_BACK] = 0.95F};
  const float unseen = 1e-4F;
  if (of == FUM_DEPTH_OF_HALF) return HALF_DEPTH;
  return whole > unseen ? -log1pf(shares[of] * expm1f(-whole)) : INFINITY;
}

/* Length along the segment at which the optical depth is the one looked for; its whole length if it isn't reached.
 * Bisection with regula falsi (Illinois) where the depth grows steadily. */
static float find_length(tile *t, fum_segment segment) {
  for (int64_t i = 0; i < t->block_count; i++)
    t->blocks[i].whole_depth = NAN;
  const float whole = depth_along(t, &segment), wanted = wanted_depth(t->of, whole);
  float low = 0.0F, high = segment.length;
  float below = -wanted, above = whole - wanted;
  if (!(above >= 0.0F)) return segment.length;
  for (int step = 0; step < 60 && high - low > 1e-5F * high; step++) {
    const float ratio = step % 3 == 2 ? 0.5F : below / (below - above);
    segment.length = low + (high - low) * fminf(fmaxf(ratio, 0.02F), 0.98F);
    const float excess = depth_along(t, &segment) - wanted;
    if (fabsf(excess) < 1e-5F) return segment.length;
    if (excess < 0.0F) {
      low = segment.length;
      below = excess;
    } else {
      high = segment.length;
      above = excess;
    }
  }
  return 0.5F * (low + high);
}

/* A pixel's ray. It starts where the smoke may begin, so that floats stay precise for a camera far away. */
typedef struct pixel_ray {
  double start_depth, depth_per_metre, length; /* depth along the camera's axis */
  fum_segment segment;
} pixel_ray;

static pixel_ray make_ray(const fum_view *view, double x, double y, double near, double far) {
  double start[3], direction[3];
  fum_view_ray(view, x, y, start, direction);
  const double speed = sqrt(direction[0] * direction[0] + direction[1] * direction[1] + direction[2] * direction[2]);
  pixel_ray ray = {.start_depth = near, .depth_per_metre = 1.0 / speed, .length = (far - near) * speed};
  for (int axis = 0; axis < 3; axis++) {
    ray.segment.origin[axis] = (float)(start[axis] + near * direction[axis]);
    ray.segment.direction[axis] = (float)(direction[axis] / speed);
  }
  ray.segment.length = (float)ray.length;
  return ray;
}

/* Depths between which the octree's box, widened by its reach, lies. */
static void find_extent(const fum_octree *octree, float reach, const fum_view *view, double extent[2]) {
  const fum_octree_node *root = &octree->nodes[0];
  double middle[3], camera[3], radius = (double)reach;
  for (int axis = 0; axis < 3; axis++)
    middle[axis] = 0.5 * ((double)root->lower[axis] + (double)root->upper[axis]);
  radius += 0.5 * hypot(hypot((double)(root->upper[0] - root->lower[0]), (double)(root->upper[1] - root->lower[1])),
                        (double)(root->upper[2] - root->lower[2]));
  fum_transform_point(view->camera_from_local, middle, camera);
  extent[0] = fmax(view->clip_start, -camera[2] - radius);
  extent[1] = fmin(view->clip_end, -camera[2] + radius);
}

/* The beam of the tile's rays: from its middle pixel's ray, as wide as the corners'. */
static void find_beam(tile *t, const fum_view *view, const int32_t corner[2], const int32_t size[2],
                      const double extent[2]) {
  const pixel_ray axis = make_ray(view, corner[0] + 0.5 * size[0], corner[1] + 0.5 * size[1], extent[0], extent[1]);
  const float *u = axis.segment.direction, *o = axis.segment.origin;
  t->beam = (fum_beam){{o[0], o[1], o[2]}, {u[0], u[1], u[2]}, 0.0F, axis.segment.length, 0.0F, 0.0F};
  t->bend = 0.0F;
  for (int c = 0; c < 4; c++) {
    const double x = corner[0] + (c % 2 == 0 ? 0 : size[0]), y = corner[1] + (c / 2 == 0 ? 0 : size[1]);
    const pixel_ray ray = make_ray(view, x, y, extent[0], extent[1]);
    const float *v = ray.segment.direction, *p = ray.segment.origin;
    const fum_vec3 offset = {p[0] - o[0], p[1] - o[1], p[2] - o[2]}, turn = {v[0] - u[0], v[1] - u[1], v[2] - u[2]};
    t->beam.radius = fmaxf(t->beam.radius, 1.0001F * fum_length(offset));
    t->bend = fmaxf(t->bend, 1.0001F * fum_length(turn));
    t->beam.last = fmaxf(t->beam.last, ray.segment.length);
  }
  t->beam.first = -t->beam.radius;
  t->beam.slope = 2.0F * t->bend; /* the tangent of the small angle, with room */
}

static void find_tile(tile *t, const float *reaches, const float *solid_depths, int32_t x0, int32_t y0,
                      float *out_depths) {
  const fum_view *view = t->view;
  const int32_t corner[2] = {x0, y0};
  const int32_t size[2] = {view->width - x0 < TILE ? view->width - x0 : TILE,
                           view->height - y0 < TILE ? view->height - y0 : TILE};
  double extent[2];
  find_extent(t->octree, reaches[0], view, extent);
  t->count = 0;
  if (extent[0] < extent[1]) {
    find_beam(t, view, corner, size, extent);
    fum_beam_walk(t->octree, reaches, 0, &t->beam, collect, t);
    if (t->is_out_of_memory || (t->count > 0 && !lay_out(t))) {
      t->is_out_of_memory = true;
      return;
    }
    find_maps(t);
  }
  for (int32_t y = y0; y < y0 + size[1]; y++) {
    for (int32_t x = x0; x < x0 + size[0]; x++) {
      const int64_t pixel = (int64_t)y * view->width + x;
      const double solid = solid_depths != NULL ? (double)solid_depths[pixel] : view->clip_end;
      out_depths[pixel] = (float)solid;
      const double far = fmin(extent[1], solid);
      if (t->count == 0 || far <= extent[0]) continue;
      const pixel_ray ray = make_ray(view, x + 0.5, y + 0.5, extent[0], far);
      read_maps(t, x, y);
      const float length = find_length(t, ray.segment);
      if (length < ray.segment.length) {
        out_depths[pixel] = (float)(ray.start_depth + (double)length * ray.depth_per_metre);
      }
    }
  }
}

static void free_tile(tile *t) {
  free(t->heard);
  free(t->arrays);
  free(t->blocks);
  free(t->mapped);
}

int32_t fum_depth_find(const fum_scene *scene, const fum_octree *octree, const float *reaches, const fum_view *view,
                       const float *solid_depths, fum_depth_of of, float *out_depths) {
  fum_context *context = scene->context;
  const int64_t across = (view->width + TILE - 1) / TILE, count = across * ((view->height + TILE - 1) / TILE);
  if (octree->node_count == 0) {
    const int64_t pixels = (int64_t)view->width * view->height;
    for (int64_t i = 0; i < pixels; i++)
      out_depths[i] = solid_depths != NULL ? solid_depths[i] : (float)view->clip_end;
    return FUM_OK;
  }
  atomic_int_least64_t tiles_done = 0;
  atomic_bool is_out_of_memory = false;
#pragma omp parallel num_threads(fum_thread_count(context))
  {
    tile t = {.scene = scene,
              .view = view,
              .octree = octree,
              .pairs = fum_pairs_get(),
              .has_maps = fum_scene_map_traits(scene).has_maps,
              .of = of};
#pragma omp for schedule(dynamic)
    for (int64_t i = 0; i < count; i++) {
      if (fum_is_cancelled(context) || atomic_load(&is_out_of_memory)) continue;
      find_tile(&t, reaches, solid_depths, (int32_t)(i % across) * TILE, (int32_t)(i / across) * TILE, out_depths);
      if (t.is_out_of_memory) atomic_store(&is_out_of_memory, true);
      const int64_t done = atomic_fetch_add(&tiles_done, 1) + 1;
      if (omp_get_thread_num() == 0) {
        (void)fum_progress_report(context, FUM_STAGE_PASSES, (float)done / (float)count, "Finding depth");
      }
    }
    free_tile(&t);
  }
  if (atomic_load(&is_out_of_memory))
    return fum_fail(context, FUM_ERROR_MEMORY, "Depth: no memory for a tile's particles");
  return fum_is_cancelled(context) ? FUM_ERROR_CANCELLED : FUM_OK;
}
