/* SPDX-License-Identifier: GPL-3.0-or-later */
#include "pass/places.h"

fum_sight fum_look(const fum_solids *solids, const fum_view *view, double x, double y) {
  fum_sight s;
  fum_view_ray(view, x, y, s.start, s.direction);
  const fum_vec3 from = {(float)s.start[0], (float)s.start[1], (float)s.start[2]};
  const fum_vec3 along = {(float)s.direction[0], (float)s.direction[1], (float)s.direction[2]};
  s.depth = fum_solids_see(solids, from, along, (float)view->clip_start, (float)view->clip_end, &s.solid);
  return s;
}
