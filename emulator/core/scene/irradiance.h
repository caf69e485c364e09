// What the kernels of `hybrid` read of the irradiance cache, and what they ask of it. Plain
// structures, as in scene.h.
#pragma once

#include "scene/scene.h"

namespace evs {

// A node of the cache: a point of a surface, on a lattice in the frame of its geom.
struct NodeKey {
  int32_t geom;
  int32_t level;    // the lattice's spacing is at most 2^level m
  int32_t face;     // part of the surface, across whose edges light is not continuous
  int32_t x, y, z;  // of the lattice
};

// A node that is missing, and the hit that asks for it, in the geom's frame.
struct NodeRequest {
  NodeKey key;
  float point[3], normal[3];
};

// Of several hits that ask for one node, the first is taken: an order of their bits. In: hits with
// a point and a normal.
template <class A, class B>
inline bool is_before(const A& a, const B& b) {
  int order = __builtin_memcmp(a.point, b.point, sizeof a.point);
  return order != 0 ? order < 0 : __builtin_memcmp(a.normal, b.normal, sizeof a.normal) < 0;
}

// The four nodes of a cell. In the key: its first node, and the face itself.
struct CellNodes {
  NodeKey key;  // geom < 0: empty
  int32_t node[4];
  int32_t passes;  // in which they are marked as read
};

// A hit, in the geom's frame, that reads a cell's nodes.
struct CellReader {
  int32_t node[4];
  float point[3], normal[3];
};

// The hash table: linear probing; an entry is found by 64 bits of its key's hash.
struct NodeSlot {
  uint32_t check;
  int32_t node;  // < 0: empty
};

// A point of a glowing geom: camera frame, or its own where it has an axis, about which the points
// then turn towards what they light.
struct LampPoint {
  V3 position, normal;  // normal: unit
  float area;           // that it stands for, m^2
  float radiance[3];
};
constexpr int LAMP_POINTS = 64;  // on each glowing geom
constexpr int BULB_POINTS = 16;  // on each bulb

struct IrradianceView {
  bool off;      // there is no such light
  bool readers;  // each packet says from where it reads
  const NodeSlot* slots;
  uint32_t mask;  // of the place in the table
  // (nodes, 4) irradiance over pi by channel: what white paper reflects; and the luminance that the
  // node's surface reflects of it
  const float* light;
  uint8_t pass;                  // over the pixels, one bit
  uint8_t* used;                 // (nodes) the passes that read it since the last sweep
  float spacing;                 // largest, for 1 m of distance; orthographic: m
  const float *lamp_x, *lamp_y;  // (LAMP_POINTS) evenly spread points, 0 ... 1
  // (emitters, LAMP_POINTS), the outermost first
  const LampPoint* lamp_points;
  // (surfaces, 4) weight of each colour in the luminance that the surface reflects, relative to
  // that of white light
  const float* tint;
};

// The nodes that a packet reads, each once.
struct KeptNodes {
  static constexpr int ROOM = 127;
  int32_t count, node[ROOM];

  // Return the place of node `k`, -1 where there is no room.
  int add(int32_t k) {
    for (int i = 0; i < count; i++) {
      if (node[i] == k) return i;
    }
    if (count == ROOM) return -1;
    node[count] = k;
    return count++;
  }
};

// Where a packet records its rays, and what else makes its light: see kept_light.inl.
struct KeptPacket {
  PacketRecord record;
  KeptNodes* nodes;
  float* rows;      // (samples, kept_rows, 16); null for refined pixels
  float* surfaces;  // (samples, surface_rows, 16), while lamps move; or null
  bool complete;    // out: the rows hold all that it needs
};
constexpr int kept_rows(int channels) { return 9 + 4 * channels; }
constexpr int surface_rows(int channels) { return 15 + 3 * channels; }

// Nodes whose light is to be found, camera frame: structure of arrays.
struct NodeArray {
  int count;
  float *point[3], *normal[3], *geometric_normal[3], *spawn_point[3];
  float* path_length;  // m: a camera so far away would see the lattice as it is
  int32_t *geom, *hash;
  // of nodes on meshes, local frame: a ray down to the surface, up to `reach`
  float *origin[3], *direction[3], *reach;
  // a hit that reads the node, local frame, which takes its place where that ray meets nothing, or
  // where something lies between them
  float *hit_point[3], *hit_normal[3];
};

inline uint64_t mix_bits(uint64_t a) {
  a = (a ^ (a >> 33)) * 0xff51afd7ed558ccdull;
  a = (a ^ (a >> 33)) * 0xc4ceb9fe1a85ec53ull;
  return a ^ (a >> 33);
}
inline uint64_t hash_of(const NodeKey& k) {
  uint64_t where = (static_cast<uint64_t>(static_cast<uint32_t>(k.geom)) << 32) |
                   (static_cast<uint64_t>(static_cast<uint32_t>(k.level + 256)) << 8) |
                   static_cast<uint32_t>(k.face);
  uint64_t place = static_cast<uint64_t>(static_cast<int64_t>(k.x)) * 0x9e3779b97f4a7c15ull +
                   static_cast<uint64_t>(static_cast<int64_t>(k.y)) * 0xc2b2ae3d27d4eb4full +
                   static_cast<uint64_t>(static_cast<int64_t>(k.z)) * 0x165667b19e3779f9ull;
  return mix_bits(mix_bits(where) + place);
}

// A hash that is fast rather than good.
inline uint32_t short_hash(const NodeKey& k) {
  uint32_t hash = static_cast<uint32_t>(k.x) * 0x9e3779b1u ^
                  static_cast<uint32_t>(k.y) * 0x85ebca6bu ^
                  static_cast<uint32_t>(k.z) * 0xc2b2ae35u ^
                  static_cast<uint32_t>((k.geom * 8 + k.face) * 64 + k.level) * 0x27d4eb2fu;
  return hash >> 16;
}

#ifndef EVS_ON_DEVICE  // where render/gpu/hybrid.cu has another
// Where a packet asks for nodes, and says from where it reads them.
struct NodeRequests {
  static constexpr int ROOM = 1024, CELLS = 8192;
  CellNodes cells[CELLS];  // found lately, by part of their key's hash
  bool complete = true;    // nothing is missing
  int count = 0;
  NodeRequest at[ROOM];
  int reader_count = 0;
  CellReader readers[ROOM];
  void* owner = nullptr;
  void (*keep)(NodeRequests&) = nullptr;  // empties both when one is full

  // Where a cell is remembered.
  CellNodes& cell_of(const NodeKey& key) { return cells[short_hash(key) % CELLS]; }
  // Room for the next one.
  NodeRequest& next_request() {
    if (count == ROOM) keep(*this);
    return at[count++];
  }
  CellReader& next_reader() {
    if (reader_count == ROOM) keep(*this);
    return readers[reader_count++];
  }
  void forget_cells() {
    for (CellNodes& cell : cells) cell.key.geom = -1;
  }
};
#endif

// Find a node in the table by its key's hash, -1 where it is missing.
inline int find_node(const NodeSlot* slots, uint32_t mask, uint64_t hash) {
  uint32_t check = static_cast<uint32_t>(hash >> 32);
  for (uint32_t at = static_cast<uint32_t>(hash) & mask;; at = (at + 1) & mask) {
    if (slots[at].node < 0) return -1;
    if (slots[at].check == check) return slots[at].node;
  }
}

// Of lattices without a border, in spacings: coordinates of scenes are often round numbers, and
// nodes where geoms meet would be lit or dark by rounding.
constexpr float LATTICE_SHIFT = 0.381966f;
constexpr float SHEET = 4;  // spacings: parts of a mesh farther apart have nodes of their own

// How the lattice of a bounded shape divides its bounding box.
struct NodeLattice {
  float spacing;   // m, of planes and meshes
  float half[3];   // of the bounding box
  float count[3];  // cells along each axis, powers of two
};

inline float lattice_spacing(int level) {
  return __builtin_bit_cast(float, static_cast<uint32_t>(level + 127) << 23);
}

inline NodeLattice node_lattice(const Geom& g, int level) {
  NodeLattice lattice = {lattice_spacing(level), {g.size[0], g.size[1], g.size[2]}, {1, 1, 1}};
  float* half = lattice.half;
  if (g.shape == SPHERE) half[1] = half[2] = half[0];
  if (g.shape == CAPSULE) half[2] = half[0] + g.size[1];
  if (g.shape == CYLINDER) half[2] = g.size[1];
  if (g.shape == CAPSULE || g.shape == CYLINDER) half[1] = half[0];
  if (g.shape == PLANE || g.shape == MESH || g.shape == HFIELD) return lattice;
  for (int a = 0; a < 3; a++) {
    // the smallest power of two that is enough
    float cells = 2 * half[a] / lattice.spacing;
    if (!(cells > 1)) continue;
    uint32_t bits = __builtin_bit_cast(uint32_t, cells < 65536 ? cells : 65536.0f);
    lattice.count[a] = __builtin_bit_cast(float, (bits + 0x7fffff) & 0x7f800000u);
  }
  return lattice;
}

inline bool is_smooth(int shape) {
  return shape == SPHERE || shape == CAPSULE || shape == ELLIPSOID;
}

}  // namespace evs
