#include "render/irradiance/irradiance_cache.h"

#include <algorithm>
#include <cmath>
#include <cstring>
#include <tuple>
#include <utility>

#include "render/irradiance/first_readers.h"

namespace evs {
namespace {

constexpr int BOTH = IrradianceCache::ALL_PIXELS | IrradianceCache::EDGES;
constexpr size_t MIN_ROOM = 1 << 16;
constexpr int LANES = 32;  // at most, of a kernel
constexpr int MAX_COARSER = 20;
// of keys that kernels ask for
constexpr int MAX_LEVEL = 60;
constexpr long MAX_PLACE = 1000000001;
// Nodes at the edge of a face lie a little inside: other geoms often begin there.
constexpr float INNER = 0.999f;
constexpr float DISTANCE = 40;  // from which a lattice of spacing 1 is seen

auto order_of(const NodeKey& k) { return std::tie(k.geom, k.level, k.face, k.x, k.y, k.z); }

bool before(const NodeRequest& a, const NodeRequest& b) {
  if (order_of(a.key) != order_of(b.key)) return order_of(a.key) < order_of(b.key);
  return is_before(a, b);
}

void rotate(const float* r, const float* v, float* out) {
  for (int i = 0; i < 3; i++) out[i] = v[0] * r[3 * i] + v[1] * r[3 * i + 1] + v[2] * r[3 * i + 2];
}

float length(float x, float y, float z) { return std::sqrt(x * x + y * y + z * z); }

// A node of a shape: its point and its outward normal, in the geom's frame.
void surface_point(const Geom& g, const NodeKey& key, float* p, float* n) {
  NodeLattice lattice = node_lattice(g, key.level);
  const float at[3] = {static_cast<float>(key.x), static_cast<float>(key.y),
                       static_cast<float>(key.z)};
  const float* half = lattice.half;
  for (int a = 0; a < 3; a++) n[a] = 0;
  if (g.shape == PLANE) {
    for (int a = 0; a < 2; a++) {
      p[a] = (at[a] + LATTICE_SHIFT) * lattice.spacing;
      if (g.size[a] > 0) p[a] = std::clamp(p[a], -g.size[a] * INNER, g.size[a] * INNER);
    }
    p[2] = 0;
    n[2] = 1;
    return;
  }
  float c[3];  // on the surface of a cube
  for (int a = 0; a < 3; a++) {
    c[a] = at[a] * (2 / lattice.count[a]) - 1;
    p[a] = c[a] * half[a];
  }
  switch (g.shape) {
    case BOX:
      for (int a = 0; a < 3; a++) p[a] *= a == key.face / 2 ? 1 : INNER;
      n[key.face / 2] = key.face % 2 ? -1.0f : 1.0f;
      return;
    case CYLINDER: {
      float ring = length(c[0], c[1], 0);
      bool side = key.face == 6;
      if (side || ring > 1) {
        float inward = (side ? 1 : INNER) / std::max(ring, 1e-6f);
        p[0] *= inward;
        p[1] *= inward;
      }
      if (side) p[2] *= INNER;
      if (!side) n[2] = key.face % 2 ? -1.0f : 1.0f;
      for (int a = 0; a < 2 && side; a++) n[a] = p[a] / half[0];
      return;
    }
    case CAPSULE: {
      // from the centre to the barrel or, beyond its end, to the cap
      float barrel = g.size[1], r = g.size[0], across = length(p[0], p[1], 0);
      float t = across > 0 ? r / across : 2 * (barrel + r) / std::abs(p[2]);
      if (std::abs(p[2]) * t > barrel) {
        float square = across * across + p[2] * p[2], along = std::abs(p[2]) * barrel;
        float root = along * along - square * (barrel * barrel - r * r);
        t = (along + std::sqrt(std::max(root, 0.0f))) / square;
      }
      for (int a = 0; a < 3; a++) p[a] *= t;
      for (int a = 0; a < 3; a++) n[a] = p[a];
      n[2] -= std::clamp(p[2], -barrel, barrel);
      break;
    }
    default: {  // sphere, ellipsoid
      float inward = 1 / length(c[0], c[1], c[2]);
      for (int a = 0; a < 3; a++) p[a] *= inward;
      for (int a = 0; a < 3; a++) n[a] = p[a] / (half[a] * half[a]);
    }
  }
  float scale = 1 / std::max(length(n[0], n[1], n[2]), 1e-30f);
  for (int a = 0; a < 3; a++) n[a] *= scale;
}

bool is_mesh(const Geom& g) { return g.shape == MESH || g.shape == HFIELD; }

}  // namespace

size_t IrradianceCache::most_nodes(long pixels) {
  return std::max(MIN_ROOM, 2 * static_cast<size_t>(pixels));
}

IrradianceCache::IrradianceCache(size_t nodes, float spacing, int workers)
    : max_nodes_(nodes), spacing_(spacing), workers_(workers) {
  // points of a (0, m, 2) net: bit-reversed, and Sobol's second dimension
  for (uint32_t i = 0; i < LAMP_POINTS; i++) {
    uint32_t reversed = 0, second = 0, direction = 0x80000000u;
    for (int bit = 0; 1u << bit < LAMP_POINTS; bit++) {
      if (i >> bit & 1) reversed |= 1u << (31 - bit), second ^= direction;
      direction ^= direction >> 1;
    }
    lamp_x_[i] = static_cast<float>(reversed >> 8) * 0x1p-24f + 0.5f / LAMP_POINTS;
    lamp_y_[i] = static_cast<float>(second >> 8) * 0x1p-24f + 0.5f / LAMP_POINTS;
  }
  constexpr int ROOM = CHUNK + LANES, VECTORS = 8, FLOATS = 3 * VECTORS + 2;
  for (Worker& w : workers_) {
    w.requests.owner = &w;
    w.requests.keep = keep;
    w.floats.resize(static_cast<size_t>(FLOATS) * ROOM);
    w.ints.resize(2 * ROOM);
    float* next = w.floats.data();
    auto array = [&] { return std::exchange(next, next + ROOM); };
    NodeArray& n = w.nodes;
    for (float** vector : {n.point, n.normal, n.geometric_normal, n.spawn_point, n.origin,
                           n.direction, n.hit_point, n.hit_normal}) {
      for (int a = 0; a < 3; a++) vector[a] = array();
    }
    n.path_length = array();
    n.reach = array();
    n.geom = w.ints.data();
    n.hash = n.geom + ROOM;
  }
  clear();
}

// The outermost points first: one far from the middle, and each next one as far as can be from
// those before.
void IrradianceCache::add_lamp(const Kernel& kernel, const Frame& frame, const PathFrame& paths,
                               int emitter) {
  LampPoint points[LAMP_POINTS];
  kernel.lamp_points(frame, paths, emitter, lamp_x_, lamp_y_, points);
  auto square = [](V3 a, V3 b) {
    V3 w = {a.x - b.x, a.y - b.y, a.z - b.z};
    return w.x * w.x + w.y * w.y + w.z * w.z;
  };
  V3 middle = {0, 0, 0};
  for (const LampPoint& p : points) {
    constexpr float SHARE = 1.0f / LAMP_POINTS;
    middle = {middle.x + p.position.x * SHARE, middle.y + p.position.y * SHARE,
              middle.z + p.position.z * SHARE};
  }
  float apart[LAMP_POINTS];
  for (int i = 0; i < LAMP_POINTS; i++) apart[i] = square(points[i].position, middle);
  for (int k = 0; k < LAMP_POINTS; k++) {
    int next = static_cast<int>(std::max_element(apart, apart + LAMP_POINTS) - apart);
    lamp_order_.push_back(next);
    for (int i = 0; i < LAMP_POINTS; i++) {
      float far = square(points[i].position, points[next].position);
      if (apart[i] >= 0) apart[i] = k == 0 ? far : std::min(apart[i], far);
    }
    apart[next] = -1;
  }
  lamps_.push_back(paths.emitters[emitter].geom);
}

void IrradianceCache::spread(const Kernel& kernel, const Frame& frame, const PathFrame& paths,
                             int emitter, LampPoint* points) const {
  LampPoint even[LAMP_POINTS];
  kernel.lamp_points(frame, paths, emitter, lamp_x_, lamp_y_, even);
  size_t lamp = 0;
  while (lamps_[lamp] != paths.emitters[emitter].geom) lamp++;
  const int* order = lamp_order_.data() + lamp * LAMP_POINTS;
  for (int k = 0; k < LAMP_POINTS; k++) {
    LampPoint& p = points[k] = even[order[k]];
    float numbers[] = {p.position.x, p.position.y, p.position.z,  p.normal.x,    p.normal.y,
                       p.normal.z,   p.area,       p.radiance[0], p.radiance[1], p.radiance[2]};
    // a shape without a size has points that are no numbers: they give no light
    for (float number : numbers) {
      if (!std::isfinite(number)) p = {};
    }
  }
}

void IrradianceCache::clear() {
  tick_ = 0;
  coarser_ = 0;
  drop_nodes();
}

void IrradianceCache::begin_pass(Pass pass) {
  view_.pass = pass;
  refresh_view();
}

// The workers' cells hold while no node goes and their marks last.
void IrradianceCache::forget_cells() {
  for (Worker& w : workers_) w.requests.forget_cells();
}

// Set the light that kernels read.
void IrradianceCache::set_light(const Frame& frame, size_t node, const float* light) {
  const float* tint = view_.tint + 4 * frame.geoms[nodes_[node].key.geom].surface;
  float* to = light_.data() + 4 * node;
  std::copy_n(light, 3, to);
  to[3] = light[0] * tint[0] + light[1] * tint[1] + light[2] * tint[2];
}

void IrradianceCache::drop_nodes() {
  forget_cells();
  nodes_.clear();
  light_.clear();
  changed_.clear();
  disturbed_.clear();
  used_.clear();
  known_.clear();
  counted_.clear();
  phase_.clear();
  wanted_.clear();
  for (Worker& w : workers_) {
    w.kept.clear();
    w.readers.clear();
    w.requests.reader_count = 0;
  }
  rehash(1 << 12);
  refresh_view();
}

void IrradianceCache::refresh_view() {
  view_.slots = slots_.data();
  view_.mask = static_cast<uint32_t>(slots_.size() - 1);
  view_.light = light_.data();
  view_.used = used_.data();
  view_.readers = swept() && view_.pass == ALL_PIXELS;
  view_.spacing = std::ldexp(spacing_, coarser_);
  view_.lamp_x = lamp_x_;
  view_.lamp_y = lamp_y_;
}

void IrradianceCache::insert(int node) {
  uint64_t hash = hash_of(nodes_[node].key);
  size_t mask = slots_.size() - 1, at = hash & mask;
  while (slots_[at].node >= 0) at = (at + 1) & mask;
  slots_[at] = {static_cast<uint32_t>(hash >> 32), node};
}

void IrradianceCache::add(const Node& node, int used, int known) {
  nodes_.push_back(node);
  phase_.push_back(hash_of(node.key) >> 60);
  used_.push_back(static_cast<uint8_t>(used));
  known_.push_back(static_cast<uint8_t>(known));
  counted_.push_back(counts(nodes_.size() - 1));
  light_.resize(4 * nodes_.size());
  changed_.push_back(1);
  disturbed_.push_back(1);
  if (slots_.size() < 4 * nodes_.size()) {
    rehash(2 * slots_.size());
  } else {
    insert(size() - 1);
  }
}

void IrradianceCache::rehash(size_t slots) {
  slots_.assign(slots, {0, -1});
  for (int k = 0; k < size(); k++) insert(k);
}

// Place node `at` of the array on its shape, or the ray that finds it on its mesh.
void IrradianceCache::place(const Geom& g, const Node& node, const NodeArray& to, int at) {
  const NodeKey& key = node.key;
  float spacing = lattice_spacing(key.level);
  to.geom[at] = key.geom;
  to.hash[at] = static_cast<int32_t>(hash_of(key));
  to.path_length[at] = spacing * DISTANCE;
  for (int a = 0; a < 3; a++) {
    to.hit_point[a][at] = node.point[a];
    to.hit_normal[a][at] = node.normal[a];
  }
  if (!is_mesh(g)) {
    float p[3], n[3], point[3], normal[3];
    surface_point(g, key, p, n);
    rotate(g.rotation, p, point);
    rotate(g.rotation, n, normal);
    const float origin[3] = {g.position.x, g.position.y, g.position.z};
    for (int a = 0; a < 3; a++) {
      to.point[a][at] = to.spawn_point[a][at] = point[a] + origin[a];
      to.normal[a][at] = to.geometric_normal[a][at] = normal[a];
    }
    return;
  }
  const int32_t lattice[3] = {key.x, key.y, key.z};
  int axis = key.face / 2;
  float side = key.face % 2 ? -1.0f : 1.0f;
  for (int a = 0; a < 3; a++) {
    to.direction[a][at] = a == axis ? -side : 0.0f;
    float whole = static_cast<float>(lattice[a]);
    // from half a spacing above the sheet
    whole =
        a == axis ? (whole + 0.5f) * SHEET + side * (0.5f * SHEET + 0.5f) : whole + LATTICE_SHIFT;
    to.origin[a][at] = whole * spacing;
  }
  to.reach[at] = (SHEET + 1) * spacing;
}

// Trace some quarters of the paths of some nodes.
void IrradianceCache::light(const Tracer& t, const std::vector<int32_t>& which, int first_quarter,
                            int quarters) {
  int count = static_cast<int>(which.size());
  lit_anew_.assign(which.size(), 0);
  t.pool.run((count + CHUNK - 1) / CHUNK, [&](int job, int worker) {
    NodeArray& array = workers_[worker].nodes;
    int begin = job * CHUNK, end = std::min(begin + CHUNK, count);
    array.count = end - begin;
    for (int k = begin; k < end; k++) {
      const Node& node = nodes_[which[k]];
      place(t.frame.geoms[node.key.geom], node, array, k - begin);
    }
    for (int k = 0; k < array.count;) {
      int geom = array.geom[k], first = k;
      while (k < array.count && array.geom[k] == geom) k++;
      if (is_mesh(t.frame.geoms[geom])) t.kernel.place_mesh_nodes(t.frame, array, first, k);
    }
    t.kernel.move_hidden_nodes(t.frame, array);
    uint8_t* changed = lit_anew_.data() + begin;
    for (int k = 0; k < array.count; k++) {
      float before[3];
      float* facing = nodes_[which[begin + k]].facing;
      std::copy_n(facing, 3, before);
      const float* r = t.frame.geoms[array.geom[k]].rotation;
      for (int a = 0; a < 3; a++) {
        facing[a] = array.normal[0][k] * r[a] + array.normal[1][k] * r[3 + a] +
                    array.normal[2][k] * r[6 + a];
      }
      // new nodes are neighbours from now on
      changed[k] = quarters == QUARTERS || std::memcmp(facing, before, sizeof before) != 0;
    }
    float sums[3 * CHUNK];
    for (int q = first_quarter; q < first_quarter + quarters; q++) {
      t.kernel.light_nodes(t.frame, t.paths, t.batches[worker], array, q * QUARTER, QUARTER, sums);
      for (int k = 0; k < array.count; k++) {
        float* quarter = nodes_[which[begin + k]].quarter[q];
        changed[k] = changed[k] || std::memcmp(quarter, sums + 3 * k, 3 * sizeof(float)) != 0;
        std::copy_n(sums + 3 * k, 3, quarter);
      }
    }
  });
  // where most have changed, under a moving camera, all their neighbours have
  if (3 * std::count(lit_anew_.begin(), lit_anew_.end(), uint8_t{1}) > count) {
    std::fill(disturbed_.begin(), disturbed_.end(), uint8_t{1});
  } else {
    t.pool.run((count + CHUNK - 1) / CHUNK, [&](int job, int) {
      for (int k = job * CHUNK; k < std::min((job + 1) * CHUNK, count); k++) {
        if (lit_anew_[k]) disturb(t.frame, which[k]);
      }
    });
  }
  paths_ += static_cast<long>(count) * quarters * QUARTER;
}

void IrradianceCache::own_mean(const Node& node, float* mean) const {
  for (int c = 0; c < 3; c++) {
    float sum = 0;
    for (const auto& quarter : node.quarter) sum += quarter[c];
    // a path that found no number adds nothing for ever
    mean[c] = std::isfinite(sum) ? sum * (1.0f / SAMPLES) : 0;
  }
}

// Call visit(neighbour, moved) for the nodes around a node on the surface. moved: along how many
// axes.
template <class Visit>
void IrradianceCache::visit_neighbours(const Frame& frame, int k, const Visit& visit) const {
  struct Neighbour {
    uint64_t hash;
    int moved;
  };
  Neighbour around[26];
  int count = 0;
  NodeKey key = nodes_[k].key;
  int shape = frame.geoms[key.geom].shape;
  bool flat = shape == PLANE || shape == BOX || shape == MESH || shape == HFIELD ||
              (shape == CYLINDER && key.face < 6);
  int across = flat ? key.face / 2 : -1;
  for (int i = 0; i < 27; i++) {
    int offset[3] = {i % 3 - 1, i / 3 % 3 - 1, i / 9 - 1};
    int moved = std::abs(offset[0]) + std::abs(offset[1]) + std::abs(offset[2]);
    if (moved == 0 || (flat && offset[across] != 0)) continue;
    NodeKey other = key;
    other.x += offset[0];
    other.y += offset[1];
    other.z += offset[2];
    uint64_t hash = hash_of(other);
    __builtin_prefetch(view_.slots + (hash & view_.mask));
    around[count++] = {hash, moved};
  }
  for (int i = 0; i < count; i++) {
    int neighbour = find_node(view_.slots, view_.mask, around[i].hash);
    if (neighbour >= 0) visit(neighbour, around[i].moved);
  }
}

// What the means of a node and its neighbours are made of has changed.
void IrradianceCache::disturb(const Frame& frame, int k) {
  auto set = [&](int node) { __atomic_store_n(&disturbed_[node], uint8_t{1}, __ATOMIC_RELAXED); };
  set(k);
  visit_neighbours(frame, k, [&](int neighbour, int) { set(neighbour); });
}

// A node that only edges have read counts once pixels read it, and may cease to after a sweep.
void IrradianceCache::disturb_recounted(const Frame& frame) {
  for (int k = 0; k < size(); k++) {
    const uint8_t now = counts(static_cast<size_t>(k));
    if (now == counted_[k]) continue;
    counted_[k] = now;
    disturb(frame, k);
  }
}

// Find the mean of a node and its neighbours, with binomial weights; less of those that face
// elsewhere.
void IrradianceCache::average(const Frame& frame, int k) {
  Node& node = nodes_[k];
  constexpr float SAME_WAY = 0.9f;  // cosine from which neighbours count
  float sum[3], total = 4;
  own_mean(node, sum);
  for (float& part : sum) part *= total;
  visit_neighbours(frame, k, [&](int neighbour, int moved) {
    if (!counts(static_cast<size_t>(neighbour))) return;
    const Node& other = nodes_[neighbour];
    float cosine = 0, mean[3];
    for (int a = 0; a < 3; a++) cosine += node.facing[a] * other.facing[a];
    float alike = std::clamp((cosine - SAME_WAY) / (1 - SAME_WAY), 0.0f, 1.0f);
    float weight = std::ldexp(alike, 2 - moved);
    own_mean(other, mean);
    for (int c = 0; c < 3; c++) sum[c] += weight * mean[c];
    total += weight;
  });
  for (int c = 0; c < 3; c++) node.mean[c] = sum[c] / total;
}

void IrradianceCache::settle(const Frame& frame) {
  for (int k = 0; k < size(); k++) {
    average(frame, k);
    std::copy_n(nodes_[k].mean, 3, nodes_[k].before);
    set_light(frame, static_cast<size_t>(k), nodes_[k].mean);
  }
}

// Forget the nodes that no pixel has read since the last sweep.
void IrradianceCache::sweep() {
  size_t kept = 0;
  for (size_t k = 0; k < nodes_.size(); k++) {
    if (!used_[k]) continue;
    nodes_[kept] = nodes_[k];
    phase_[kept] = phase_[k];
    known_[kept] = used_[k];
    counted_[kept] = counted_[k];
    std::copy_n(light_.data() + 4 * k, 4, light_.data() + 4 * kept);
    kept++;
  }
  std::fill(used_.begin(), used_.end(), uint8_t{0});
  forget_cells();
  if (kept == nodes_.size()) return;
  nodes_.resize(kept);
  phase_.resize(kept);
  used_.resize(kept);
  known_.resize(kept);
  counted_.resize(kept);
  light_.resize(4 * kept);
  changed_.resize(kept);
  disturbed_.assign(kept, 1);
  rehash(slots_.size());
  refresh_view();
}

void IrradianceCache::next_tick(const Tracer& t) {
  tick_++;
  if (tick_ % CYCLE_TICKS == 0) sweep();
  disturb_recounted(t.frame);
  int turn = static_cast<int>(tick_ % RENEWAL_TICKS);
  int quarter = static_cast<int>(tick_ / RENEWAL_TICKS % QUARTERS);
  due_.clear();
  for (int k = 0; k < size(); k++) {
    if (phase_[k] == turn) due_.push_back(k);
  }
  light(t, due_, quarter, 1);
  int due = static_cast<int>(due_.size());
  t.pool.run((due + CHUNK - 1) / CHUNK, [&](int job, int) {
    for (int i = job * CHUNK; i < std::min((job + 1) * CHUNK, due); i++) {
      Node& node = nodes_[due_[i]];
      std::copy_n(node.mean, 3, node.before);
      if (disturbed_[due_[i]]) average(t.frame, due_[i]);
      disturbed_[due_[i]] = 0;
    }
  });
  constexpr int STEPS_A_JOB = 1024;
  t.pool.run((size() + STEPS_A_JOB - 1) / STEPS_A_JOB, [&](int job, int) {
    for (int k = job * STEPS_A_JOB; k < std::min((job + 1) * STEPS_A_JOB, size()); k++) {
      const Node& node = nodes_[k];
      float *now = light_.data() + 4 * k, last[4];
      changed_[k] = std::memcmp(node.before, node.mean, sizeof node.mean) != 0 ||
                    std::memcmp(now, node.mean, sizeof node.mean) != 0;
      if (!changed_[k]) continue;
      int step = (turn - phase_[k] + RENEWAL_TICKS) % RENEWAL_TICKS + 1;
      float share = static_cast<float>(step) * (1.0f / RENEWAL_TICKS);
      float light[3];
      for (int c = 0; c < 3; c++) {
        float between = node.before[c] + (node.mean[c] - node.before[c]) * share;
        light[c] = step == RENEWAL_TICKS ? node.mean[c] : between;
      }
      std::copy_n(now, 4, last);
      set_light(t.frame, static_cast<size_t>(k), light);
      changed_[k] = std::memcmp(now, last, sizeof last) != 0;
    }
  });
  refresh_view();
}

bool IrradianceCache::any_changed(const KeptNodes& nodes) const {
  return std::any_of(nodes.node, nodes.node + nodes.count, [&](int k) { return changed_[k] != 0; });
}

void IrradianceCache::keep(NodeRequests& requests) {
  auto& kept = static_cast<Worker*>(requests.owner)->kept;
  kept.insert(kept.end(), requests.at, requests.at + requests.count);
  requests.count = 0;
  auto& readers = static_cast<Worker*>(requests.owner)->readers;
  readers.insert(readers.end(), requests.readers, requests.readers + requests.reader_count);
  requests.reader_count = 0;
}

void IrradianceCache::take_readers() {
  read_.assign(nodes_.size(), 0);
  for (Worker& w : workers_) {
    keep(w.requests);
    for (const CellReader& reader : w.readers) {
      for (int k : reader.node) {
        if (read_[k] && !is_before(reader, nodes_[k])) continue;
        read_[k] = 1;
        std::copy_n(reader.point, 3, nodes_[k].point);
        std::copy_n(reader.normal, 3, nodes_[k].normal);
      }
    }
    w.readers.clear();
  }
}

void IrradianceCache::take_first_readers(const uint64_t* words) {
  for (Node& node : nodes_) {
    if (words[0] != NO_HIT) hit_of_words(words, node.point, node.normal);
    words += HIT_WORDS;
  }
}

bool IrradianceCache::collect(int worker) {
  Worker& w = workers_[worker];
  bool complete = w.requests.complete;
  if (!complete) {
    keep(w.requests);
    w.requests.complete = true;
  }
  return complete;
}

void IrradianceCache::request(const NodeRequest* nodes, size_t count) {
  workers_[0].kept.insert(workers_[0].kept.end(), nodes, nodes + count);
}

bool IrradianceCache::add_requested(const Tracer& t) {
  wanted_.clear();
  for (Worker& w : workers_) {
    wanted_.insert(wanted_.end(), w.kept.begin(), w.kept.end());
    w.kept.clear();
  }
  std::sort(wanted_.begin(), wanted_.end(), before);
  auto same = [](const NodeRequest& a, const NodeRequest& b) {
    return order_of(a.key) == order_of(b.key);
  };
  wanted_.erase(std::unique(wanted_.begin(), wanted_.end(), same), wanted_.end());
  // a lattice has at least a few nodes on each geom
  if (nodes_.size() + wanted_.size() > max_nodes_ && coarser_ < MAX_COARSER) {
    coarser_++;
    drop_nodes();
    return false;
  }
  size_t first = nodes_.size(), count = first + wanted_.size();
  for (const NodeRequest& request : wanted_) {
    Node node = {};
    node.key = request.key;
    std::copy_n(request.point, 3, node.point);
    std::copy_n(request.normal, 3, node.normal);
    add(node, 0, view_.pass);
  }
  refresh_view();
  due_.clear();
  for (size_t k = first; k < count; k++) due_.push_back(static_cast<int32_t>(k));
  light(t, due_, 0, QUARTERS);
  for (size_t k = first; k < count; k++) {
    average(t.frame, static_cast<int>(k));
    std::copy_n(nodes_[k].mean, 3, nodes_[k].before);
    set_light(t.frame, k, nodes_[k].mean);
  }
  return true;
}

size_t IrradianceCache::bytes() const {
  return nodes_.capacity() * sizeof(Node) + light_.capacity() * sizeof(float) + used_.capacity() +
         changed_.capacity() + disturbed_.capacity() + known_.capacity() + counted_.capacity() +
         phase_.capacity() + slots_.capacity() * sizeof(NodeSlot);
}

void IrradianceCache::save(int32_t* ints, float* floats) const {
  for (size_t k = 0; k < nodes_.size(); k++) {
    const Node& node = nodes_[k];
    const NodeKey& key = node.key;
    const int32_t row[STATE_INTS] = {
        key.geom, key.level, key.face, key.x, key.y, key.z, used_[k] | known_[k] << 2};
    ints = std::copy_n(row, STATE_INTS, ints);
    std::memcpy(floats, static_cast<const NodeFloats*>(&node), sizeof(NodeFloats));
    floats += STATE_FLOATS;
  }
}

bool IrradianceCache::restore(long tick, int coarser, int count, const int32_t* ints,
                              const float* floats, const std::vector<Geom>& geoms) {
  if (tick < 0 || coarser < 0 || coarser > MAX_COARSER) return false;
  for (int k = 0; k < count; k++) {
    const int32_t* row = ints + static_cast<long>(k) * STATE_INTS;
    if (row[0] < 0 || static_cast<size_t>(row[0]) >= geoms.size()) return false;
    int faces = geoms[row[0]].shape == CYLINDER ? 7 : 6;
    bool placed = std::abs(row[1]) <= MAX_LEVEL && row[2] >= 0 && row[2] < faces;
    for (int a = 3; a < 6; a++) placed = placed && std::abs(static_cast<long>(row[a])) <= MAX_PLACE;
    if (!placed) return false;
  }
  clear();
  tick_ = tick;
  coarser_ = coarser;
  for (int k = 0; k < count; k++) {
    const int32_t* row = ints + static_cast<long>(k) * STATE_INTS;
    Node node = {};
    node.key = {row[0], row[1], row[2], row[3], row[4], row[5]};
    std::memcpy(static_cast<NodeFloats*>(&node), floats, sizeof(NodeFloats));
    floats += STATE_FLOATS;
    add(node, row[6] & BOTH, row[6] >> 2 & BOTH);
  }
  refresh_view();
  return true;
}

}  // namespace evs
