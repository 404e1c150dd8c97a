// GBuffersBump: surfaces with a normal map, in tangent space or in the space of the mesh.
#include "common/constants.glsl"
#include "common/colour.glsl"
#include "common/material.glsl"
#include "common/gbuffer_write.glsl"

uniform int objectSpaceNormals;
uniform mat3 normalMatrix;

in vec3 normalWorld;
in vec3 tangentWorld;
in vec3 bitangentWorld;

void main() {
  vec3 normal = colourToNormal(normalColour());
  if (objectSpaceNormals != 0) {
    writeGBuffer(normalize(normalMatrix * normal));
    return;
  }
  normal.xy *= normalScale;
  // Not made unit again before use: tangents are made for vectors that are interpolated as they are.
  writeGBuffer(normalize(normal.x * tangentWorld + normal.y * bitangentWorld + normal.z * normalWorld));
}
