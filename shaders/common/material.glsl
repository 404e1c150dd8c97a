// Needs: constants.glsl; the varyings of mesh_in.glsl.
// Gives: material uniforms and their textures as functions of the fragment: baseColor(), metallicRoughness(), specularColor(),
//        specularPower(), emission(), normalColour(), openness(), illuminance().
in vec2 uv0;
in vec2 uv1;
in vec2 mapUv;
in vec4 vertexColor;
in float viewDepth;

uniform sampler2D baseColorTexture;  // unit 0; colour textures give linear values
uniform sampler2D roughnessTexture;  // unit 1; roughness in green, metallic in blue
uniform sampler2D specularTexture;   // unit 2
uniform sampler2D normalTexture;     // unit 3
uniform sampler2D emissionTexture;   // unit 4
uniform sampler2D occlusionTexture;  // unit 5; openness in red
uniform sampler2D lightMap;          // unit 6; E [lx]
uniform sampler2D aoMap;             // unit 7; openness in red

uniform int uvSet[6];  // by texture unit: 0, or 1
uniform mat3 uvTransform[6];
uniform vec4 baseColorFactor;
uniform float metallicFactor;
uniform float roughnessFactor;
uniform vec3 specularFactor;
uniform int dullByRoughness;  // 0: the specular map says all, 1: times 1 - roughness
uniform vec3 emissionFactor;
uniform float normalScale;
uniform float occlusionStrength;
uniform float alphaCutoff;  // below 0: nothing is cut out
uniform float lightMapScale;  // E = texel * scale; 0: the surface has no light map
uniform int useAoMap;         // 1: openness is that of aoMap, not of occlusionTexture

vec2 uvOf(int unit) {
  vec2 uv = uvSet[unit] == 0 ? uv0 : uv1;
  return (uvTransform[unit] * vec3(uv, 1.0)).xy;
}

vec4 baseColor() { return baseColorFactor * vertexColor * texture(baseColorTexture, uvOf(0)); }

// x: metallic, y: roughness
vec2 metallicRoughness() { return vec2(metallicFactor, roughnessFactor) * texture(roughnessTexture, uvOf(1)).bg; }

// A metal shines in its base colour. The peak of a Phong lobe is as high however wide it is: all of a rough wall would shine.
vec3 specularColor(vec3 base, vec2 surface) {
  vec3 specular = specularFactor * texture(specularTexture, uvOf(2)).rgb;
  if (dullByRoughness != 0) specular *= 1.0 - surface.y;
  return mix(specular, base, surface.x);
}

// The power of the Phong lobe that is about as wide as that of this roughness: (2/roughness^4 - 2)/4.
float specularPower(float roughness) {
  float alpha = max(roughness * roughness, 0.03);
  return clamp(0.5 / (alpha * alpha) - 0.5, 1.0, 256.0);
}

vec3 emission() { return emissionFactor * texture(emissionTexture, uvOf(4)).rgb; }

vec3 normalColour() { return texture(normalTexture, uvOf(3)).rgb; }

float openness() {
  if (useAoMap != 0) return texture(aoMap, mapUv).r;
  return 1.0 + occlusionStrength * (texture(occlusionTexture, uvOf(5)).r - 1.0);
}

// E of the light map [lx]
vec3 illuminance() { return lightMapScale * texture(lightMap, mapUv).rgb; }
