// EvSNet on an array of pixels. One call per chunk of ticks: luminance in, sorted events of each
// tick out. The caller owns the state.
#pragma once

#include <algorithm>
#include <bit>
#include <cstddef>
#include <cstdint>
#include <functional>
#include <memory>
#include <stdexcept>
#include <string>
#include <vector>

#include "base/thread_pool.h"
#include "evsnet/network_kernel.h"
#include "sensor/events.h"

namespace evs {

// Allocation of FIFO memory: which row belongs to which tile.
//
// A tile is given the lowest free row in the tick in which its X becomes non-zero, and releases it
// TICK_CHUNK ticks after its FIFOs are empty, so that a row released in a chunk holds zeros from
// the start of the chunk on. In each tick rows are allocated first and then released, both in the
// order of the tiles. So the assignment depends on the light alone, not on chunks or threads.
class FifoRows {
 public:
  // Start a chunk. In: `rows` in memory; `row` of each tile, -1 for none. Throws
  // std::invalid_argument if one does not exist or two tiles share one.
  void begin(const int32_t* row, size_t tiles, size_t rows) {
    free_.assign((std::max(rows, tiles) + 63) / 64, ~uint64_t{0});
    end_ = 0;
    lowest_word_ = 0;
    for (size_t tile = 0; tile < tiles; tile++) {
      if (row[tile] == -1) continue;
      const size_t at = static_cast<size_t>(row[tile]);
      if (row[tile] < -1 || at >= rows || !is_free(at)) {
        throw std::invalid_argument("tile_row is damaged");
      }
      free_[at / 64] &= ~(uint64_t{1} << (at % 64));
      end_ = std::max(end_, at + 1);
    }
    for (std::vector<int32_t>& tick : allocations_) tick.clear();
    for (std::vector<int32_t>& tick : releases_) tick.clear();
    pending_ = false;
  }

  // Request a row for a tile in tick t of the chunk, or its release after that tick.
  void allocate(size_t tile, int t) { append(allocations_[t], tile); }
  void release(size_t tile, int t) { append(releases_[t], tile); }

  // Carry out the requests. In/out: `row` of each tile. Out: rows needed in memory.
  size_t commit(int32_t* row) {
    if (!pending_) return end_;
    for (int t = 0; t < TICK_CHUNK; t++) {
      for (int32_t tile : allocations_[t]) row[tile] = allocate_lowest();
      for (int32_t tile : releases_[t]) {
        const size_t at = static_cast<size_t>(row[tile]);
        free_[at / 64] |= uint64_t{1} << (at % 64);
        lowest_word_ = std::min(lowest_word_, at / 64);
        row[tile] = -1;
      }
    }
    return end_;
  }

 private:
  bool is_free(size_t at) const { return (free_[at / 64] >> (at % 64) & 1) != 0; }

  void append(std::vector<int32_t>& tick, size_t tile) {
    tick.push_back(static_cast<int32_t>(tile));
    pending_ = true;
  }

  // There is always a free row, since no tile has two.
  int32_t allocate_lowest() {
    while (free_[lowest_word_] == 0) lowest_word_++;
    const size_t at =
        lowest_word_ * 64 + static_cast<size_t>(std::countr_zero(free_[lowest_word_]));
    free_[lowest_word_] &= free_[lowest_word_] - 1;
    end_ = std::max(end_, at + 1);
    return static_cast<int32_t>(at);
  }

  std::vector<uint64_t> free_;  // a bit for each row: 1 if it is free
  size_t lowest_word_ = 0;      // no word before it has a free row
  size_t end_ = 0;              // one past the highest row used in this chunk
  bool pending_ = false;
  std::vector<int32_t> allocations_[TICK_CHUNK], releases_[TICK_CHUNK];
};

// The kernels of an instruction set; "auto" is the best that this machine runs. Throws
// std::invalid_argument for others.
const NetworkKernel* network_kernel_of(const std::string& isa);

struct NetworkSettings {
  LogMap map;
  Network network;      // its memory must outlive the array
  BiLif bilif;          // likewise
  int64_t tick_us = 0;  // below 2^28
  bool dense = false;   // compute every tile in every tick
};

// The state, all In/out. Tiles are in row-major order.
struct NetworkArrays {
  float* last_luminance = nullptr;  // (h, w)
  float* last_log = nullptr;        // (h, w); NaN before the first light
  float* v = nullptr;               // (h, w)
  int64_t* last = nullptr;          // (h, w) tick that each v is as of
  float* fifo = nullptr;            // (rows, [16][6][feature]); zeros in rows that no tile has
  size_t rows = 0;
  int32_t* tile_row = nullptr;    // (tiles,) row in `fifo`; -1 for none
  int64_t* tile_moved = nullptr;  // (tiles, 16) number of the last tick with X != 0
  uint8_t* tile_loud = nullptr;   // (tiles,) 1 if some V is at a threshold
};

struct NetworkChunk {
  const float* luminance = nullptr;  // (ticks, h, w)
  int ticks = 0;                     // 1 ... TICK_CHUNK
  int64_t tick = 0;                  // number of the first tick
  int64_t begin_us = 0;
  float* currents = nullptr;  // Out: (ticks, h, w); null if not wanted
};

struct NetworkCounts {
  int64_t clamped = 0;
  int64_t x_clamped = 0;
  int64_t v_clamped = 0;
};

class NetworkArray {
 public:
  // Return FIFO memory of more rows, with the old ones copied and the new ones zero.
  using Grow = std::function<float*(size_t rows)>;

  // width and height are at most 32767; threads <= 0 means one for each core.
  NetworkArray(const NetworkSettings& settings, int width, int height, int threads,
               const std::string& isa);

  size_t tiles() const { return across_ * down_; }
  size_t tiles_across() const { return across_; }
  size_t tiles_down() const { return down_; }
  size_t width() const { return width_; }
  size_t height() const { return height_; }
  const NetworkSettings& settings() const { return settings_; }
  // Bits of the smallest positive luminance that is unusable.
  uint32_t unusable_from() const { return unusable_from_; }

  // Sorted events of each tick. Adds to `counts`. One call at a time.
  std::vector<EventBuffer> step(NetworkArrays arrays, const NetworkChunk& chunk, const Grow& grow,
                                NetworkCounts& counts);

 private:
  // A tile in a chunk.
  struct Tile {
    uint32_t changed = 0;    // ticks in which its luminance changed, as bits
    uint32_t moved = 0;      // ticks with X != 0, as bits
    int64_t last_moved = 0;  // last tick before the chunk with X != 0, if the tile has a row
    int32_t x = -1;          // offset of its X in TileRow::x, in units of 16; -1 if X is all 0
    bool active = false;     // an X != 0 is in its receptive field
  };
  // A pixel to infer: where its FIFOs, its X and its current begin.
  struct Pixel {
    float* fifo;
    const float* x;
    float* current;
  };
  // A row of tiles.
  struct TileRow {
    std::vector<float> x;
    LogDeltaCounts counts;
    int64_t v_clamped = 0;
  };
  struct DeleteAligned {
    void operator()(float* p) const { ::operator delete[](p, std::align_val_t{64}); }
  };
  using Floats = std::unique_ptr<float[], DeleteAligned>;
  // Memory of one worker.
  struct Workspace {
    Floats scratch;
    Floats current;  // of a row of tiles, (tiles, ticks, 16)
    std::vector<Pixel> pixels;
  };

  TilePlace place(size_t tile) const;
  void log_delta(const NetworkArrays& arrays, const LogDeltaJob& job, size_t down);
  size_t assign_rows(const NetworkArrays& arrays, const NetworkChunk& chunk);
  void map_fifo_slots(const NetworkChunk& chunk);
  void collect_pixels(const NetworkArrays& arrays, const NetworkChunk& chunk, size_t down,
                      Workspace& workspace);
  void infer(const NetworkChunk& chunk, const Workspace& workspace);
  void integrate_and_fire(const NetworkArrays& arrays, const NetworkChunk& chunk, size_t down,
                          const Workspace& workspace);
  void add_crossings(const BiLifJob& job, size_t down);
  void write_currents(const BiLifJob& job, float* currents) const;

  NetworkSettings settings_;
  const NetworkKernel* kernel_;
  uint32_t unusable_from_;
  size_t width_, height_, across_, down_;
  ThreadPool pool_;
  // scratch
  FifoRows rows_;
  std::vector<Tile> tiles_;
  std::vector<TileRow> tile_rows_;
  std::vector<int32_t> load_places_, store_places_;           // as in InferenceJob
  std::vector<Workspace> workspaces_;                         // of each worker
  std::vector<std::vector<Crossing>> crossings_[TICK_CHUNK];  // of each tick and row of pixels
};

}  // namespace evs
