// SPDX-License-Identifier: GPL-3.0-or-later
// Optical depth of one Gaussian particle along the ray through the pixel's centre, from the near plane to the nearer of
// the solid there and the far plane: tau exp(-d^2 / (2 sigma^2)) (Phi(t1 / sigma) - Phi(t0 / sigma)).

flat in vec4 gaussian;
flat in vec4 source_depth;
flat in float inverse_sigma;
#ifdef MAPS
flat in vec4 map_across_blend;
flat in vec3 map_up;
flat in ivec4 map_level; // begin, width, height, whether colours count
#endif

out vec4 color;

uniform bool orthographic;
uniform vec4 window;
uniform vec2 frame_size;
uniform vec2 tile_origin;
uniform vec2 clip_depths;
uniform bool has_solids;
uniform sampler2D solid_depths;
#ifdef MAPS
uniform sampler2D maps; // texels of all maps one after the other, in rows

// One level of a map at a place, 0..1 within it: linear between texels, beyond the border as there.
vec4 read_level(int begin, ivec2 size, vec2 place) {
  vec2 at = clamp(place * vec2(size) - 0.5, vec2(0.0), vec2(size - 1));
  ivec2 low = ivec2(at), high = min(low + 1, size - 1);
  vec2 share = at - vec2(low);
  int row = textureSize(maps, 0).x;
  ivec4 places = begin + ivec4(low.y, low.y, high.y, high.y) * size.x + ivec4(low.x, high.x, low.x, high.x);
  vec4 below = mix(texelFetch(maps, ivec2(places.x % row, places.x / row), 0),
                   texelFetch(maps, ivec2(places.y % row, places.y / row), 0), share.x);
  vec4 above = mix(texelFetch(maps, ivec2(places.z % row, places.z / row), 0),
                   texelFetch(maps, ivec2(places.w % row, places.w / row), 0), share.x);
  return mix(below, above, share.y);
}

// Factors of the particle's map on what is scattered and emitted, and on the optical depth.
vec4 read_map(vec2 window_place) {
  ivec2 size = map_level.yz;
  if (size.x == 0) return vec4(1.0);
  vec3 ray = orthographic ? vec3(window_place, 1.0) : normalize(vec3(window_place, 1.0));
  vec2 place = 0.5 + vec2(dot(map_across_blend.xyz, ray), dot(map_up, ray));
  vec4 texel = read_level(map_level.x, size, place);
  if (map_across_blend.w > 0.0) {
    texel = mix(texel, read_level(map_level.x + size.x * size.y, max(size / 2, 1), place), map_across_blend.w);
  }
  return map_level.w != 0 ? texel : texel.aaaa;
}
#endif

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
#ifdef MAPS
  vec4 texel = read_map(place);
  tau *= texel.a;
#endif
  if (!(tau > 0.0)) discard;

  float alpha = opacity(tau);
#ifdef MAPS
  color = vec4(source_depth.rgb * texel.rgb / texel.a * alpha, alpha);
#else
  color = vec4(source_depth.rgb * alpha, alpha);
#endif
}
