// Needs: constants.glsl, colour.glsl.
// Gives: the G-buffer of this fragment: readSurface(); its place in the world from depth and camera.
uniform sampler2D diffuseBuffer;   // unit 0
uniform sampler2D specularBuffer;  // unit 1
uniform sampler2D normalBuffer;    // unit 2
uniform sampler2D depthBuffer;     // unit 3; x = 0: nothing was drawn there
uniform sampler2D bakedBuffer;     // unit 4

uniform vec3 cameraPosition;
uniform vec3 cameraForward;  // unit
uniform vec3 cameraRight;    // times half the picture's width at depth 1
uniform vec3 cameraUp;       // times half its height
uniform vec2 pixelCount;

struct Surface {
  vec3 albedo;
  float openness;
  vec3 specular;
  float power;
  vec3 normal;
  vec3 position;
  vec3 toCamera;  // unit
  vec3 illuminance;
  float hasMap;  // 1 where a light map holds the static light
};

vec3 positionAt(ivec2 pixel, float depth) {
  vec2 screen = 2.0 * (vec2(pixel) + 0.5) / pixelCount - 1.0;
  return cameraPosition + depth * (cameraForward + screen.x * cameraRight + screen.y * cameraUp);
}

// false: there is no surface
bool readSurface(out Surface s) {
  ivec2 pixel = ivec2(gl_FragCoord.xy);
  float depth = texelFetch(depthBuffer, pixel, 0).x;
  vec4 diffuse = texelFetch(diffuseBuffer, pixel, 0), specular = texelFetch(specularBuffer, pixel, 0);
  vec4 baked = texelFetch(bakedBuffer, pixel, 0);
  s.albedo = diffuse.rgb;
  s.openness = diffuse.a;
  s.specular = specular.rgb;
  s.power = specular.a;
  s.normal = normalize(colourToNormal(texelFetch(normalBuffer, pixel, 0).rgb));
  s.position = positionAt(pixel, depth);
  s.toCamera = normalize(cameraPosition - s.position);
  s.illuminance = baked.rgb;
  s.hasMap = baked.a;
  return depth > 0.0;
}
