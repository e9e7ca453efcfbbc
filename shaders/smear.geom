// SPDX-License-Identifier: GPL-3.0-or-later
// A smeared particle becomes the rectangle of the picture that bounds the projection of its footprint on all of its
// path, out of focus as it is at both ends.

layout(points) in;
layout(triangle_strip, max_vertices = 4) out;

in Particle {
  vec4 center_sigma;
  vec4 depth_source;
  vec4 path_confusion;
} particle[];

flat out vec4 center_width;   // camera space, m; sigma across the view
flat out vec4 source_depth;   // source function, optical depth through the centre
flat out vec4 path_confusion; // as of the particle
flat out float sigma;         // along the view

uniform bool orthographic;
uniform vec4 window;
uniform vec2 frame_size;
uniform vec2 tile_origin;
uniform vec2 tile_size;
uniform vec2 clip_depths;
uniform float footprint_sigmas;
uniform float confusion_per_depth;
uniform vec2 aperture; // how far out it reaches, the mean of its second moments along both axes

// As in billboard.geom.
const float MIN_SIGMA_PIXELS = 0.6;

// Optical depth of a particle that the shutter and the lens spread over a larger area: over all instants and points of
// the lens the mean of what it hides stays that of the particle.
float spread_depth(float optical_depth, vec3 center, vec4 path, float width) {
  vec2 slope = orthographic ? vec2(0.0) : center.xy / max(-center.z, width);
  vec2 across = path.xy + slope * path.z;
  float variance = width * width + aperture.y * path.w * path.w;
  float share = width * width / sqrt(variance * (variance + dot(across, across) / 12.0));
  return optical_depth > 0.0 ? depth_of_coverage(coverage(optical_depth) * share) / share : 0.0;
}

// Slopes, or in an orthographic view metres, between which both ends are seen, of radii around them.
vec2 extent(vec2 lateral, vec2 depths, vec2 radii) {
  if (orthographic) {
    return vec2(min(lateral.x - radii.x, lateral.y - radii.y), max(lateral.x + radii.x, lateral.y + radii.y));
  }
  vec2 step = vec2(lateral.y - lateral.x, depths.y - depths.x);
  float along = clamp(-dot(vec2(lateral.x, depths.x), step) / max(dot(step, step), 1e-30), 0.0, 1.0);
  vec2 first = slopes(lateral.x, depths.x, radii.x), second = slopes(lateral.y, depths.y, radii.y);
  bool is_around = length(vec2(lateral.x, depths.x) + along * step) <= max(radii.x, radii.y);
  if (is_around || first.x > first.y || second.x > second.y) return vec2(-1e30, 1e30);
  return vec2(min(first.x, second.x), max(first.y, second.y));
}

void emit(vec2 corner, vec4 out_center, vec4 out_source, float out_sigma) {
  center_width = out_center;
  source_depth = out_source;
  path_confusion = particle[0].path_confusion;
  sigma = out_sigma;
  gl_Position = vec4(corner, 0.0, 1.0);
  EmitVertex();
}

void main() {
  vec3 center = particle[0].center_sigma.xyz;
  vec4 path = particle[0].path_confusion;
  float along_sigma = particle[0].center_sigma.w;
  float optical_depth = particle[0].depth_source.x;
  float depth = -center.z;
  vec2 pixel = (window.yw - window.xz) / frame_size;
  float width = max(along_sigma, MIN_SIGMA_PIXELS * max(pixel.x, pixel.y) * (orthographic ? 1.0 : max(depth, 0.0)));
  if (width > along_sigma) {
    float share = along_sigma / width;
    optical_depth = depth_of_coverage(coverage(optical_depth) * share * share);
  }
  float radius = sqrt(footprint_sigmas * footprint_sigmas + 2.0 * log(max(optical_depth, 1.0))) * width;

  // The part of the path on which it reaches between the clip planes.
  vec2 reached = vec2(clip_depths.x - radius, clip_depths.y + radius) - depth;
  vec2 shares = vec2(-0.5, 0.5);
  float pace = -path.z;
  if (pace == 0.0 && (reached.x >= 0.0 || reached.y <= 0.0)) return;
  if (pace > 0.0) shares = vec2(max(-0.5, reached.x / pace), min(0.5, reached.y / pace));
  if (pace < 0.0) shares = vec2(max(-0.5, reached.y / pace), min(0.5, reached.x / pace));
  if (shares.x > shares.y) return;

  vec2 depths = depth + shares * pace;
  vec2 radii = radius + aperture.x * abs(path.w + confusion_per_depth * (depths - depth));
  vec2 x = extent(center.x + shares * path.x, depths, radii);
  vec2 y = extent(center.y + shares * path.y, depths, radii);
  vec2 low = ((vec2(x.x, y.x) - window.xz) / pixel - tile_origin) / tile_size * 2.0 - 1.0;
  vec2 high = ((vec2(x.y, y.y) - window.xz) / pixel - tile_origin) / tile_size * 2.0 - 1.0;
  low = max(low, vec2(-1.0));
  high = min(high, vec2(1.0));
  if (!(low.x < high.x && low.y < high.y)) return;

  vec4 out_center = vec4(center, width);
  vec4 out_source = vec4(particle[0].depth_source.yzw, spread_depth(optical_depth, center, path, width));
  emit(low, out_center, out_source, along_sigma);
  emit(vec2(high.x, low.y), out_center, out_source, along_sigma);
  emit(vec2(low.x, high.y), out_center, out_source, along_sigma);
  emit(high, out_center, out_source, along_sigma);
  EndPrimitive();
}
