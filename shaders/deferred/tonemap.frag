// Exposure, tone curve and encoding: the last pass.
#include "common/constants.glsl"
#include "common/colour.glsl"

layout(location = 0) out vec4 pictureTarget;

uniform sampler2D radianceBuffer;  // unit 0
uniform float exposure;
uniform int toneCurve;  // 0: none, 1: c/(1 + c)
uniform int encode;     // 1: sRGB in [0, 1], else linear as it is

void main() {
  vec3 colour = exposure * texelFetch(radianceBuffer, ivec2(gl_FragCoord.xy), 0).rgb;
  if (toneCurve == 1) colour /= 1.0 + colour;
  if (encode != 0) colour = linearToSrgb(clamp(colour, 0.0, 1.0));
  pictureTarget = vec4(colour, 1.0);
}
