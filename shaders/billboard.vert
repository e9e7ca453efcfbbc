// SPDX-License-Identifier: GPL-3.0-or-later
// One particle a vertex; the geometry shader does the rest.

layout(location = 0) in vec4 center_sigma;
layout(location = 1) in vec4 depth_source;
#ifdef MAPS
layout(location = 2) in vec4 map_across_blend;
layout(location = 3) in vec3 map_up;
layout(location = 4) in ivec4 map_level;
#endif

out Particle {
  vec4 center_sigma;  // camera space, m
  vec4 depth_source;  // optical depth through the centre, source function
#ifdef MAPS
  vec4 across_blend;  // as of fum_map_look
  vec3 up;
  ivec4 level;        // begin, width, height, whether colours count
#endif
} particle;

void main() {
  particle.center_sigma = center_sigma;
  particle.depth_source = depth_source;
#ifdef MAPS
  particle.across_blend = map_across_blend;
  particle.up = map_up;
  particle.level = map_level;
#endif
}
