// The packet cache of `direct`: where each packet's rays went, kept between ticks while the camera
// stands still.
#pragma once

#include <cstddef>
#include <vector>

#include "base/thread_pool.h"
#include "scene/light.h"
#include "scene/optics.h"

namespace evs {

class PacketCache {
 public:
  // In: channels of the cached shading; 0: none. shadows: whether lights cast any.
  PacketCache(const Sampling& sampling, int channels, const std::vector<Light>& lights,
              bool shadows);

  // What a packet needs. RETRACE_UNRECORDED: a moving geom touches its primary rays, and most
  // likely will in the next tick too, so recording is not worth its time; it is traced again in any
  // case.
  enum class Dirty { CLEAN, RELIGHT, RETRACE, RETRACE_UNRECORDED };

  // Has a light changed that cached shading contains? Then later shading excludes it, and all
  // cached shading is stale.
  bool drop_changed_lights(const std::vector<Light>& now, const std::vector<Light>& before);
  // Record every packet.
  void record_all();
  // Find the dirty packets.
  void find_dirty(const Kernel& kernel, const Frame& frame, const SceneChange& change,
                  ThreadPool& pool);
  Dirty dirty(int column, int row) const {
    const DirtyPackets& dirty = dirty_[index_of(column, row)];
    int bit = bit_of(column, row);
    return dirty.primary_rays >> bit & 1 ? Dirty::RETRACE_UNRECORDED
           : dirty.retrace >> bit & 1    ? Dirty::RETRACE
           : dirty.relight >> bit & 1    ? Dirty::RELIGHT
                                         : Dirty::CLEAN;
  }
  // Does any packet of the block's row that starts here need work?
  bool any_dirty(int column, int row) const {
    const DirtyPackets& dirty = dirty_[index_of(column, row)];
    return (dirty.retrace | dirty.relight) >> bit_of(column, row) & ((1u << BLOCK_WIDTH) - 1);
  }
  PacketRecord record(int column, int row) {
    size_t packet = static_cast<size_t>(row) * columns_ + column;
    return {&blocks_[index_of(column, row)],
            bit_of(column, row),
            &secondary_bounds_[packet],
            {shading_size_ ? numbers_[packet * shading_size_].lane : nullptr, shading_lights_,
             &geoms_[packet]}};
  }

 private:
  size_t index_of(int column, int row) const {
    return static_cast<size_t>(row / BLOCK_HEIGHT) * blocks_in_row_ + column / BLOCK_WIDTH;
  }
  static int bit_of(int column, int row) {
    return row % BLOCK_HEIGHT * BLOCK_WIDTH + column % BLOCK_WIDTH;
  }

  struct alignas(64) Lanes {
    float lane[16];
  };

  int columns_, blocks_in_row_, shading_lights_ = 0;
  size_t shading_size_;
  std::vector<PacketBlock> blocks_;
  std::vector<SecondaryRayBounds> secondary_bounds_;
  std::vector<Lanes> numbers_;  // of the cached shading
  std::vector<int32_t> geoms_;
  std::vector<DirtyPackets> dirty_;  // of each block
};

}  // namespace evs
