// A network on an array of pixels. One call per chunk of ticks, luminance in, sorted events of each
// tick out; what changes from tick to tick belongs to the caller.
#pragma once

#include <cstdint>
#include <functional>
#include <memory>
#include <string>
#include <vector>

#include "event_order.h"
#include "fifo_rows.h"
#include "network_kernel.h"
#include "pool.h"

namespace evs {

// Of this machine the best kernels ("auto"), or those asked for. Throws std::invalid_argument.
const NetworkKernel* network_kernel_of(const std::string& isa);

struct NetworkSettings {
  LogMap map;
  Net net;              // its memory must outlive the array
  Membrane membrane;    // the same
  int64_t tick_us = 0;  // below 2^28
  bool dense = false;   // every tile is computed in every tick
};

// All In/out. Tiles are told row by row.
struct NetworkArrays {
  float* last_luminance = nullptr;  // (h, w)
  float* last_log = nullptr;        // (h, w); NaN: no light yet
  float* v = nullptr;               // (h, w)
  int64_t* last = nullptr;          // (h, w)
  float* fifo = nullptr;            // (rows, [16][6][feature]); zeros where no tile has the row
  size_t rows = 0;
  int32_t* tile_row = nullptr;    // its row, -1: none
  int64_t* tile_moved = nullptr;  // (tiles, 16) number of the last tick in which X was not 0
  uint8_t* tile_loud = nullptr;   // 1: some V is at a threshold
};

struct NetworkChunk {
  const float* luminance = nullptr;  // (ticks, h, w)
  int ticks = 0;                     // 1 ... kChunk
  int64_t tick = 0;                  // number of the first
  int64_t begin_us = 0;
  float* currents = nullptr;  // Out, (ticks, h, w); null: not asked for
};

struct NetworkCounts {
  int64_t clamped = 0;
  int64_t x_clamped = 0;
  int64_t v_clamped = 0;
};

class NetworkArray {
 public:
  // More rows of FIFO memory, the old ones copied, the new ones zero.
  using Grow = std::function<float*(size_t rows)>;

  // width, height at most 32767; threads <= 0: one for each core.
  NetworkArray(const NetworkSettings& settings, int width, int height, int threads,
               const std::string& isa);

  size_t tiles() const { return across_ * down_; }
  size_t tiles_across() const { return across_; }
  size_t tiles_down() const { return down_; }

  // Events of each tick, sorted; counts are added to. One call at a time.
  std::vector<EventBuffer> step(NetworkArrays arrays, const NetworkChunk& chunk, const Grow& grow,
                                NetworkCounts& counts);

 private:
  // What is known of a tile in a chunk.
  struct Work {
    uint32_t flags = 0;  // ticks whose light changed
    uint32_t moved = 0;  // ticks in which X is not 0
    int64_t before = 0;  // the last before the chunk, where the tile has a row
    int32_t x = -1;      // where its X is in the X of its line of tiles; -1: all 0
    bool hot = false;    // something is left of an X
  };
  // A pixel to infer: where its memory, its X and its current begin.
  struct Pixel {
    float* row;
    const float* x;
    float* current;
  };
  // What the line of tiles `down` has for itself.
  struct Line {
    std::vector<float> x;
    FrontCounts front;
    int64_t v_clamped = 0;
  };
  struct Freed {
    void operator()(float* p) const { ::operator delete[](p, std::align_val_t{64}); }
  };
  using Floats = std::unique_ptr<float[], Freed>;
  // What a worker has for itself.
  struct Bench {
    Floats scratch;
    Floats current;  // of a line of tiles, (tiles, ticks, 16)
    std::vector<Pixel> pixels;
  };

  TilePlace place(size_t tile) const;
  void look(const NetworkArrays& arrays, const Front& front, size_t down);
  size_t settle(const NetworkArrays& arrays, const NetworkChunk& chunk);
  void find_places(const NetworkChunk& chunk);
  void gather(const NetworkArrays& arrays, const NetworkChunk& chunk, size_t down, Bench& bench);
  void infer(const NetworkChunk& chunk, const Bench& bench);
  void fire(const NetworkArrays& arrays, const NetworkChunk& chunk, size_t down,
            const Bench& bench);
  void cross(const TileJob& job, size_t down);
  void give(const TileJob& job, float* currents) const;

  NetworkSettings settings_;
  const NetworkKernel* kernel_;
  uint32_t unusable_from_;
  size_t width_, height_, across_, down_;
  Pool pool_;
  // scratch
  PoolRows rows_;
  std::vector<Work> work_;
  std::vector<Line> lines_;
  std::vector<int32_t> old_places_, new_places_;          // as of PixelJob
  std::vector<Bench> benches_;                            // of each worker
  std::vector<std::vector<Crossing>> crossings_[kChunk];  // of each tick, of each line of pixels
};

}  // namespace evs
