#include "render/incremental/packet_cache.h"

#include <algorithm>
#include <cstring>

namespace evs {
namespace {

constexpr int BLOCKS_A_JOB = 512;  // fewer are not worth waking a thread

}  // namespace

PacketCache::PacketCache(const Sampling& sampling, int channels, const std::vector<Light>& lights,
                         bool shadows)
    : columns_(sampling.columns),
      blocks_in_row_((sampling.columns + BLOCK_WIDTH - 1) / BLOCK_WIDTH),
      shading_size_(channels > 0 ? static_cast<size_t>(1 + 2 * channels) : 0),
      blocks_(static_cast<size_t>((sampling.rows + BLOCK_HEIGHT - 1) / BLOCK_HEIGHT) *
              blocks_in_row_),
      secondary_bounds_(sampling.primary.size()),
      numbers_(secondary_bounds_.size() * shading_size_),
      geoms_(secondary_bounds_.size(), -1),
      dirty_(blocks_.size()) {
  // cached shading ends before the first light whose shadow can move
  while (shading_lights_ < static_cast<int>(lights.size()) &&
         !(shadows && lights[shading_lights_].castshadow)) {
    shading_lights_++;
  }
  for (int row = 0; row < sampling.rows; row++) {
    for (int column = 0; column < columns_; column++) {
      const RayCone& h = sampling.primary[static_cast<size_t>(row) * columns_ + column];
      PacketRecord to = record(column, row);
      const float parts[9] = {h.center.x, h.center.y, h.center.z, h.axis.x, h.axis.y,
                              h.axis.z,   h.radius,   h.cosine,   h.sine};
      for (int k = 0; k < 9; k++) to.block->primary[k][to.column] = parts[k];
      to.block->packets |= 1u << to.column;
    }
  }
}

bool PacketCache::drop_changed_lights(const std::vector<Light>& now,
                                      const std::vector<Light>& before) {
  for (int i = 0; i < shading_lights_; i++) {
    if (std::memcmp(&now[i], &before[i], sizeof(Light)) != 0) {
      shading_lights_ = i;
      return true;
    }
  }
  return false;
}

void PacketCache::record_all() { std::fill(dirty_.begin(), dirty_.end(), DirtyPackets{}); }

void PacketCache::find_dirty(const Kernel& kernel, const Frame& frame, const SceneChange& change,
                             ThreadPool& pool) {
  size_t count = blocks_.size();
  pool.run(static_cast<int>((count + BLOCKS_A_JOB - 1) / BLOCKS_A_JOB), [&](int job, int) {
    size_t begin = static_cast<size_t>(job) * BLOCKS_A_JOB;
    for (size_t i = begin; i < std::min(count, begin + BLOCKS_A_JOB); i++) {
      uint32_t unrecorded = dirty_[i].primary_rays;
      kernel.find_dirty_packets(frame, blocks_[i], change, dirty_[i]);
      dirty_[i].retrace |= unrecorded;
      dirty_[i].relight &= ~unrecorded;
    }
  });
}

}  // namespace evs
