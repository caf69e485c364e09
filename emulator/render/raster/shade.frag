#version 330 core
// Light that leaves a surface, as the native caster's core has it (shading/lights.inl), without shadows or mirrors.
// LIGHTS is replaced by a number when the program is built.

centroid in vec3 world_position;
centroid in vec3 world_normal;
centroid in vec3 texture_coordinate;
out vec4 result;

const int FLAT = 0, CUBE = 1;
const int SPOT = 0, DIRECTIONAL = 1;  // LightKind

uniform bool find_hits;     // geom and distance instead of light
uniform float geom;         // its index + 1, 0 for the sky
uniform bool sky;           // painted as it is; texture 1 by direction
uniform bool orthographic;
uniform vec3 look;          // the camera's

uniform vec3 albedo;        // linear
uniform int texture_kind;   // FLAT, CUBE or -1
uniform sampler2D flat_texture;
uniform samplerCube cube_texture;
uniform float alpha, emission, specular, exponent;

uniform int light_count;
uniform vec3 light_position[LIGHTS];
uniform vec3 light_direction[LIGHTS];
uniform vec3 light_diffuse[LIGHTS];
uniform vec3 light_specular[LIGHTS];
uniform vec3 light_ambient[LIGHTS];
uniform vec3 light_attenuation[LIGHTS];
uniform vec3 light_cone[LIGHTS];   // cosine of the cutoff, exponent, of physical lights 1 / width of the edge, else 0
uniform float light_fade[LIGHTS];  // of physical lights 1 / range^2, else 0
uniform int light_kind[LIGHTS];

const vec3 LUMINANCE = vec3(0.2126, 0.7152, 0.0722);  // BT.709

// Trilinear; the level follows the area that a pixel covers, as the caster's does.
vec3 texel() {
  if (texture_kind == FLAT) {
    vec2 at = texture_coordinate.xy * vec2(textureSize(flat_texture, 0));
    float area = abs(determinant(mat2(dFdx(at), dFdy(at))));
    return textureLod(flat_texture, texture_coordinate.xy, 0.5 * log2(max(area, 1.0))).rgb;
  }
  vec3 d = texture_coordinate;
  if (sky) {
    d = orthographic ? look : world_position;
    d = vec3(d.x, d.z, -d.y);
  }
  vec3 on_cube = d / max(max(abs(d.x), abs(d.y)), max(abs(d.z), 1e-30));
  vec3 at = on_cube * (0.5 * float(textureSize(cube_texture, 0).x));
  float area = length(cross(dFdx(at), dFdy(at)));
  return textureLod(cube_texture, d, 0.5 * log2(max(area, 1.0))).rgb;
}

float strength_of(int i, vec3 to_light, vec3 towards) {
  if (light_kind[i] == DIRECTIONAL) return 1.0;
  float square = max(dot(to_light, to_light), 1e-12);
  vec3 a = light_attenuation[i];
  float strength = 1.0 / max(a.x + a.y * sqrt(square) + a.z * square, 1e-12);
  if (light_fade[i] > 0.0) {
    float share = square * light_fade[i], left = max(1.0 - share * share, 0.0);
    strength *= left * left;
  }
  if (light_kind[i] != SPOT) return strength;
  float cosine = -dot(towards, light_direction[i]);
  if (cosine < light_cone[i].x) return 0.0;
  if (light_cone[i].z > 0.0) {
    float inside = min((cosine - light_cone[i].x) * light_cone[i].z, 1.0);
    return strength * inside * inside;
  }
  float power = light_cone[i].y;
  return power > 0.0 ? strength * pow(clamp(cosine, 1e-30, 1.0), power) : strength;
}

void main() {
  vec3 ray = orthographic ? look : normalize(world_position);
  if (find_hits) {
    result = vec4(geom, dot(world_position, ray), 0.0, 1.0);
    return;
  }
  vec3 colour = texture_kind < 0 ? albedo : albedo * texel();
  if (sky) {
    result = vec4(dot(colour, LUMINANCE), 0.0, 0.0, 1.0);
    return;
  }
  vec3 normal = normalize(world_normal);
  // smooth normals may turn away from the ray at a silhouette
  if (dot(normal, ray) > 0.0) normal = -normal;
  // a texture colours the gloss too
  vec3 gloss_colour = texture_kind < 0 ? vec3(1.0) : colour;
  vec3 light = colour * emission;
  for (int i = 0; i < light_count; i++) {
    vec3 to_light = light_position[i] - world_position;
    vec3 towards = light_kind[i] == DIRECTIONAL ? -light_direction[i]
                                                : to_light / sqrt(max(dot(to_light, to_light), 1e-12));
    float strength = strength_of(i, to_light, towards);
    float cosine = dot(towards, normal);
    light += colour * strength * light_ambient[i];
    if (cosine <= 0.0 || strength <= 0.0) continue;
    light += colour * cosine * strength * light_diffuse[i];
    // Blinn-Phong
    float lobe = clamp(dot(normalize(towards - ray), normal), 1e-30, 1.0);
    light += gloss_colour * pow(lobe, exponent) * specular * strength * light_specular[i];
  }
  result = vec4(dot(light, LUMINANCE), 0.0, 0.0, alpha);
}
