// Surface times light: radiance = albedo * (ambient * AO + diffuse) + specular + emission.
#include "common/constants.glsl"
#include "common/colour.glsl"
#include "common/gbuffer_read.glsl"

layout(location = 0) out vec4 radianceTarget;

uniform sampler2D emissionBuffer;  // unit 5
uniform sampler2D ambientBuffer;   // unit 6
uniform sampler2D lightBuffer;     // unit 7: diffuse
uniform sampler2D shineBuffer;     // unit 8: specular
uniform sampler2D ssaoBuffer;      // unit 9
uniform vec3 backgroundRadiance;   // where nothing was drawn [cd/m^2]
uniform int useBakedAo;
uniform int useScreenAo;
uniform float ssaoRadius;

// Mean over the 4 x 4 pixels that share the work, of those that lie at about the same depth.
float screenOpenness(ivec2 pixel) {
  float depth = texelFetch(depthBuffer, pixel, 0).x, sum = 0.0, count = 0.0;
  for (int y = -2; y < 2; ++y)
    for (int x = -2; x < 2; ++x) {
      ivec2 there = clamp(pixel + ivec2(x, y), ivec2(0), ivec2(pixelCount) - 1);
      float drawn = texelFetch(depthBuffer, there, 0).x;
      if (drawn == 0.0 || abs(drawn - depth) > ssaoRadius) continue;
      sum += texelFetch(ssaoBuffer, there, 0).x;
      count += 1.0;
    }
  return sum / count;
}

void main() {
  ivec2 pixel = ivec2(gl_FragCoord.xy);
  Surface s;
  if (!readSurface(s)) {
    radianceTarget = vec4(backgroundRadiance, 1.0);
    return;
  }
  float ao = 1.0;
  if (useBakedAo != 0) ao *= s.openness;
  if (useScreenAo != 0) ao *= screenOpenness(pixel);
  vec3 ambient = texelFetch(ambientBuffer, pixel, 0).rgb, diffuse = texelFetch(lightBuffer, pixel, 0).rgb;
  vec3 specular = texelFetch(shineBuffer, pixel, 0).rgb, emitted = texelFetch(emissionBuffer, pixel, 0).rgb;
  radianceTarget = vec4(s.albedo * (ambient * ao + diffuse) + specular + emitted, 1.0);
}
