// The volume that a point or spot light can reach: a sphere or a cone.
layout(location = 0) in vec3 positionVolume;

uniform mat4 volume;  // to the world
uniform mat4 viewProjection;

void main() { gl_Position = viewProjection * (volume * vec4(positionVolume, 1.0)); }
