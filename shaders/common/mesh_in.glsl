// Needs: nothing. For vertex shaders of the G-buffer passes.
// Gives: the attributes of a vertex in the space of its mesh, the uniforms that place it, and its varyings but for the normal's;
//        placeVertex() fills gl_Position and these varyings.
layout(location = 0) in vec3 positionMesh;
layout(location = 1) in vec3 normalMesh;
layout(location = 2) in vec4 tangentMesh;  // w: determinant, -1 where UVs are mirrored
layout(location = 3) in vec2 uv0Mesh;
layout(location = 4) in vec2 uv1Mesh;
layout(location = 5) in vec2 mapUvMesh;
layout(location = 6) in vec4 colorMesh;

uniform mat4 world;
uniform mat3 normalMatrix;  // inverse transpose of the upper left of `world`
uniform mat4 viewProjection;
uniform vec3 cameraPosition;
uniform vec3 cameraForward;  // unit

out vec2 uv0;
out vec2 uv1;
out vec2 mapUv;
out vec4 vertexColor;
out float viewDepth;  // along cameraForward [m]

void placeVertex() {
  vec4 positionWorld = world * vec4(positionMesh, 1.0);
  uv0 = uv0Mesh;
  uv1 = uv1Mesh;
  mapUv = mapUvMesh;
  vertexColor = colorMesh;
  viewDepth = dot(positionWorld.xyz - cameraPosition, cameraForward);
  gl_Position = viewProjection * positionWorld;
}
