// Screen-space ambient occlusion: the share of places in the half ball above a surface that nothing on the screen hides.
#include "common/constants.glsl"
#include "common/colour.glsl"
#include "common/gbuffer_read.glsl"

layout(location = 0) out vec4 screenOpenness;  // x

uniform mat4 viewProjection;
uniform float ssaoRadius;  // [m]

const int kPlaces = 32;

// Place i of a fixed set, denser towards the middle; turned by one of 16 angles, so that 4 x 4 pixels share the work.
vec3 placeInHalfBall(int i, float turn) {
  float share = (float(i) + 0.5) / float(kPlaces);
  float angle = 2.39996323 * float(i) + turn;
  float height = sqrt(1.0 - share), side = sqrt(share);
  float scale = float((i * 7 + 3) % kPlaces + 1) / float(kPlaces);
  return scale * scale * vec3(side * cos(angle), side * sin(angle), height);
}

void main() {
  Surface s;
  screenOpenness = vec4(1.0);
  if (!readSurface(s)) return;
  ivec2 pixel = ivec2(gl_FragCoord.xy);
  float turn = 2.0 * kPi * float((pixel.x % 4) * 4 + pixel.y % 4) / 16.0;
  vec3 aside = abs(s.normal.y) < 0.9 ? vec3(0.0, 1.0, 0.0) : vec3(1.0, 0.0, 0.0);
  vec3 right = normalize(cross(aside, s.normal));
  vec3 up = cross(s.normal, right);
  float hidden = 0.0;
  for (int i = 0; i < kPlaces; ++i) {
    vec3 place = placeInHalfBall(i, turn);
    vec3 position = s.position + ssaoRadius * (place.x * right + place.y * up + (place.z + 0.02) * s.normal);
    vec4 clip = viewProjection * vec4(position, 1.0);
    if (clip.w <= 0.0 || abs(clip.x) >= clip.w || abs(clip.y) >= clip.w) continue;
    ivec2 there = ivec2((0.5 * clip.xy / clip.w + 0.5) * pixelCount);
    float drawn = texelFetch(depthBuffer, there, 0).x;
    float behind = dot(position - cameraPosition, cameraForward) - drawn;
    // What lies farther in front than the radius belongs to something else.
    if (drawn > 0.0 && behind > 0.0 && behind < ssaoRadius) hidden += 1.0;
  }
  screenOpenness = vec4(1.0 - hidden / float(kPlaces));
}
