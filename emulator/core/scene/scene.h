// What the kernels read: plain structures, the scene's constant part and one tick's frame.
// Everything is in the camera's frame (x right, y up, looking along -z) or in a geom's own frame.
#pragma once

#include <cstdint>

namespace evs {

enum Shape { PLANE = 0, HFIELD, SPHERE, CAPSULE, ELLIPSOID, CYLINDER, BOX, MESH };
enum LightKind { SPOT = 0, DIRECTIONAL, POINT, IMAGE };

struct V3 {
  float x, y, z;
};

// Two children in one node: both boxes are tested with one fetch.
struct Node {
  float low[2][3], high[2][3];
  int32_t child[2];  // >= 0: node; < 0: leaf, ~child is the first triangle
  int32_t count[2];  // triangles in the leaf
};

struct Triangle {
  V3 a, b, c;  // its corners, the same numbers in every triangle that shares them
  V3 normal;   // (b - a) x (c - a): out of the front, twice the area long
};

// Per corner of each triangle, in the BVH's order.
struct Corners {
  V3 normal[3];
  float uv[3][2];
  float density;  // texture lengths per m: sqrt(area in uv / area)
};

struct Mesh {
  const Node* nodes;
  const Triangle* triangles;
  const Corners* corners;
  int node_count;  // 0: nothing to hit
  bool has_texcoords;
  V3 center;  // of a ball around everything
  float radius;
};

// An image chain, linear light, channel-planar: a level has width x height (x 6 faces) texels
// and around each image a rim of one more, in which it repeats or, with 6 faces, its edge goes on.
// Columns and rows of the image count from 1, those of the rim are 0 and the last. Each texel has
// the one below it at its side, so that four around a point are one load.
constexpr int MAX_LEVELS = 16;
struct TextureLevel {
  int width, height;
  int offset;  // in its plane
  int stride;  // from row to row
};
struct Texture {
  const float* texels;
  int channel_stride;  // texels of a plane
  int channels;        // planes of texels
  float mean;          // luminance
  int levels;
  int faces;  // 1 or 6
  TextureLevel level[MAX_LEVELS];

  long at(int channel, int index, int face, int row, int column) const {
    const TextureLevel& l = level[index];
    long rows = static_cast<long>(face) * (l.height + 1) + row;
    return 2 * (static_cast<long>(channel) * channel_stride + l.offset + rows * l.stride + column);
  }
};

constexpr int MAX_CHANNELS = 5;
constexpr float MIN_ROUGHNESS = 0.045f;  // a lobe narrower than this is below float's precision

struct Surface {
  float albedo[MAX_CHANNELS];  // linear; with a texture it is already inside the texels
  float emission;              // times albedo
  float specular;              // Blinn-Phong strength, linear
  float exponent;              // Blinn-Phong exponent
  float reflectance;           // mirror share; only opaque surfaces are mirrors
  float alpha;                 // 1: opaque
  bool physical;               // GGX; else classic, Blinn-Phong
  float metallic;              // physical only: 0 dielectric ... 1 metal
  float roughness;             // physical only: its square is the width of the GGX lobe
  float alpha_ggx;             // width of the GGX lobe; classic: of a lobe as wide as Blinn-Phong's
  float f0;                    // classic: specular reflectance at normal incidence, grey
  int texture;                 // -1 none
  float repeat[2];
  bool uniform;
  bool layered;  // has any of these maps: textures, -1 none
  int metallic_map, roughness_map, occlusion_map, opacity_map;  // one channel
  int normal_map;                                               // three channels
  int emissive_map;                                             // as the base texture
};

// One geom in this tick.
struct alignas(64) Geom {
  float rotation[9];  // row-major, geom to camera
  V3 position;        // of the geom, in the camera's frame
  V3 camera;          // of the camera, in the geom's frame (computed in double)
  float size[3];
  int shape;
  int mesh;
  int surface;
};

struct Light {
  int kind;
  bool castshadow;
  V3 position, direction;  // camera frame; direction is where the light goes, unit
  float ambient[MAX_CHANNELS], diffuse[MAX_CHANNELS], specular[MAX_CHANNELS];
  float attenuation[3];
  float cos_cutoff, exponent;
  float radius;         // of the bulb, m; `direct` has points
  bool inverse_square;  // physical intensity: 1 / r^2 instead of attenuation
  float fade;           // 1 / range^2: physical light ends at its range; 0: nowhere
  float edge;           // 1 / (cosine of the full cone - cos_cutoff), physical spots; 0: exponent
  int texture;          // of an image light
  // which of the first 32 geoms are planes with the light on their front, one bit each: light from
  // there never comes through one
  uint32_t idle;
  // irradiance of an image light over pi, by the normal in the world's frame: the factors of
  // 1, y, z, x, xy, yz, 3z^2 - 1, xz, x^2 - y^2
  float harmonics[MAX_CHANNELS][9];
};

// Fog hides what is far; haze is a band below the horizon of an infinite plane.
struct Air {
  bool fog, haze;
  float fog_end, fog_slope;  // clear share at distance r: (fog_end - r) * fog_slope, 0 ... 1
  float fog_color[MAX_CHANNELS];
  float haze_color[MAX_CHANNELS];
  float haze_ratio, haze_radius, haze_peak;  // the cone's: reach inwards, rim, height of the peak
  V3 haze_up;                                // the plane's normal, camera frame
  float haze_elevation;                      // of the camera above the plane, in rims
};

// A region that bundles rays: a ball of origins (center, radius), opened by an angle, up to
// `length`.
struct Hull {
  V3 center, axis;
  float radius, length, cosine, sine;
};

struct Bounds {  // bounding spheres, structure of arrays, padded to 16
  const float *x, *y, *z, *radius;
  int count;  // padded
};

struct Ball {
  V3 center;
  float radius;  // negative: empty
};

struct Frame {
  const Geom* geoms;
  int geom_count, plane_count;  // planes come first
  Ball around;                  // everything but the planes
  Ball mirrored;                // that in the only plane as a mirror; radius FAR: more planes
  Bounds bounds;
  const Mesh* meshes;
  const Surface* surfaces;
  const Texture* textures;
  const Light* lights;
  int light_count;
  int skybox;             // texture, -1 none
  float sky_rotation[9];  // row-major, camera to world
  Air air;
  bool shadows;
  bool lobes;  // a surface is physical or has maps, or paths are traced: GGX lobes are asked for
  bool bumpy;  // a surface has a normal map
  // 1: luminance, as every light is grey; 3: RGB; 4: both, if grey; one more: `plain`, the
  // luminance with every texture replaced by its mean
  int channels;
  int colour;                   // where RGB begins
  float weights[MAX_CHANNELS];  // luminance of each channel

  int width, height;
  float fx, fy, cx, cy;
  bool orthographic;
  const float* lens;   // (height + 1, width + 1, 3) ray at each pixel's corners; null: a pinhole
  const float* share;  // (height, width) factor of a pixel's light; null: all 1
  float pixel_angle;   // footprint of a sample at the image's centre: rad, or m (orthographic)
  int samples;
  const float* sample_x;  // sub-pixel positions, 0 ... 1
  const float* sample_y;
  float pixel_x, pixel_y;  // what a sample covers of a plane at depth 1: m
  int probes;              // at which an image is read for one sample, at most; 0: as in mirrors
  // where one sample stands for the pixel, images are read at `taps` points
  int taps;
  const float *tap_x, *tap_y;  // px from the sample
  float tap_width;             // footprint of one, as a share of the sample's
  const Hull* primary;  // (packet rows, packet columns): the hull of each packet's primary rays
  const Hull* pairs;    // (packet rows, packet columns / 2): of two side by side; or null
  int packet_columns;
};

constexpr int PACKET_WIDTH = 4, PACKET_HEIGHT = 4;

// A box of points that grows; as a ball it is where shadow and mirror rays start.
struct Region {
  V3 low = {1e30f, 1e30f, 1e30f}, high = {-1e30f, -1e30f, -1e30f};
  float step = 0;  // how far the points were moved off their surfaces, at most
};

struct Trail {  // what a packet's secondary rays covered, over all its samples
  Region seen, mirrored;
  V3 mirror_axis = {0, 0, 0};
  float mirror_spread = -1;  // largest squared chord to the axis; negative: no mirror was met
};

// Packets that are asked together, 4 x 4 of them.
constexpr int BLOCK_WIDTH = 4, BLOCK_HEIGHT = 4;

// Where the rays of a block's packets went when each was last traced whole, and so what can change
// them; one column a packet.
struct alignas(64) RayBlock {
  float primary[9][16];   // hull of the camera rays: center, axis, radius, cosine, sine
  float seen[4][16];      // ball around what they see: center, radius; negative: nothing
  float mirrored[4][16];  // the same of what their mirrors show
  float mirror[6][16];    // hull of mirror rays, which start in `seen`: axis, radius (negative:
                          // none), cosine, sine
  uint32_t packets;       // that there are, one bit each
};

// What a packet keeps to be lit again, if all its pixels show one geom and no mirror image.
struct KeptPatch {
  float* numbers;  // (1 + 2 channels, 16) distance, albedo, light; null: nothing is to be kept
  int lights;      // that light is of the first ones
  int32_t* geom;   // negative: nothing is
};

// Where to note what a packet met.
struct Record {
  RayBlock* block;
  int column;    // in the block
  Trail* trail;  // what the block's column is made of
  KeptPatch patch;
};

struct Rod;  // path_scene.h

// What is not as it was in the last tick.
struct Change {
  const Rod* rods;      // around geoms that moved, before and now
  Bounds balls;         // around each of them
  Ball around;          // around all of them
  const Light* lights;  // as they were; null: all stayed
};

// Packets of a block, one bit each, that what is not as it was may change.
struct Needs {
  uint32_t met;     // something that moved comes near the rays of their pixels
  uint32_t traced;  // those, and where that may be in a mirror
  uint32_t lit;     // of the others: where a light or a shadow may have
};

struct Outputs {
  float* luminance;   // (h, w)
  float* rgb;         // (h, w, 3) linear; or null
  float* plain;       // the channel of that name, with a margin of one pixel; or null
  long plain_stride;  // of its rows
};

// What the ray through each pixel's centre hits first.
struct Truth {
  int32_t* geom;       // (h, w) index of the geom, -1 none
  float* distance;     // (h, w) along the ray, m; infinite where nothing is hit
  float* point;        // (h, w, 3) camera frame, m; where nothing is hit: the ray's direction
  float* normal;       // (h, w, 3) camera frame, unit, facing the ray; 0 where nothing is hit
  int32_t* triangle;   // (h, w) of a mesh, -1 none
  float* barycentric;  // (h, w, 2) shares of the triangle's second and third corner
};

struct KeptLight;
struct PathBatch;
struct PathFrame;
struct ProbeLanes;
struct ProbeSurface;  // path_scene.h

// One instruction set's entry points.
struct Kernel {
  // Trace the 16 pixels of packet (column, row) and write them.
  void (*trace)(const Frame&, int column, int row, const Outputs&, const Record* record);
  // The same for the packets `column`, which is even, and `column` + 1, at once: no record. Null:
  // packet by packet is as fast.
  void (*trace_pair)(const Frame&, int column, int row, const Outputs&);
  // The same light as `trace` of a packet whose rays go where they went, from what it keeps.
  void (*relight)(const Frame&, int column, int row, const Outputs&, const KeptPatch*);
  // The same for `column` and `column` + 1, of one geom and as many lights each; or null.
  void (*relight_pair)(const Frame&, int column, int row, const Outputs&, const KeptPatch*);
  // Luminance of up to 16 pixels anywhere, the same as `trace` gives them, In: x, y (count);
  // and the channel `plain` (count), or null.
  void (*trace_pixels)(const Frame&, const int32_t* x, const int32_t* y, int count,
                       float* luminance, float* plain);
  // How far 16 pixels are to be refined, 0 ... 1. In: `plain` of their 3 x 3 neighbours, row-major,
  // 16 numbers each. Out: weight (16).
  void (*weigh)(const float* const* neighbours, float* weight);
  // All samples of some pixels of packet (column, row). In: pixels, one bit each; record, to which
  // their rays are added, or null. Out: luminance (16) and rgb (16, 3) or null, where a bit is set.
  void (*refine)(const Frame&, int column, int row, unsigned pixels, float* luminance, float* rgb,
                 const Record* record);
  // Ground truth of the 16 pixels of packet (column, row).
  void (*trace_truth)(const Frame&, int column, int row, const Truth&);
  // Which packets of a block can have changed.
  void (*ask)(const Frame&, const RayBlock&, const Change&, Needs&);
  // `trace` for paths, which leave no record, but a whole row of packets. The batch is theirs
  // while they run.
  void (*trace_path_row)(const Frame&, const PathFrame&, PathBatch&, int row, const Outputs&);
  void (*trace_path_pixels)(const Frame&, const PathFrame&, PathBatch&, const int32_t* x,
                            const int32_t* y, int count, float* luminance);
  // The units of packet rows begin ... end that may have changed, and their pixels. Out: samples
  // traced.
  long (*retrace_paths)(const Frame&, const PathFrame&, PathBatch&, const KeptLight&, int begin,
                        int end, const Outputs&);
  // The samplers of paths for their tests, 16 draws at once: see probe.h.
  void (*probe_points)(int mode, int seed, int digits, int index, int dimension, const int* pixel,
                       float* x, float* y);
  void (*probe_scatter)(const ProbeSurface&, const float* numbers, ProbeLanes&);
  void (*probe_evaluate)(const ProbeSurface&, ProbeLanes&);
  void (*probe_aim)(const Frame&, const PathFrame&, const float* point, bool sky,
                    const float* numbers, ProbeLanes&);
  void (*probe_told)(const Frame&, const PathFrame&, const float* point, ProbeLanes&);
};

extern const Kernel KERNEL_PORTABLE, KERNEL_AVX2, KERNEL_AVX512;
// Its parts in 32 lanes.
void trace_pair_avx512(const Frame&, int column, int row, const Outputs&);
void relight_pair_avx512(const Frame&, int column, int row, const Outputs&, const KeptPatch*);
void trace_path_row_avx512(const Frame&, const PathFrame&, PathBatch&, int row, const Outputs&);
void trace_path_pixels_avx512(const Frame&, const PathFrame&, PathBatch&, const int32_t* x,
                              const int32_t* y, int count, float* luminance);
long retrace_paths_avx512(const Frame&, const PathFrame&, PathBatch&, const KeptLight&, int begin,
                          int end, const Outputs&);

}  // namespace evs
