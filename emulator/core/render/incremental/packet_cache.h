// What `direct` keeps from tick to tick while the camera stands: where each packet's rays went.
#pragma once

#include <cstddef>
#include <vector>

#include "optics.h"
#include "pool.h"
#include "scene.h"

namespace evs {

class RayBlocks {
 public:
  // In: channels, of patches that are kept; 0: none are. shadows: whether lights cast any.
  RayBlocks(const Sampling& sampling, int channels, const std::vector<Light>& lights, bool shadows);

  // What a packet has to go through again. MET: all of it, and most likely in the next tick too, so
  // that a record is not worth its time: without one it is traced then, whatever happens.
  enum class Need { NOTHING, LIGHT, ALL, MET };

  // Does one of the lights change whose light patches contain? From now on they do without it, and
  // those that there are have to be made anew.
  bool outdated(const std::vector<Light>& now, const std::vector<Light>& before);
  // Every packet gets a record.
  void begin();
  // Find out for each packet.
  void ask(const Kernel& kernel, const Frame& frame, const Change& change, Pool& pool);
  Need need(int column, int row) const {
    const Needs& needs = needs_[index_of(column, row)];
    int bit = bit_of(column, row);
    return needs.met >> bit & 1      ? Need::MET
           : needs.traced >> bit & 1 ? Need::ALL
           : needs.lit >> bit & 1    ? Need::LIGHT
                                     : Need::NOTHING;
  }
  // Does the row of a block that begins with this packet need anything?
  bool any_need(int column, int row) const {
    const Needs& needs = needs_[index_of(column, row)];
    return (needs.traced | needs.lit) >> bit_of(column, row) & ((1u << BLOCK_WIDTH) - 1);
  }
  Record record(int column, int row) {
    size_t packet = static_cast<size_t>(row) * columns_ + column;
    return {&blocks_[index_of(column, row)],
            bit_of(column, row),
            &trails_[packet],
            {patch_size_ ? numbers_[packet * patch_size_].lane : nullptr, patch_lights_,
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

  int columns_, blocks_in_row_, patch_lights_ = 0;
  size_t patch_size_;
  std::vector<RayBlock> blocks_;
  std::vector<Trail> trails_;
  std::vector<Lanes> numbers_;  // of the patches
  std::vector<int32_t> geoms_;
  std::vector<Needs> needs_;  // of each block
};

}  // namespace evs
