// GBuffers: surfaces without a normal map.
#include "common/constants.glsl"
#include "common/colour.glsl"
#include "common/material.glsl"
#include "common/gbuffer_write.glsl"

in vec3 normalWorld;

void main() { writeGBuffer(normalize(normalWorld)); }
