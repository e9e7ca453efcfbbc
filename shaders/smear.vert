// SPDX-License-Identifier: GPL-3.0-or-later
// One particle a vertex, and what the shutter and the lens do to it; the geometry shader does the rest.

layout(location = 0) in vec4 center_sigma;
layout(location = 1) in vec4 depth_source;
layout(location = 2) in vec4 path_confusion;

out Particle {
  vec4 center_sigma;   // camera space, m; the middle of the path
  vec4 depth_source;   // optical depth through the centre, source function
  vec4 path_confusion; // from end to end, m; factor on the aperture of its image, below 0 upside down
} particle;

void main() {
  particle.center_sigma = center_sigma;
  particle.depth_source = depth_source;
  particle.path_confusion = path_confusion;
}
