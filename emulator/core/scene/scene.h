// What the kernels read, in plain structures: the scene's constant part and one tick's frame.
// Everything is in the camera's frame (x right, y up, looking along -z) or in a geom's own frame.
#pragma once

#include <cstdint>

namespace evs {

enum Shape { PLANE = 0, HFIELD, SPHERE, CAPSULE, ELLIPSOID, CYLINDER, BOX, MESH };

struct V3 {
  float x, y, z;
};

// Two children per node: both boxes are tested with one fetch.
struct Node {
  float low[2][3], high[2][3];
  int32_t child[2];  // >= 0: node; < 0: leaf, ~child is the first triangle
  int32_t count[2];  // triangles in the leaf
};

struct Triangle {
  V3 a, b, c;  // its corners, bitwise equal in all triangles that share them
  V3 normal;   // (b - a) x (c - a): outward, twice the area long
};

// Corners of each triangle, in the BVH's order.
struct Corners {
  V3 normal[3];
  float uv[3][2];
  float uv_density;  // image lengths per m: sqrt(area in uv / area)
};

struct Mesh {
  const Node* nodes;
  const Triangle* triangles;
  const Corners* corners;
  int node_count;  // 0: nothing to hit
  bool has_texcoords;
  V3 center;  // of the bounding sphere
  float radius;
};

// A mip chain in linear light, channel by channel. A level has width x height (x 6 faces) texels,
// and around each image a rim of one texel, in which it repeats or, with 6 faces, its edge is
// extended. Rows and columns of the image count from 1; the rim is 0 and the last. Each texel is
// stored beside the one below it, so the four around a point are one load. Level 0 of a large image
// is not among them: its texels are bytes.
constexpr int MAX_LEVELS = 16;
struct TextureLevel {
  int width, height;
  int offset;  // in its plane
  int stride;  // from row to row
};
// One axis of a tiled image, which is constant between a few lines: a checker, a grid, one colour.
constexpr int MAX_TILES = 4;
struct TileAxis {
  int count;                // 0: the image is not tiled
  float start;              // where the first tile begins, image lengths
  float offset[MAX_TILES];  // where each begins, from there
  float width[MAX_TILES];   // together 1
};
struct Texture {
  const float* texels;
  int channel_stride;  // texels of a plane
  int channels;        // planes of texels
  float mean;          // luminance
  // of a cube: by how much the slope of the light changes from texel to texel at most, as a share
  // of the light and 1 DN; 1: by more
  float bend;
  int levels;
  int faces;  // 1 or 6
  TextureLevel level[MAX_LEVELS];
  // of level 0 of a large image, with its rim: red, green and blue, the lowest byte first; or null
  const uint32_t* words;
  const float* decoded;                 // (3, 256) linear light of each byte
  TileAxis columns, rows;               // of a 2D image
  float tile[4][MAX_TILES][MAX_TILES];  // channel, row, column

  long at(int channel, int index, int face, int row, int column) const {
    const TextureLevel& l = level[index];
    long rows = static_cast<long>(face) * (l.height + 1) + row;
    return 2 * (static_cast<long>(channel) * channel_stride + l.offset + rows * l.stride + column);
  }
};

constexpr int MAX_CHANNELS = 5;
constexpr float MIN_ROUGHNESS = 0.045f;  // narrower lobes exceed float precision

struct Surface {
  float albedo[MAX_CHANNELS];  // linear; with a texture it is baked into the texels
  float emission;              // times albedo
  float specular;              // Blinn-Phong strength, linear
  float exponent;              // Blinn-Phong exponent
  float reflectance;           // of the mirror; only opaque surfaces are mirrors
  float alpha;                 // 1: opaque
  bool physical;               // GGX; else classic, Blinn-Phong
  float metallic;              // physical only: 0 dielectric ... 1 metal
  float roughness;             // physical only: its square is the width of the GGX lobe
  float alpha_ggx;             // width of the GGX lobe; classic: of a lobe as wide as Blinn-Phong's
  float f0;                    // classic: specular reflectance at normal incidence
  int texture;                 // -1 none
  float repeat[2];
  bool uniform;
  bool layered;  // has any of these maps: textures, -1 none
  int metallic_map, roughness_map, occlusion_map, opacity_map;  // one channel
  int normal_map;                                               // three channels
  int emissive_map;                                             // as the base texture

  // Can rays pass through it?
  bool transparent() const { return alpha < 1 || opacity_map >= 0; }
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
  int rank;  // its place in the scene: of surfaces that coincide, the last is seen
};

struct Light;  // light.h

// Where lights can reach: in a cone, up to a range. Structure of arrays, 31 longer than the lights.
struct LightReachArray {
  const float *x, *y, *z, *direction_x, *direction_y, *direction_z;
  const float *cosine, *sine;  // of the cone; -1, 0: everywhere
  const float* fade;           // 1 / range^2; 0: everywhere
};

// Fog hides what is far away; haze is a band below the horizon of an infinite plane.
struct Medium {
  bool fog, haze;
  float fog_end, fog_slope;  // transmittance at distance r: (fog_end - r) * fog_slope, 0 ... 1
  float fog_color[MAX_CHANNELS];
  float haze_color[MAX_CHANNELS];
  float haze_ratio, haze_radius, haze_peak;  // of the cone: inward reach, rim, height of the peak
  V3 haze_up;                                // the plane's normal, camera frame
  float haze_elevation;                      // of the camera above the plane, in rims
};

// A bounding cone of rays: a sphere of origins (center, radius), opened by an angle, up to
// `length`.
struct RayCone {
  V3 center, axis;
  float radius, length, cosine, sine;
};

struct BoundingSphereArray {  // structure of arrays, padded to 32
  const float *x, *y, *z, *radius;
  int count;  // padded
};

struct BoundingSphere {
  V3 center;
  float radius;  // negative: empty
};

// Axis-aligned boxes by center and half extents, camera frame: structure of arrays.
struct BoundingBoxArray {
  const float *x, *y, *z, *half_x, *half_y, *half_z;
};

// A hierarchy over geoms that are not planes: each box of a level is around WIDTH of the level
// below, and those of level 0 are around single geoms. Padding has half extents below 0.
struct GeomBvh {
  static constexpr int LEVELS = 3, WIDTH = 16, MAX_GEOMS = 1 << 16;
  BoundingBoxArray boxes[LEVELS];
  const int32_t* geoms;  // by box of level 0
  int top;               // boxes of the last level; 0: no hierarchy
  float fine;            // bundles of rays that start so near each other touch few geoms: m
};

constexpr int EDGE_RAYS = 64, EDGE_CELLS = 4;  // in a pixel

constexpr float OUTLINE_ROOM = 1.1f;  // of cones around camera rays, for Frame::outline_reach

struct Frame {
  const Geom* geoms;
  int geom_count, plane_count;   // planes come first
  BoundingSphere finite_bounds;  // of everything but the planes
  BoundingSphere
      mirrored_bounds;  // their mirror image in the only plane; radius T_INFINITY: more planes
  BoundingSphereArray bounds;
  GeomBvh bvh;
  const Mesh* meshes;
  const Surface* surfaces;
  const Texture* textures;
  const Light* lights;
  int light_count;
  LightReachArray reach;     // of the lights
  bool cull_lights;          // leave out those that do not reach
  int skybox;                // texture, -1 none
  bool sky_shines;           // it lights the scene and is in mirrors; else a backdrop
  float camera_to_world[9];  // row-major, camera to world
  Medium medium;
  bool shadows;
  bool lobes;  // a surface is physical or has maps, or paths are traced: GGX lobes are needed
  bool normal_mapped;  // a surface has a normal map
  // 1: luminance, as every light is grey; 3: RGB; 4: both, if grey; one more: `untextured`, the
  // luminance with every texture replaced by its mean
  int channels;
  int colour;                   // index of the red channel
  float weights[MAX_CHANNELS];  // luminance of each channel

  int width, height;
  float fx, fy, cx, cy;
  bool orthographic;
  const float* lens;      // (height + 1, width + 1, 3) ray at each pixel corner; null: a pinhole
  float near;             // camera rays begin on the plane of this depth, m; 0: at the camera
  bool near_sphere;       // ... on the sphere of this radius, for a lens that sees behind itself
  const float* vignette;  // (height, width) factor of a pixel's light; null: all 1
  float pixel_angle;      // footprint of a sample at the image's centre: rad, or m (orthographic)
  int samples;
  int cells;              // the samples lie one in each cell of cells x cells; 0: in no such grid
  const float* sample_x;  // sub-pixel positions, 0 ... 1
  const float* sample_y;
  // (EDGE_RAYS) sub-pixel positions, cell by cell, of rays that find which meshes cover a pixel at
  // an edge; or null
  const float *edge_x, *edge_y;
  float pixel_x, pixel_y;  // footprint of a sample on a plane at depth 1: m
  int probes;              // texture probes of one sample, at most; 0: isotropic filtering
  // where one sample stands for the pixel, images are read at `taps` points
  int taps;
  const float *tap_x, *tap_y;  // px from the sample
  float tap_width;             // footprint of a tap, as a share of the sample's
  bool outlines;               // those of shapes are blended in the first pass, or in the only one
  // What a sample stands for at depth 1, m, and half its diagonal, with some room; 0: no outline is
  // blended over it.
  float cell_x, cell_y, outline_reach;
  bool marks_blended;  // `untextured` is below 0 where outlines are blended
  const RayCone*
      primary;  // (packet rows, packet columns): the bounding cone of each packet's primary rays
  const RayCone* pairs;  // (packet rows, packet columns / 2): of two adjacent packets; or null
  int packet_columns;
};

constexpr int PACKET_WIDTH = 4, PACKET_HEIGHT = 4;

// The place of a pixel in its packet.
constexpr int place_in_packet(int x, int y) {
  return y % PACKET_HEIGHT * PACKET_WIDTH + x % PACKET_WIDTH;
}

// An axis-aligned box of points; its bounding sphere holds the origins of shadow and mirror rays.
struct BoundingBox {
  V3 low = {1e30f, 1e30f, 1e30f}, high = {-1e30f, -1e30f, -1e30f};
  float step = 0;  // largest distance of the points from their surfaces
};

struct SecondaryRayBounds {  // bounds of a packet's secondary rays, over all its samples
  BoundingBox primary_hits, mirror_hits;
  V3 mirror_axis = {0, 0, 0};
  float mirror_spread = -1;  // largest squared chord to the axis; negative: no mirror was hit
};

// Packets are tested in blocks of 4 x 4.
constexpr int BLOCK_WIDTH = 4, BLOCK_HEIGHT = 4;

// Where the rays of a block's packets went when each was last recorded, which decides what can
// affect them. One column per packet.
struct alignas(64) PacketBlock {
  float primary[9][16];  // bounding cone of the camera rays: center, axis, radius, cosine, sine
  float primary_hits[4][16];  // bounding sphere of their hits: center, radius; negative: none
  float mirror_hits[4][16];   // the same for the hits of mirror rays
  // cone of mirror rays from `primary_hits`: axis, radius (negative: none), cosine, sine
  float mirror_rays[6][16];
  uint32_t packets;  // in use, one bit each
};

// What is cached of a packet to relight it, if all its pixels show one geom and no mirror image.
struct CachedShading {
  float* numbers;  // (1 + 2 channels, 16) distance, albedo, light; null: cache nothing
  int lights;      // the light is that of the first lights
  int32_t* geom;   // negative: nothing is cached
};

// Where a packet records its rays.
struct PacketRecord {
  PacketBlock* block;
  int column;                     // in the block
  SecondaryRayBounds* secondary;  // from which the block's column is computed
  CachedShading shading;
};

struct BoundingCapsule;  // path_scene.h

// What has changed since the last tick.
struct SceneChange {
  const BoundingCapsule* capsules;  // of geoms that moved, before and now
  BoundingSphereArray spheres;      // around each of them
  BoundingSphere bounds;            // around all of them
  const Light* lights;              // as they were; null: unchanged
  // where lamps have a size: what moved, by bounding spheres except where outlines are known in
  // closed form; and spheres around glowing geoms. Null: lamps are points
  const SceneChange* soft;
  const BoundingSphere* emitters;
  int emitter_count;
};

// Packets of a block, one bit each, that a change may affect.
struct DirtyPackets {
  uint32_t primary_rays;  // a moving geom may touch their primary rays
  uint32_t retrace;       // those, and packets whose mirror rays it may touch
  uint32_t relight;       // of the others: whose light or shadow may change
};

struct Outputs {
  float* luminance;        // (h, w)
  float* rgb;              // (h, w, 3) linear; or null
  float* untextured;       // the channel of that name, with a margin of one pixel; or null
  long untextured_stride;  // of its rows
  // (h, w) of paths: the geom that all samples of a pixel hit first, -1 none, MIXED_GEOMS several;
  // or null
  int32_t* geoms;
};
constexpr int MIXED_GEOMS = -2;

// The first hit of the ray through each pixel's centre.
struct Truth {
  int32_t* geom;       // (h, w) index of the geom, -1 none
  float* distance;     // (h, w) along the ray, m; infinite for a miss
  float* point;        // (h, w, 3) camera frame, m; for a miss the ray's direction
  float* normal;       // (h, w, 3) camera frame, unit, facing the ray; 0 for a miss
  int32_t* triangle;   // (h, w) of a mesh, -1 none
  float* barycentric;  // (h, w, 2) weights of the triangle's second and third corner
};

struct PathCacheView;
struct PathBatch;
struct PathFrame;
struct IrradianceView;  // irradiance.h
struct KeptNodes;
struct KeptPacket;
struct LampPoint;
struct NodeArray;
struct NodeRequests;
struct ProbeLanes;
struct ProbeSurface;  // path_scene.h

// The entry points of one instruction set.
struct Kernel {
  // Trace the 16 pixels of packet (column, row) and write them.
  void (*trace)(const Frame&, int column, int row, const Outputs&, const PacketRecord* record);
  // The same for packets `column`, which is even, and `column` + 1 at once, unrecorded. Null: no
  // faster than one by one.
  void (*trace_pair)(const Frame&, int column, int row, const Outputs&);
  // Relight a packet from its cached shading. The light is that of `trace`.
  void (*relight)(const Frame&, int column, int row, const Outputs&, const CachedShading*);
  // The same for `column` and `column` + 1, which show one geom and cache equally many lights; or
  // null.
  void (*relight_pair)(const Frame&, int column, int row, const Outputs&, const CachedShading*);
  // Trace up to 16 scattered pixels, with the same result as `trace`. In: x, y (count). Out:
  // luminance (count); the channel `untextured` (count), or null.
  void (*trace_pixels)(const Frame&, const int32_t* x, const int32_t* y, int count,
                       float* luminance, float* untextured);
  // Weigh the refinement of 16 pixels, 0 ... 1. In: `untextured` of their 3 x 3 neighbours,
  // row-major, 16 numbers each. Out: weight (16).
  void (*refinement_weight)(const float* const* neighbours, float* weight);
  // Trace all samples of some pixels of packet (column, row). In: pixels, one bit each; record,
  // which is extended by their rays, or null. Out: luminance (16) and rgb (16, 3) or null, where a
  // bit is set.
  void (*refine)(const Frame&, int column, int row, unsigned pixels, float* luminance, float* rgb,
                 const PacketRecord* record);
  // Ground truth of the 16 pixels of packet (column, row).
  void (*trace_truth)(const Frame&, int column, int row, const Truth&);
  // Find the packets of a block that a change may affect.
  void (*find_dirty_packets)(const Frame&, const PacketBlock&, const SceneChange&, DirtyPackets&);
  // `trace` for paths: a whole row of packets, unrecorded. The batch belongs to the call while it
  // runs.
  void (*trace_path_row)(const Frame&, const PathFrame&, PathBatch&, int row, const Outputs&);
  void (*trace_path_pixels)(const Frame&, const PathFrame&, PathBatch&, const int32_t* x,
                            const int32_t* y, int count, float* luminance);
  // The same for the pixels of a row of packets that are marked, one bit each: (h, words of 32).
  // Out: their number.
  long (*trace_marked_row)(const Frame&, const PathFrame&, PathBatch&, int row,
                           const uint32_t* marked, const Outputs&);
  // Outputs::geoms of at most 16 pixels.
  void (*first_geoms)(const Frame&, const PathFrame&, const int32_t* x, const int32_t* y, int count,
                      int32_t* geoms);
  // Update the cached units of packet rows begin ... end that are dirty, and their pixels. Out: the
  // number of samples traced.
  long (*update_cached_paths)(const Frame&, const PathFrame&, PathBatch&, const PathCacheView&,
                              int begin, int end, const Outputs&);
  // `trace` and `refine` for `hybrid`, with the light of the irradiance cache. Missing nodes are
  // requested; the packet must then be traced again. KeptPacket: what it keeps, or null.
  void (*trace_hybrid)(const Frame&, const PathFrame&, const IrradianceView&, NodeRequests&,
                       int column, int row, const Outputs&, KeptPacket*);
  // The same from what a packet has kept, with the nodes' light of this tick; and where lamps have
  // moved with theirs, from its surfaces, else null.
  void (*relight_hybrid)(const Frame&, const PathFrame&, const IrradianceView&, NodeRequests&,
                         int column, int row, const Outputs&, const KeptNodes&, float* rows,
                         const float* surfaces);
  // `trace_hybrid` for `column`, which is even, and `column` + 1 at once; or null.
  void (*trace_hybrid_pair)(const Frame&, const PathFrame&, const IrradianceView&, NodeRequests&,
                            int column, int row, const Outputs&);
  void (*refine_hybrid)(const Frame&, const PathFrame&, const IrradianceView&, NodeRequests&,
                        int column, int row, unsigned pixels, float* luminance, float* rgb,
                        KeptPacket*);
  // Spread LAMP_POINTS points over an emitter. In: LAMP_POINTS pairs of numbers, evenly spread.
  void (*lamp_points)(const Frame&, const PathFrame&, int emitter, const float* x, const float* y,
                      LampPoint*);
  // Place nodes begin ... end - 1, which lie on one geom, a mesh.
  void (*place_mesh_nodes)(const Frame&, const NodeArray&, int begin, int end);
  // Move nodes that the hits that asked for them do not see to these hits.
  void (*move_hidden_nodes)(const Frame&, const NodeArray&);
  // Sum the light of samples first ... first + count - 1 of each node. Out: (nodes, 3).
  void (*light_nodes)(const Frame&, const PathFrame&, PathBatch&, const NodeArray&, int first,
                      int count, float* sums);
  // For tests, the path integrator's samplers, 16 draws at once: see sampler_probe.inl.
  void (*probe_sampler)(int mode, int seed, int log2_samples, int block, int log2_blocks, int index,
                        int dimension, const int* pixel, float* x, float* y);
  void (*probe_bsdf_sample)(const ProbeSurface&, const float* numbers, ProbeLanes&);
  void (*probe_bsdf)(const ProbeSurface&, ProbeLanes&);
  void (*probe_light_sample)(const Frame&, const PathFrame&, const float* point, bool environment,
                             const float* numbers, ProbeLanes&);
  void (*probe_light_pdf)(const Frame&, const PathFrame&, const float* point, ProbeLanes&);
};

extern const Kernel KERNEL_PORTABLE, KERNEL_NEON, KERNEL_AVX2, KERNEL_AVX512, KERNEL_ONE_LANE;
// Entry points in 32 lanes.
void trace_hybrid_pair_avx512(const Frame&, const PathFrame&, const IrradianceView&, NodeRequests&,
                              int column, int row, const Outputs&);
void trace_pair_avx512(const Frame&, int column, int row, const Outputs&);
void relight_pair_avx512(const Frame&, int column, int row, const Outputs&, const CachedShading*);
void trace_path_row_avx512(const Frame&, const PathFrame&, PathBatch&, int row, const Outputs&);
void trace_path_pixels_avx512(const Frame&, const PathFrame&, PathBatch&, const int32_t* x,
                              const int32_t* y, int count, float* luminance);
long trace_marked_row_avx512(const Frame&, const PathFrame&, PathBatch&, int row,
                             const uint32_t* marked, const Outputs&);
void first_geoms_avx512(const Frame&, const PathFrame&, const int32_t* x, const int32_t* y,
                        int count, int32_t* geoms);
long update_cached_paths_avx512(const Frame&, const PathFrame&, PathBatch&, const PathCacheView&,
                                int begin, int end, const Outputs&);
void lamp_points_avx512(const Frame&, const PathFrame&, int emitter, const float* x, const float* y,
                        LampPoint*);
void place_mesh_nodes_avx512(const Frame&, const NodeArray&, int begin, int end);
void move_hidden_nodes_avx512(const Frame&, const NodeArray&);
void light_nodes_avx512(const Frame&, const PathFrame&, PathBatch&, const NodeArray&, int first,
                        int count, float* sums);

}  // namespace evs
