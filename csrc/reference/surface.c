/* SPDX-License-Identifier: GPL-3.0-or-later */
#include "reference/surface.h"

#include "base/vector.h"

/* What one light sends to a surface. */
typedef struct receiver {
  const fum_reference_world *world;
  const fum_light_desc *light;
  double position[3], normal[3];
  double irradiance[3]; /* as a factor on the light's colour */
} receiver;

static void add_shine(void *user, const fum_shine *shine) {
  receiver *s = user;
  const double *p = s->position, *u = shine->direction, *n = s->normal;
  const double cosine = u[0] * n[0] + u[1] * n[1] + u[2] * n[2];
  double depths[3] = {0.0};
  if (!(cosine > 0.0) || fum_is_cancelled(s->world->context)) return;
  if (s->light->casts_shadows != 0) {
    const uint64_t sets = s->light->shadow_sets;
    const fum_vec3 from = {(float)p[0], (float)p[1], (float)p[2]}, towards = {(float)u[0], (float)u[1], (float)u[2]};
    if (fum_solids_occlude(s->world->solids, sets, from, towards, (float)shine->distance)) return;
    const fum_way way = {{p[0], p[1], p[2]}, {u[0], u[1], u[2]}, shine->distance};
    fum_smoke_depth(s->world->smoke, &way, sets, depths);
  }
  for (int c = 0; c < 3; c++)
    s->irradiance[c] += cosine * shine->strength * exp(-depths[c]);
}

void fum_reference_surface_shine(const fum_reference_world *world, const fum_solid_point *point,
                                 const double position[3], double distance, double out_radiance[3]) {
  const double lift = 3e-5 * distance;
  const double flat[3] = {(double)point->normal.x, (double)point->normal.y, (double)point->normal.z};
  const double smooth[3] = {(double)point->smooth.x, (double)point->smooth.y, (double)point->smooth.z};
  const fum_mesh *mesh = &world->smoke->scene->meshes[point->mesh];
  for (int c = 0; c < 3; c++)
    out_radiance[c] = (double)mesh->emission[c];
  for (int32_t i = 0; i < world->lamp_count; i++) {
    receiver s = {.world = world, .light = world->lamps[i].desc};
    if ((s.light->light_sets >> mesh->light_set & 1U) == 0) continue;
    for (int axis = 0; axis < 3; axis++) {
      s.normal[axis] = smooth[axis];
      s.position[axis] = position[axis] + lift * flat[axis];
    }
    fum_reference_lamp_visit(&world->lamps[i], s.position, add_shine, &s);
    for (int c = 0; c < 3; c++)
      out_radiance[c] += (double)mesh->albedo[c] / FUM_PI * (double)s.light->intensity[c] * s.irradiance[c];
  }
}
