// GBuffersBump: surfaces with a normal map.
#include "common/mesh_in.glsl"

uniform float worldMirror;  // sign of the determinant of `world`: -1 turns the bitangent about

out vec3 normalWorld;
out vec3 tangentWorld;
out vec3 bitangentWorld;

void main() {
  placeVertex();
  normalWorld = normalize(normalMatrix * normalMesh);
  // Tangents lie in the surface and go with the world matrix; a scale that differs by axis leaves them no longer at right angles.
  vec3 tangent = mat3(world) * tangentMesh.xyz;
  tangentWorld = normalize(tangent - dot(normalWorld, tangent) * normalWorld);
  bitangentWorld = cross(normalWorld, tangentWorld) * tangentMesh.w * worldMirror;
}
