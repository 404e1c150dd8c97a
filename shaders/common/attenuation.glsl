// Needs: constants.glsl.
// Gives: classicAttenuation(), inverseSquare(), spotCone() of the light whose uniforms stand here. Distances in metres.
uniform vec3 lightAttenuation;  // constant, linear, quadratic; a light of range alone has 1, 2/range, 1/(range * range)
uniform float lightRange;       // 0: endless
uniform float lightRangePower;
uniform vec2 lightCone;  // cosines of the inner and the outer angle

// 1/(c + l d + q d^2) * saturate(1 - (d/range)^power); the difference is saturated, so that the light ends at its range.
float classicAttenuation(float distance) {
  float denominator = lightAttenuation.x + lightAttenuation.y * distance + lightAttenuation.z * distance * distance;
  float window = lightRange > 0.0 ? saturate(1.0 - pow(distance / lightRange, lightRangePower)) : 1.0;
  return denominator > 0.0 ? window / denominator : 0.0;
}

// KHR_lights_punctual: window/d^2
float inverseSquare(float distance) {
  float share = lightRange > 0.0 ? distance / lightRange : 0.0;
  float window = saturate(1.0 - share * share * share * share);
  float square = distance * distance;
  return square > 0.0 ? window / square : 0.0;
}

// KHR_lights_punctual
float spotCone(float cosine) {
  float s = saturate((cosine - lightCone.y) / max(0.001, lightCone.x - lightCone.y));
  return s * s;
}
