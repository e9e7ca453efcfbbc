// SPDX-License-Identifier: GPL-3.0-or-later
// Mean optical depth of one Gaussian particle along the ray through the pixel's centre, over the time that the shutter
// is open and over the lens. As in tile_smear_loop.h.

flat in vec4 center_width;
flat in vec4 source_depth;
flat in vec4 path_confusion;
flat in float sigma;

out vec4 color;

uniform bool orthographic;
uniform vec4 window;
uniform vec2 frame_size;
uniform vec2 tile_origin;
uniform vec2 clip_depths;
uniform bool has_solids;
uniform sampler2D solid_depths;
uniform float confusion_per_depth;
uniform vec2 aperture;
uniform sampler2D bokeh_values;
uniform vec3 bokeh_levels[21]; // first row, side, values a unit of length
uniform vec3 bokeh_ratios;     // as of bokeh.h: least, step, most

float normal_share(float z) {
  return z > 0.0 ? 1.0 - tail(z) : tail(-z);
}

// Share of what lies around `place` along the ray that is between the near plane and the nearer of the solid there and
// the far plane. Metres along the ray.
float share_seen(float place, float deviation, float length_per_depth) {
  float far = clip_depths.y;
  if (has_solids) far = min(far, texelFetch(solid_depths, ivec2(gl_FragCoord.xy), 0).r);
  float start = (clip_depths.x * length_per_depth - place) / deviation;
  float end = (far * length_per_depth - place) / deviation;
  return start > -6.0 || end < 6.0 ? share_between(start, end) : 1.0;
}

// A Gaussian swept along its path, `offset` across the ray in its middle and `motion` from end to end; lengths in
// widths, but for those along the ray, in metres.
float swept(vec3 offset, vec3 motion, float place, float pace, float length_per_depth) {
  float squared = dot(motion, motion), product = dot(offset, motion);
  float where = 0.0, spread = 1.0 / 12.0, mean;
  if (squared > 0.01) {
    float len = sqrt(squared), nearest = -product / squared;
    vec3 area = cross(offset, motion);
    float low = (-0.5 - nearest) * len, high = (0.5 - nearest) * len;
    float share = max(share_between(low, high), 1e-30);
    float begin = 0.39894228 * exp(-0.5 * low * low), end = 0.39894228 * exp(-0.5 * high * high);
    float lean = (begin - end) / share;
    mean = exp(-0.5 * dot(area, area) / squared) * share * 2.50662827 / len;
    where = clamp(nearest + lean / len, -0.5, 0.5);
    if (squared > 0.04)
      spread = clamp((1.0 + (low * begin - high * end) / share - lean * lean) / squared, 0.0, 1.0 / 12.0);
  } else {
    mean = exp(-0.5 * dot(offset, offset)) * (1.0 + (product * product - squared) / 24.0);
    where = clamp(-product / 12.0, -0.5, 0.5);
  }
  return mean * share_seen(place + pace * where, sqrt(sigma * sigma + pace * pace * spread), length_per_depth);
}

float look_up(int level, vec2 at) {
  vec3 table = bokeh_levels[level];
  vec2 place = at * table.z + floor(0.5 * table.y);
  if (any(lessThan(place, vec2(0.0))) || any(greaterThan(place, vec2(table.y - 1.001)))) return 0.0;
  ivec2 corner = ivec2(place) + ivec2(0, int(table.x));
  vec2 part = fract(place);
  float a = texelFetch(bokeh_values, corner, 0).r, b = texelFetch(bokeh_values, corner + ivec2(1, 0), 0).r;
  float c = texelFetch(bokeh_values, corner + ivec2(0, 1), 0).r, d = texelFetch(bokeh_values, corner + ivec2(1, 1), 0).r;
  return mix(mix(a, b, part.x), mix(c, d, part.x), part.y);
}

// An image of the aperture at `share` of the path, one of `parts`.
float image(vec2 place, float share, float parts, float length_per_depth) {
  vec3 center = center_width.xyz + share * path_confusion.xyz;
  float scale = orthographic ? 1.0 : -center.z;
  if (!(scale > 0.0)) return 0.0;
  vec2 slope = orthographic ? vec2(0.0) : center.xy / scale;
  vec2 across = (path_confusion.xy + slope * path_confusion.z) / parts;
  float along = path_confusion.z / parts, len = 1.0 + dot(slope, slope), squared = center_width.w * center_width.w;
  float width = squared * (orthographic ? 1.0 : 1.0 + min(4.0 * squared / dot(center, center), 1.0));
  vec3 variances = width * (vec3(1.0, 0.0, 1.0) + vec3(slope.x, slope.x, slope.y) * vec3(slope.x, slope.y, slope.y)) +
                   vec3(across.x, across.x, across.y) * vec3(across.x, across.y, across.y) / 12.0;
  float confusion = path_confusion.w - confusion_per_depth * share * path_confusion.z, radius = abs(confusion);
  float squared_width = sqrt(max(variances.x * variances.z - variances.y * variances.y, 0.0));
  float softest = max(squared_width, radius * radius / (bokeh_ratios.z * bokeh_ratios.z));
  float ratio = max(radius / sqrt(softest), bokeh_ratios.x);
  float level = log(ratio / bokeh_ratios.x) / log(bokeh_ratios.y), before = min(floor(level), 19.0);
  variances.xz += aperture.y * radius * radius + softest - squared_width;
  float area = sqrt(variances.x * variances.z - variances.y * variances.y);
  float unit = (confusion < 0.0 ? -1.0 : 1.0) / (area * sqrt(variances.x + variances.z + 2.0 * area));
  vec2 offset = (place - center.xy / scale) * scale;
  vec2 at = unit * vec2((variances.z + area) * offset.x - variances.y * offset.y,
                        (variances.x + area) * offset.y - variances.y * offset.x);
  float value = mix(look_up(int(before), at), look_up(int(before) + 1, at), min(level - before, 1.0));
  if (!(value > 0.0)) return 0.0;
  float deviation = sqrt(sigma * sigma + along * along * len / 12.0);
  return value * width * sqrt(len) / (area * parts) * share_seen(-center.z * length_per_depth, deviation, length_per_depth);
}

void main() {
  vec2 place = window.xz + (tile_origin + gl_FragCoord.xy) / frame_size * (window.yw - window.xz);
  vec3 ray = orthographic ? vec3(0.0, 0.0, -1.0) : vec3(place, -1.0);
  float length_per_depth = length(ray);
  ray /= length_per_depth;
  vec3 center = orthographic ? center_width.xyz - vec3(place, 0.0) : center_width.xyz;
  vec3 path = path_confusion.xyz;
  float change = abs(0.5 * confusion_per_depth * path.z), most = abs(path_confusion.w) + change;

  float tau;
  if (most <= bokeh_ratios.x * center_width.w) {
    float squared = center_width.w * center_width.w, defocus = aperture.y * path_confusion.w * path_confusion.w;
    float width = sqrt(squared + defocus);
    vec3 offset = cross(center, ray) / width, motion = cross(path, ray) / width;
    tau = squared / (squared + defocus) * swept(offset, motion, dot(center, ray), dot(path, ray), length_per_depth);
  } else {
    float parts = clamp(ceil(length(path) / center_width.w), 1.0, 32.0);
    tau = 0.0;
    for (float part = 0.0; part < parts; part += 1.0)
      tau += image(place, (part + 0.5) / parts - 0.5, parts, length_per_depth);
  }
  tau *= source_depth.a;
  if (!(tau > 0.0)) discard;

  float alpha = opacity(tau);
  color = vec4(source_depth.rgb * alpha, alpha);
}
