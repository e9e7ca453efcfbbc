#version 330 core
// SPDX-License-Identifier: GPL-3.0-or-later
// Optical depth of one Gaussian particle along the ray through the pixel's centre, from the near plane to the nearer of
// the solid there and the far plane: tau exp(-d^2 / (2 sigma^2)) (Phi(t1 / sigma) - Phi(t0 / sigma)).

flat in vec4 gaussian;
flat in vec4 source_depth;
flat in float inverse_sigma;

out vec4 color;

uniform bool orthographic;
uniform vec4 window;
uniform vec2 frame_size;
uniform vec2 tile_origin;
uniform vec2 clip_depths;
uniform bool has_solids;
uniform sampler2D solid_depths;

// Upper tail of the normal distribution, 1 - Phi(x), for x >= 0. The complementary error function is the Chebyshev fit
// of Press and others, Numerical Recipes, section 6.2: relative error below 1.2e-7 everywhere.
float tail(float x) {
  float z = 0.70710678 * x;
  float t = 1.0 / (1.0 + 0.5 * z);
  float fit = t * (1.00002368 + t * (0.37409196 + t * (0.09678418 + t * (-0.18628806 + t * (0.27886807 +
              t * (-1.13520398 + t * (1.48851587 + t * (-0.82215223 + t * 0.17087277))))))));
  return 0.5 * t * exp(-z * z - 1.26551223 + fit);
}

// Phi(end) - Phi(start), on the side of the distribution where the difference doesn't cancel.
float share_between(float start, float end) {
  if (start >= end) return 0.0;
  if (start >= 0.0) return tail(start) - tail(end);
  if (end <= 0.0) return tail(-end) - tail(-start);
  return 1.0 - tail(-start) - tail(end);
}

// 1 - exp(-tau), also for a tau that would vanish beside 1.
float opacity(float tau) {
  if (tau < 0.1) return tau * (1.0 - tau / 2.0 * (1.0 - tau / 3.0 * (1.0 - tau / 4.0 * (1.0 - tau / 5.0))));
  return 1.0 - exp(-tau);
}

void main() {
  vec2 place = window.xz + (tile_origin + gl_FragCoord.xy) / frame_size * (window.yw - window.xz);
  vec3 ray = orthographic ? vec3(0.0, 0.0, -1.0) : vec3(place, -1.0);
  vec3 center = orthographic ? gaussian.xyz - vec3(place, 0.0) : gaussian.xyz;

  // The ray advances by 1 along the camera's axis, so `depth` is that of its point nearest to the centre.
  float depth = dot(center, ray) / dot(ray, ray);
  vec3 offset = center - depth * ray;
  float tau = source_depth.a * exp(dot(offset, offset) * gaussian.w);

  float far = clip_depths.y;
  if (has_solids) far = min(far, texelFetch(solid_depths, ivec2(gl_FragCoord.xy), 0).r);
  float sigmas_per_depth = length(ray) * inverse_sigma;
  float start = (clip_depths.x - depth) * sigmas_per_depth;
  float end = (far - depth) * sigmas_per_depth;
  if (start > -6.0 || end < 6.0) tau *= share_between(start, end);
  if (!(tau > 0.0)) discard;

  float alpha = opacity(tau);
  color = vec4(source_depth.rgb * alpha, alpha);
}
