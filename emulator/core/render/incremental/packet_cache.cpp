#include "incremental/packet_cache.h"

#include <algorithm>
#include <cstring>

namespace evs {
namespace {

constexpr int BLOCKS_A_JOB = 512;  // fewer are not worth waking a thread

}  // namespace

RayBlocks::RayBlocks(const Sampling& sampling, int channels, const std::vector<Light>& lights,
                     bool shadows)
    : columns_(sampling.columns),
      blocks_in_row_((sampling.columns + BLOCK_WIDTH - 1) / BLOCK_WIDTH),
      patch_size_(channels > 0 ? static_cast<size_t>(1 + 2 * channels) : 0),
      blocks_(static_cast<size_t>((sampling.rows + BLOCK_HEIGHT - 1) / BLOCK_HEIGHT) *
              blocks_in_row_),
      trails_(sampling.primary.size()),
      numbers_(trails_.size() * patch_size_),
      geoms_(trails_.size(), -1),
      needs_(blocks_.size()) {
  // shadows move
  while (patch_lights_ < static_cast<int>(lights.size()) &&
         !(shadows && lights[patch_lights_].castshadow)) {
    patch_lights_++;
  }
  for (int row = 0; row < sampling.rows; row++) {
    for (int column = 0; column < columns_; column++) {
      const Hull& h = sampling.primary[static_cast<size_t>(row) * columns_ + column];
      Record to = record(column, row);
      const float parts[9] = {h.center.x, h.center.y, h.center.z, h.axis.x, h.axis.y,
                              h.axis.z,   h.radius,   h.cosine,   h.sine};
      for (int k = 0; k < 9; k++) to.block->primary[k][to.column] = parts[k];
      to.block->packets |= 1u << to.column;
    }
  }
}

bool RayBlocks::outdated(const std::vector<Light>& now, const std::vector<Light>& before) {
  for (int i = 0; i < patch_lights_; i++) {
    if (std::memcmp(&now[i], &before[i], sizeof(Light)) != 0) {
      patch_lights_ = i;
      return true;
    }
  }
  return false;
}

void RayBlocks::begin() { std::fill(needs_.begin(), needs_.end(), Needs{}); }

void RayBlocks::ask(const Kernel& kernel, const Frame& frame, const Change& change, Pool& pool) {
  size_t count = blocks_.size();
  pool.run(static_cast<int>((count + BLOCKS_A_JOB - 1) / BLOCKS_A_JOB), [&](int job, int) {
    size_t begin = static_cast<size_t>(job) * BLOCKS_A_JOB;
    for (size_t i = begin; i < std::min(count, begin + BLOCKS_A_JOB); i++) {
      uint32_t unknown = needs_[i].met;
      kernel.ask(frame, blocks_[i], change, needs_[i]);
      needs_[i].traced |= unknown;
      needs_[i].lit &= ~unknown;
    }
  });
}

}  // namespace evs
