// SPDX-License-Identifier: GPL-3.0-or-later
// A particle becomes the rectangle of the picture that bounds the projection of its footprint, a sphere.

layout(points) in;
layout(triangle_strip, max_vertices = 4) out;

in Particle {
  vec4 center_sigma;
  vec4 depth_source;
#ifdef MAPS
  vec4 across_blend;
  vec3 up;
  ivec4 level;
#endif
} particle[];

flat out vec4 gaussian;       // centre in camera space, -1 / (2 sigma^2) across the view
flat out vec4 source_depth;   // source function, optical depth through the centre
flat out float inverse_sigma; // 1 / sigma along the view
#ifdef MAPS
flat out vec4 map_across_blend;
flat out vec3 map_up;
flat out ivec4 map_level;
#endif

uniform bool orthographic;
uniform vec4 window;    // left, right, bottom, top at unit depth or in metres
uniform vec2 frame_size; // pixels
uniform vec2 tile_origin;
uniform vec2 tile_size;
uniform vec2 clip_depths;
uniform float footprint_sigmas;

// The smallest sigma drawn, in pixels. Pixels sample the Gaussian at their centres; by Poisson's summation formula the
// sum of the samples differs from the integral by up to 4 exp(-2 pi^2 s^2): 0.3 % at 0.6, but 3 % at 0.5.
const float MIN_SIGMA_PIXELS = 0.6;

void emit(vec2 corner, vec4 out_gaussian, vec4 out_source_depth, float out_inverse_sigma) {
  gaussian = out_gaussian;
  source_depth = out_source_depth;
  inverse_sigma = out_inverse_sigma;
#ifdef MAPS
  map_across_blend = particle[0].across_blend;
  map_up = particle[0].up;
  map_level = particle[0].level;
#endif
  gl_Position = vec4(corner, 0.0, 1.0); // depth 0: the near plane is the fragment shader's business
  EmitVertex();
}

void main() {
  vec3 center = particle[0].center_sigma.xyz;
  float sigma = particle[0].center_sigma.w;
  float optical_depth = particle[0].depth_source.x;
  float depth = -center.z;
  vec2 pixel = (window.yw - window.xz) / frame_size;

  // A particle thinner than the pixels would fall between their centres or light one up at random. It is widened, and
  // its optical depth lowered so that the area it covers stays: the mean of the picture is that of infinitely many
  // samples a pixel. For thin particles this is optical depth times sigma^2 staying the same.
  float width = max(sigma, MIN_SIGMA_PIXELS * max(pixel.x, pixel.y) * (orthographic ? 1.0 : max(depth, 0.0)));
  if (width > sigma) {
    float share = sigma / width;
    optical_depth = depth_of_coverage(coverage(optical_depth) * share * share);
  }

  // Whatever a particle's optical depth, no more of it lies outside than of a thin one (fum_footprint).
  float radius = sqrt(footprint_sigmas * footprint_sigmas + 2.0 * log(max(optical_depth, 1.0))) * width;
  if (depth + radius <= clip_depths.x || depth - radius >= clip_depths.y) return;
  vec2 x = center.x + vec2(-radius, radius);
  vec2 y = center.y + vec2(-radius, radius);
  if (!orthographic) {
    x = slopes(center.x, depth, radius);
    y = slopes(center.y, depth, radius);
  }
  vec2 low = ((vec2(x.x, y.x) - window.xz) / pixel - tile_origin) / tile_size * 2.0 - 1.0;
  vec2 high = ((vec2(x.y, y.y) - window.xz) / pixel - tile_origin) / tile_size * 2.0 - 1.0;
  low = max(low, vec2(-1.0));
  high = min(high, vec2(1.0));
  if (!(low.x < high.x && low.y < high.y)) return;

  vec4 out_gaussian = vec4(center, -0.5 / (width * width));
  vec4 out_source_depth = vec4(particle[0].depth_source.yzw, optical_depth);
  emit(low, out_gaussian, out_source_depth, 1.0 / sigma);
  emit(vec2(high.x, low.y), out_gaussian, out_source_depth, 1.0 / sigma);
  emit(vec2(low.x, high.y), out_gaussian, out_source_depth, 1.0 / sigma);
  emit(high, out_gaussian, out_source_depth, 1.0 / sigma);
  EndPrimitive();
}
