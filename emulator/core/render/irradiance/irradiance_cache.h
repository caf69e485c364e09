// The irradiance cache of `hybrid`: diffuse light of the sky and of bounces at points of surfaces.
// Scalar code around node_light.inl and node_lattice.inl.
//
// A node is lit by SAMPLES paths, which start in the same directions in every tick. A quarter of
// them is traced again every RENEWAL_TICKS ticks, at each node in a tick that follows from its key.
// The mean of a node and its neighbours, which has less noise, is then approached in RENEWAL_TICKS
// equal steps. So
//  - in a scene at rest no bit changes;
//  - in one tick the light of a node changes by at most 1 / (4 RENEWAL_TICKS) of the largest change
//    of a quarter of its paths and its neighbours';
//  - nothing that is older than SETTLE_TICKS shows.
#pragma once

#include <algorithm>
#include <cstdint>
#include <vector>

#include "base/thread_pool.h"
#include "scene/irradiance.h"
#include "scene/path_scene.h"

namespace evs {

class IrradianceCache {
 public:
  static constexpr int RENEWAL_TICKS = 16, QUARTERS = 4, QUARTER = 16;
  static constexpr int SAMPLES = QUARTERS * QUARTER, CYCLE_TICKS = QUARTERS * RENEWAL_TICKS;
  static constexpr int SETTLE_TICKS = CYCLE_TICKS + 2 * RENEWAL_TICKS;
  // After so many ticks of a scene at rest, neither light nor the set of nodes can change.
  static constexpr int REST_TICKS = 3 * CYCLE_TICKS;

  // So many nodes bound the memory for an image.
  static size_t most_nodes(long pixels);
  // nodes: at most; spacing: IrradianceView's, of the finest lattice.
  IrradianceCache(size_t nodes, float spacing, int workers);

  // What lights nodes: the kernel with a tick's frame.
  struct Tracer {
    const Kernel& kernel;
    const Frame& frame;
    const PathFrame& paths;
    PathBatch* batches;  // one per worker
    ThreadPool& pool;
  };
  // Forget the nodes that were not read lately, trace those whose turn it is again, and let the
  // light of all approach its mean.
  void next_tick(const Tracer& tracer);
  // A tick at rest, in which nothing is read.
  void skip_tick() { tick_++; }

  // Has this tick forgotten which nodes were read?
  bool swept() const { return tick_ % CYCLE_TICKS == 0; }

  const IrradianceView& view() const { return view_; }
  // Add a glowing geom: find the order of its points, in a frame where it is not placed yet.
  void add_lamp(const Kernel& kernel, const Frame& frame, const PathFrame& paths, int emitter);
  // Spread points over it.
  void spread(const Kernel& kernel, const Frame& frame, const PathFrame& paths, int emitter,
              LampPoint* points) const;
  // The view's surfaces and lamps.
  void set_surfaces(const float* tint, const LampPoint* lamp_points, bool off) {
    view_.off = off;
    view_.tint = tint;
    view_.lamp_points = lamp_points;
  }
  // Passes over the pixels. Which nodes all of them read does not depend on light; where edges are
  // does, so nodes that only edges read are left out of the means of their neighbours.
  enum Pass : uint8_t { ALL_PIXELS = 1, EDGES = 2 };
  void begin_pass(Pass pass);
  // Of one worker: empty before each packet.
  NodeRequests& requests(int worker) { return workers_[worker].requests; }
  // Keep what a packet has requested. Returns whether it was complete.
  bool collect(int worker);
  // The same of nodes that a device has requested.
  void request(const NodeRequest* nodes, size_t count);
  // Is the light of any of these nodes another than in the last tick? Not where nodes were dropped.
  bool any_changed(const KeptNodes& nodes) const;
  // (nodes) the passes that read each since the last sweep.
  const std::vector<uint8_t>& used() const { return used_; }
  void set_used(const uint8_t* used) {
    std::copy_n(used, used_.size(), used_.begin());
    forget_cells();
  }
  size_t slot_count() const { return slots_.size(); }
  // Add and light the nodes that were requested. Returns false where there was no room: the lattice
  // is then coarser, and every pixel must be traced again.
  bool add_requested(const Tracer& tracer);
  // Take the first hit that has read each node in this tick, if the packets said. Nodes that it
  // does not see move there when it is their turn.
  void take_readers();
  // The same, where the first hits are known: (nodes, HIT_WORDS) of first_readers.h.
  void take_first_readers(const uint64_t* words);
  // After the first tick: average all nodes again, now that all neighbours are there.
  void settle(const Frame& frame);

  void clear();
  int size() const { return static_cast<int>(nodes_.size()); }
  long paths() const { return paths_; }
  size_t bytes() const;

  // The state, for saving: rows of STATE_INTS and STATE_FLOATS numbers.
  static constexpr int STATE_INTS = 7, STATE_FLOATS = 27;
  long tick() const { return tick_; }
  int coarser() const { return coarser_; }
  void save(int32_t* ints, float* floats) const;
  // Returns false, and changes nothing, where they are damaged.
  bool restore(long tick, int coarser, int count, const int32_t* ints, const float* floats,
               const std::vector<Geom>& geoms);

 private:
  struct NodeFloats {
    float point[3], normal[3];   // of a hit that reads it, in the geom's frame
    float facing[3];             // normal where it lies, in the geom's frame
    float quarter[QUARTERS][3];  // sums
    float before[3], mean[3];    // with its neighbours
  };
  static_assert(sizeof(NodeFloats) == STATE_FLOATS * sizeof(float));
  struct Node : NodeFloats {
    NodeKey key;
  };
  struct alignas(64) Worker {
    NodeRequests requests;
    std::vector<NodeRequest> kept;
    std::vector<CellReader> readers;
    std::vector<float> floats;
    std::vector<int32_t> ints;
    NodeArray nodes;
  };
  static constexpr int CHUNK = 64;  // nodes that are lit together

  static void keep(NodeRequests& requests);
  static void place(const Geom& g, const Node& node, const NodeArray& to, int at);
  void light(const Tracer& tracer, const std::vector<int32_t>& which, int first_quarter,
             int quarters);
  bool counts(size_t node) const { return (used_[node] | known_[node]) & ALL_PIXELS; }
  void own_mean(const Node& node, float* mean) const;
  template <class Visit>
  void visit_neighbours(const Frame& frame, int k, const Visit& visit) const;
  void disturb(const Frame& frame, int k);
  void disturb_recounted(const Frame& frame);
  void average(const Frame& frame, int k);
  void drop_nodes();
  void forget_cells();
  void set_light(const Frame& frame, size_t node, const float* light);
  void add(const Node& node, int used, int known);
  void sweep();
  void rehash(size_t slots);
  void insert(int node);
  void refresh_view();

  size_t max_nodes_;
  float spacing_;
  std::vector<Node> nodes_;
  std::vector<float> light_;        // (nodes, 4) the view's, of this tick
  std::vector<uint8_t> changed_;    // (nodes) its light, since the last tick
  std::vector<uint8_t> disturbed_;  // (nodes) what its mean is made of, since it was found
  std::vector<uint8_t> used_;       // (nodes) the passes that read it since the last sweep
  std::vector<uint8_t> known_;      // (nodes) ALL_PIXELS read it before that, or asked for it
  std::vector<uint8_t> counted_;    // (nodes) whether it counted when this was last asked
  std::vector<uint8_t> read_;       // (nodes) while readers are taken
  std::vector<uint8_t> phase_;      // (nodes) high bits of the hash
  std::vector<NodeSlot> slots_;
  std::vector<int32_t> due_;
  std::vector<uint8_t> lit_anew_;  // of those that were traced: another light than before
  std::vector<NodeRequest> wanted_;
  std::vector<Worker> workers_;
  float lamp_x_[LAMP_POINTS], lamp_y_[LAMP_POINTS];
  std::vector<int> lamp_order_;  // (geoms that ever glowed, LAMP_POINTS)
  std::vector<int> lamps_;       // those geoms
  IrradianceView view_ = {};
  long tick_ = 0;
  int coarser_ = 0;  // by how many levels
  long paths_ = 0;   // traced so far
};

}  // namespace evs
