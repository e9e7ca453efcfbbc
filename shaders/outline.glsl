// SPDX-License-Identifier: GPL-3.0-or-later
// Of a particle's footprint: the area that it covers, and what bounds its projection.

const float EULER_GAMMA = 0.5772156649;

// Area that a Gaussian of optical depth `tau` covers, the integral of 1 - exp(-tau(r)), over 2 pi sigma^2: the entire
// exponential integral Ein(tau). Above 1: Abramowitz and Stegun, Handbook of Mathematical Functions, 5.1.56.
float coverage(float tau) {
  if (tau < 1.0) {
    return tau * (1.0 - tau * (1.0 / 4.0 - tau * (1.0 / 18.0 - tau * (1.0 / 96.0 - tau * (1.0 / 600.0 -
           tau * (1.0 / 4320.0 - tau * (1.0 / 35280.0)))))));
  }
  float tail = exp(-tau) / tau * ((tau + 2.334733) * tau + 0.250621) / ((tau + 3.330657) * tau + 1.681534);
  return log(tau) + EULER_GAMMA + tail;
}

// The optical depth whose coverage is `area`.
float depth_of_coverage(float area) {
  if (area < 0.01) return area * (1.0 + area * (0.25 + 0.0694 * area));
  float tau = max(area, exp(area - EULER_GAMMA));
  for (int i = 0; i < 4; i++) tau += (area - coverage(tau)) * tau / (1.0 - exp(-tau));
  return tau;
}

// Slopes between which a disc at (lateral, depth) is seen from the origin; an empty interval when it isn't in front.
// Tangents are kept as directions (x: forward, y: lateral), so that a disc across the camera's plane needs no division.
vec2 slopes(float lateral, float depth, float radius) {
  const float INFINITE = 1e30;
  float tangent = lateral * lateral + (depth - radius) * (depth + radius);
  if (tangent <= 0.0) return vec2(-INFINITE, INFINITE); // the camera is in the disc
  tangent = sqrt(tangent);
  vec2 low = vec2(depth * tangent + lateral * radius, lateral * tangent - depth * radius);
  vec2 high = vec2(depth * tangent - lateral * radius, lateral * tangent + depth * radius);
  if (low.x <= 0.0 && high.x <= 0.0) return vec2(INFINITE, -INFINITE);
  return vec2(low.x > 0.0 ? low.y / low.x : -INFINITE, high.x > 0.0 ? high.y / high.x : INFINITE);
}
