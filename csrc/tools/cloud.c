/* SPDX-License-Identifier: GPL-3.0-or-later */
#include "tools/cloud.h"

#include <math.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>

/* The scenes: their own number of particles, optical depth and overlap. */
static const struct scene {
  const char *name;
  int64_t count;
  double depth, overlap;
} SCENES[] = {
    {"plume", 250000, 8.0, 0.7}, {"ball", 2000, 5.0, 0.5}, {"puff", 1, 3.0, 0.0},
    {"six", 6, 3.0, 0.0},        {"mixed", 300, 5.0, 0.5}, {"edge", 2000, 5.0, 0.5},
};

int cloud_allocate(int64_t count, cloud *out_cloud) {
  const size_t n = (size_t)(count > 0 ? count : 1);
  cloud c = {.count = count};
  c.positions = malloc(3 * n * sizeof *c.positions);
  c.radii = malloc(n * sizeof *c.radii);
  c.densities = malloc(n * sizeof *c.densities);
  if (c.positions == NULL || c.radii == NULL || c.densities == NULL) {
    cloud_free(&c);
    return 1;
  }
  *out_cloud = c;
  return 0;
}

void cloud_free(cloud *c) {
  free(c->positions);
  free(c->radii);
  free(c->densities);
  free(c->albedos);
  *c = (cloud){0};
}

void cloud_scale(cloud *c, double grow, double dense) {
  for (int64_t i = 0; i < c->count; i++) {
    c->radii[i] = (float)((double)c->radii[i] * grow);
    c->densities[i] = (float)((double)c->densities[i] * dense / grow);
  }
}

void cloud_frame(cloud *c) {
  double lower[3] = {INFINITY, INFINITY, INFINITY}, upper[3] = {-INFINITY, -INFINITY, -INFINITY}, squared = 0.0;
  for (int64_t i = 0; i < 3 * c->count; i++) {
    lower[i % 3] = fmin(lower[i % 3], (double)c->positions[i]);
    upper[i % 3] = fmax(upper[i % 3], (double)c->positions[i]);
  }
  for (int axis = 0; axis < 3; axis++) {
    c->middle[axis] = c->count > 0 ? 0.5 * (lower[axis] + upper[axis]) : 0.0;
    const double side = c->count > 0 ? upper[axis] - lower[axis] : 1.0;
    squared += side * side;
  }
  c->radius = fmax(0.5 * sqrt(squared), 1e-3);
}

static const struct scene *find_scene(const char *name) {
  for (size_t i = 0; i < sizeof SCENES / sizeof SCENES[0]; i++) {
    if (strcmp(SCENES[i].name, name) == 0) return &SCENES[i];
  }
  return NULL;
}

int cloud_make(const char *name, int64_t count, double depth, double overlap, cloud *out_cloud, char out_error[256]) {
  const struct scene *scene = find_scene(name);
  if (scene == NULL) {
    snprintf(out_error, 256, "there is no scene %s", name);
    return 1;
  }
  const int is_puffs = strcmp(name, "puff") == 0 || strcmp(name, "six") == 0;
  if (is_puffs && count > scene->count) {
    snprintf(out_error, 256, "the scene %s has at most %lld particles", name, (long long)scene->count);
    return 1;
  }
  if (cloud_allocate(count >= 0 ? count : scene->count, out_cloud) != 0) {
    snprintf(out_error, 256, "no memory for the particles");
    return 1;
  }
  out_cloud->depth = depth > 0.0 ? depth : scene->depth;
  out_cloud->overlap = overlap > 0.0 ? overlap : scene->overlap;
  out_cloud->has_wall = strcmp(name, "edge") == 0;
  if (strcmp(name, "plume") == 0) {
    cloud_fill_plume(out_cloud);
  } else if (is_puffs) {
    cloud_fill_puffs(out_cloud);
  } else {
    cloud_fill_ball(out_cloud, strcmp(name, "mixed") == 0 ? 30.0 : 1.0);
  }
  return 0;
}
