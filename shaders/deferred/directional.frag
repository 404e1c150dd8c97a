// A directional light, over the whole screen.
#include "common/constants.glsl"
#include "common/colour.glsl"
#include "common/gbuffer_read.glsl"
#include "common/lighting.glsl"

uniform vec3 lightDirection;  // unit; the way its light travels

void main() {
  Surface s;
  if (!readSurface(s)) discard;
  addLight(s, -lightDirection, lightPhysical != 0 ? kInvPi : 1.0);
}
