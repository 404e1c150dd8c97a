// Needs: constants.glsl, gbuffer_read.glsl.
// Gives: the targets of the light passes, which add up; light uniforms; addLight().
layout(location = 0) out vec4 ambientLight;   // openness scales this one alone
layout(location = 1) out vec4 diffuseLight;   // times albedo in the composite pass
layout(location = 2) out vec4 specularLight;  // with the surface's specular colour

uniform vec3 lightAmbient;
uniform vec3 lightDiffuse;
uniform vec3 lightSpecular;
uniform float lightSpecularIntensity;
uniform float lightSpecularPower;  // 0: that of the surface
uniform int lightPhysical;         // 1: lightDiffuse in candela or lux, else what a white surface shows
uniform int lightBaked;            // 1: where there is a light map, it holds all but the specular part

vec3 specularTerm(Surface s, vec3 toLight) {
  if (!(dot(s.normal, toLight) > 0.0)) return vec3(0.0);
  // reflect(incident, normal): the light travels towards the surface.
  vec3 reflected = reflect(-toLight, s.normal);
  float power = lightSpecularPower > 0.0 ? lightSpecularPower : s.power;
  return s.specular * lightSpecularIntensity * pow(saturate(dot(reflected, s.toCamera)), power) * lightSpecular;
}

// toLight: unit, or zero at the light itself
void addLight(Surface s, vec3 toLight, float attenuation) {
  float atRunTime = lightBaked != 0 ? 1.0 - s.hasMap : 1.0;
  ambientLight = vec4(atRunTime * lightAmbient, 0.0);
  diffuseLight = vec4(atRunTime * saturate(dot(s.normal, toLight)) * attenuation * lightDiffuse, 0.0);
  specularLight = vec4(attenuation * specularTerm(s, toLight), 0.0);
}
