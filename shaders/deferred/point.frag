// A point light, over its sphere, or over the whole screen where it is endless.
#include "common/constants.glsl"
#include "common/colour.glsl"
#include "common/gbuffer_read.glsl"
#include "common/attenuation.glsl"
#include "common/lighting.glsl"

uniform vec3 lightPosition;

void main() {
  Surface s;
  if (!readSurface(s)) discard;
  vec3 toLight = lightPosition - s.position;
  float distance = length(toLight);
  float attenuation = lightPhysical != 0 ? inverseSquare(distance) * kInvPi : classicAttenuation(distance);
  addLight(s, distance > 0.0 ? toLight / distance : vec3(0.0), attenuation);
}
