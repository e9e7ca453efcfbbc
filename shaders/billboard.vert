#version 330 core
// SPDX-License-Identifier: GPL-3.0-or-later
// One particle a vertex; the geometry shader does the rest.

layout(location = 0) in vec4 center_sigma;
layout(location = 1) in vec4 depth_source;

out Particle {
  vec4 center_sigma;  // camera space, m
  vec4 depth_source;  // optical depth through the centre, source function
} particle;

void main() {
  particle.center_sigma = center_sigma;
  particle.depth_source = depth_source;
}
