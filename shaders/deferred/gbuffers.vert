// GBuffers: surfaces without a normal map.
#include "common/mesh_in.glsl"

out vec3 normalWorld;

void main() {
  placeVertex();
  normalWorld = normalize(normalMatrix * normalMesh);
}
