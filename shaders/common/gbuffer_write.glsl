// Needs: constants.glsl, colour.glsl, material.glsl.
// Gives: the targets of the G-buffer; writeGBuffer() fills them and cuts holes.
layout(location = 0) out vec4 diffuseTarget;   // albedo; a: openness (AO)
layout(location = 1) out vec4 specularTarget;  // specular colour; a: power
layout(location = 2) out vec4 normalTarget;    // world normal as a colour; a: 1
layout(location = 3) out vec4 depthTarget;     // x: view depth [m]
layout(location = 4) out vec4 bakedTarget;     // E of the light map [lx]; a: 1 where there is one
layout(location = 5) out vec4 emissionTarget;  // [cd/m^2]

void writeGBuffer(vec3 normalWorld) {
  vec4 base = baseColor();
  if (base.a < alphaCutoff) discard;
  vec2 surface = metallicRoughness();
  diffuseTarget = vec4(base.rgb * (1.0 - surface.x), openness());
  specularTarget = vec4(specularColor(base.rgb, surface), specularPower(surface.y));
  // The back of a double-sided surface has its normal the other way.
  normalTarget = vec4(normalToColour(gl_FrontFacing ? normalWorld : -normalWorld), 1.0);
  depthTarget = vec4(viewDepth, 0.0, 0.0, 1.0);
  bakedTarget = lightMapScale > 0.0 ? vec4(illuminance(), 1.0) : vec4(0.0);
  emissionTarget = gl_FrontFacing ? vec4(emission(), 1.0) : vec4(0.0);
}
