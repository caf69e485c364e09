#version 330 core
// A corner of a triangle: into the world, whose origin is the camera, and onto the image.

layout(location = 0) in vec3 position;
layout(location = 1) in vec3 normal;
layout(location = 2) in vec4 coordinate;
layout(location = 3) in mat4 instance;

uniform mat4 M, V, P;

// centroid: where a pixel is covered in part, the values are those of the part
centroid out vec3 world_position;
centroid out vec3 world_normal;
centroid out vec3 texture_coordinate;

void main() {
  mat4 to_world = M * instance;
  vec4 world = to_world * vec4(position, 1.0);
  gl_Position = P * V * world;
  world_position = world.xyz;
  // poses only turn and move
  world_normal = mat3(to_world) * normal;
  texture_coordinate = coordinate.xyz;
}
