// Static light from the light map: surface * lightMap with lightMap = E/pi. Drawn first and without blending: it takes the place of the
// ambient term that the buffers were cleared to.
#include "common/constants.glsl"
#include "common/colour.glsl"
#include "common/gbuffer_read.glsl"

layout(location = 0) out vec4 ambientLight;
layout(location = 1) out vec4 diffuseLight;
layout(location = 2) out vec4 specularLight;

void main() {
  Surface s;
  if (!readSurface(s) || s.hasMap == 0.0) discard;
  ambientLight = vec4(0.0);
  diffuseLight = vec4(s.illuminance * kInvPi, 0.0);
  specularLight = vec4(0.0);
}
