#include "evsnet/network_array.h"

#include <bit>
#include <cmath>
#include <new>

#include "base/isa.h"
#include "evsnet/spike_time.h"

namespace evs {

const NetworkKernel* network_kernel_of(const std::string& isa) {
  const std::vector<std::string> names = isa_available();
  const std::string wanted = isa == "auto" ? names.front() : isa;
  if (std::find(names.begin(), names.end(), wanted) == names.end()) {
    throw std::invalid_argument("this machine cannot run instruction set '" + isa + "'; use auto");
  }
#if EVS_BUILT_AVX512
  if (wanted == "avx512") return &NETWORK_AVX512;
#endif
#if EVS_BUILT_AVX2
  if (wanted == "avx2") return &NETWORK_AVX2;
#endif
#if EVS_BUILT_NEON
  if (wanted == "neon") return &NETWORK_NEON;
#endif
#if EVS_BUILT_PORTABLE
  if (wanted == "portable") return &NETWORK_PORTABLE;
#endif
#if EVS_BUILT_ONE_LANE
  if (wanted == "one_lane") return &NETWORK_ONE_LANE;
#endif
  throw std::logic_error("no kernel for instruction set '" + wanted + "'");
}

namespace {

// Bits of the smallest positive luminance that is unusable: DN rises with luminance, as its bits
// do.
uint32_t least_unusable(const LogMap& map) {
  uint32_t usable = 0, unusable = 0x7f800000u;
  while (unusable - usable > 1) {
    const uint32_t middle = usable + (unusable - usable) / 2;
    const float luminance = std::bit_cast<float>(middle);
    (is_usable(luminance, to_dn(map, luminance)) ? usable : unusable) = middle;
  }
  return unusable;
}

}  // namespace

NetworkArray::NetworkArray(const NetworkSettings& settings, int width, int height, int threads,
                           const std::string& isa)
    : settings_(settings),
      kernel_(network_kernel_of(isa)),
      unusable_from_(least_unusable(settings.map)),
      width_(static_cast<size_t>(width)),
      height_(static_cast<size_t>(height)),
      across_((width_ + TILE_SIDE - 1) / TILE_SIDE),
      down_((height_ + TILE_SIDE - 1) / TILE_SIDE),
      pool_(threads) {
  tiles_.resize(tiles());
  tile_rows_.resize(down_);
  auto floats = [](size_t count) { return Floats(new (std::align_val_t{64}) float[count]()); };
  for (int worker = 0; worker < pool_.threads(); worker++) {
    workspaces_.push_back({floats(settings_.network.scratch_floats()),
                           floats(across_ * TICK_CHUNK * TILE_LANES),
                           {}});
  }
  load_places_.resize(static_cast<size_t>(settings_.network.fifo_floats()));
  store_places_.resize(load_places_.size());
}

TilePlace NetworkArray::place(size_t tile) const {
  const size_t x = tile % across_ * TILE_SIDE, y = tile / across_ * TILE_SIDE;
  return {y * width_ + x, width_, static_cast<int>(std::min<size_t>(TILE_SIDE, width_ - x)),
          static_cast<int>(std::min<size_t>(TILE_SIDE, height_ - y))};
}

std::vector<EventBuffer> NetworkArray::step(NetworkArrays arrays, const NetworkChunk& chunk,
                                            const Grow& grow, NetworkCounts& counts) {
  const LogDeltaJob job{settings_.map, unusable_from_, chunk.luminance,       width_ * height_,
                        chunk.tick,    chunk.ticks,    arrays.last_luminance, arrays.last_log};
  const int tile_rows = static_cast<int>(down_);
  rows_.begin(arrays.tile_row, tiles(), arrays.rows);  // throws before anything has changed
  // first pass: X of the tiles whose luminance changes, and memory for their FIFOs
  pool_.run(tile_rows, [&](int row, int) { log_delta(arrays, job, static_cast<size_t>(row)); });
  const size_t rows = assign_rows(arrays, chunk);
  if (rows > arrays.rows) {
    arrays.fifo = grow(rows);
    arrays.rows = rows;
  }

  // second pass: convolutions and BiLIF of the active tiles
  for (int t = 0; t < chunk.ticks; t++) crossings_[t].resize(down_ * TILE_SIDE);
  if (chunk.currents != nullptr) {
    std::fill_n(chunk.currents, static_cast<size_t>(chunk.ticks) * job.frame, 0.0f);
  }
  map_fifo_slots(chunk);
  pool_.run(tile_rows, [&](int row, int worker) {
    const size_t down = static_cast<size_t>(row);
    Workspace& workspace = workspaces_[static_cast<size_t>(worker)];
    collect_pixels(arrays, chunk, down, workspace);
    infer(chunk, workspace);
    integrate_and_fire(arrays, chunk, down, workspace);
  });
  // sort the events of each tick
  std::vector<EventBuffer> events(static_cast<size_t>(chunk.ticks));
  pool_.run(chunk.ticks, [&](int t, int) {
    events[static_cast<size_t>(t)] = order_events(
        crossings_[t], chunk.begin_us + t * settings_.tick_us,
        static_cast<uint32_t>(settings_.tick_us), static_cast<uint32_t>(width_), false);
  });
  for (const TileRow& row : tile_rows_) {
    counts.clamped += row.counts.clamped;
    counts.x_clamped += row.counts.x_clamped;
    counts.v_clamped += row.v_clamped;
  }
  return events;
}

// X of the tiles in the row of tiles `down`.
void NetworkArray::log_delta(const NetworkArrays& arrays, const LogDeltaJob& job, size_t down) {
  TileRow& row = tile_rows_[down];
  row.counts = {};
  row.v_clamped = 0;
  // find the ticks in which each tile changes
  const size_t first = down * across_;
  std::vector<uint32_t> changed(across_, 0);
  const int rows = place(first).rows;
  kernel_->find_changes(job, down * TILE_SIDE * width_, width_, rows, changed.data());

  // compute X of the tiles that change, and keep it where some X is not 0
  const size_t floats = static_cast<size_t>(job.ticks) * TILE_LANES;
  size_t used = 0;
  for (size_t i = 0; i < across_; i++) {
    Tile& tile = tiles_[first + i];
    tile = {};
    tile.changed = changed[i];
    int64_t* moved = arrays.tile_moved + (first + i) * TILE_LANES;
    if (arrays.tile_row[first + i] != -1) {
      tile.last_moved = *std::max_element(moved, moved + TILE_LANES);
    }
    if (tile.changed == 0) continue;
    if (row.x.size() < used + floats) row.x.resize(std::max(used + floats, 2 * row.x.size()));
    float* x = row.x.data() + used;
    tile.moved = kernel_->log_delta(job, place(first + i), tile.changed, x, moved, row.counts);
    if (tile.moved == 0) continue;
    tile.x = static_cast<int32_t>(used / TILE_LANES);
    used += floats;
  }
}

// Find the active tiles and assign rows of FIFO memory. Out: rows needed.
size_t NetworkArray::assign_rows(const NetworkArrays& arrays, const NetworkChunk& chunk) {
  const int64_t first = chunk.tick;
  const int64_t past = settings_.network.past_ticks(), hold = past + TICK_CHUNK;
  for (size_t index = 0; index < tiles(); index++) {
    Tile& tile = tiles_[index];
    const int64_t moved = tile.last_moved;
    const bool has_row = arrays.tile_row[index] != -1;
    tile.active = settings_.dense || tile.moved != 0 || (has_row && moved >= first - past);
    if (settings_.dense) {
      if (!has_row) rows_.allocate(index, 0);
    } else if (has_row || tile.moved != 0) {
      const int moves = std::countr_zero(tile.moved);  // first tick with X != 0, else TICK_CHUNK
      if (has_row && moved < first + chunk.ticks - hold) {
        const int released = moved < first - hold ? 0 : static_cast<int>(moved + hold - first);
        if (released < moves) {
          rows_.release(index, released);
          if (moves < TICK_CHUNK) rows_.allocate(index, moves);
        }
      } else if (!has_row) {
        rows_.allocate(index, moves);
      }
    }
  }
  return rows_.commit(arrays.tile_row);
}

// Map each float of a pixel's FIFOs to its place in scratch memory, before and after the chunk.
void NetworkArray::map_fifo_slots(const NetworkChunk& chunk) {
  const int features = settings_.network.features();
  for (int slot = 0; slot < FIFO_TICKS; slot++) {
    // the oldest tick is in the slot that is written next
    auto age = [&](int64_t next) {
      return (slot - static_cast<int>(next % FIFO_TICKS) + FIFO_TICKS) % FIFO_TICKS;
    };
    const int before = age(chunk.tick), after = age(chunk.tick + chunk.ticks);
    for (int f = 0; f < features; f++) {
      const size_t at = static_cast<size_t>(slot * features + f);
      load_places_[at] = (f * SLOTS + before) * TILE_LANES;
      store_places_[at] = (f * SLOTS + after) * TILE_LANES;
    }
  }
}

// Collect the pixels in a row of tiles with an X != 0 in their receptive fields.
void NetworkArray::collect_pixels(const NetworkArrays& arrays, const NetworkChunk& chunk,
                                  size_t down, Workspace& workspace) {
  alignas(64) static constexpr float ZERO_X[TICK_CHUNK * TILE_LANES] = {};
  const size_t floats = static_cast<size_t>(chunk.ticks) * TILE_LANES, first = down * across_;
  const size_t fifo_floats = static_cast<size_t>(settings_.network.fifo_floats());
  const int64_t since = chunk.tick - settings_.network.past_ticks();
  float* current = workspace.current.get();
  workspace.pixels.clear();
  for (size_t index = first; index < first + across_; index++) {
    const Tile& tile = tiles_[index];
    if (!tile.active) continue;
    float* fifo =
        arrays.fifo + static_cast<size_t>(arrays.tile_row[index]) * TILE_LANES * fifo_floats;
    const float* x =
        tile.x < 0 ? ZERO_X : tile_rows_[down].x.data() + static_cast<size_t>(tile.x) * TILE_LANES;
    const int64_t* moved = arrays.tile_moved + index * TILE_LANES;
    const uint32_t lanes = place(index).lanes();
    std::fill_n(current, floats, 0.0f);
    for (size_t lane = 0; lane < TILE_LANES; lane++) {
      const bool active = settings_.dense || moved[lane] >= since;
      if (!active || (lanes >> lane & 1) == 0) continue;
      workspace.pixels.push_back({fifo + lane * fifo_floats, x + lane, current + lane});
    }
    current += floats;
  }
}

// Take the collected pixels through all layers, 16 at a time.
void NetworkArray::infer(const NetworkChunk& chunk, const Workspace& workspace) {
  InferenceJob job;
  job.network = &settings_.network;
  job.scratch = workspace.scratch.get();
  job.load_places = load_places_.data();
  job.store_places = store_places_.data();
  job.tick = chunk.tick;
  job.ticks = chunk.ticks;
  const std::vector<Pixel>& pixels = workspace.pixels;
  for (size_t at = 0; at < pixels.size(); at += TILE_LANES) {
    for (size_t i = 0; i < TILE_LANES; i++) {
      const Pixel& pixel = pixels[std::min(at + i, pixels.size() - 1)];
      job.fifo[i] = pixel.fifo;
      job.x[i] = pixel.x;
      job.current[i] = pixel.current;
      job.next_fifo[i] = pixels[std::min(at + TILE_LANES + i, pixels.size() - 1)].fifo;
    }
    kernel_->infer(job);
  }
}

// Integrate the currents of a row of tiles and collect the threshold crossings.
void NetworkArray::integrate_and_fire(const NetworkArrays& arrays, const NetworkChunk& chunk,
                                      size_t down, const Workspace& workspace) {
  alignas(64) static constexpr float NO_CURRENT[TICK_CHUNK * TILE_LANES] = {};
  const size_t floats = static_cast<size_t>(chunk.ticks) * TILE_LANES, first = down * across_;
  for (int t = 0; t < chunk.ticks; t++) {
    for (size_t r = 0; r < TILE_SIDE; r++) crossings_[t][down * TILE_SIDE + r].clear();
  }
  BiLifJob job;
  job.unit = &settings_.bilif;
  job.tick = chunk.tick;
  job.ticks = chunk.ticks;
  job.v = arrays.v;
  job.last = arrays.last;
  const float* current = workspace.current.get();
  for (size_t index = first; index < first + across_; index++) {
    const bool active = tiles_[index].active;
    if (!active && arrays.tile_loud[index] == 0) continue;
    job.place = place(index);
    job.current = active ? current : NO_CURRENT;
    if (active) current += floats;
    kernel_->integrate_and_fire(job);
    arrays.tile_loud[index] = job.at_threshold ? 1 : 0;
    tile_rows_[down].v_clamped += job.v_clamped;
    if (job.fired != 0) add_crossings(job, down);
    if (active && chunk.currents != nullptr) write_currents(job, chunk.currents);
  }
}

// Write the currents of a tile into their images.
void NetworkArray::write_currents(const BiLifJob& job, float* currents) const {
  for (int t = 0; t < job.ticks; t++) {
    float* image = currents + static_cast<size_t>(t) * width_ * height_ + job.place.pixel;
    for (int r = 0; r < job.place.rows; r++) {
      const float* line = job.current + (t * TILE_SIDE + r) * TILE_SIDE;
      std::copy_n(line, job.place.columns, image + static_cast<size_t>(r) * width_);
    }
  }
}

// Append the spikes of a tile, with their stamps, to the rows of pixels that they belong to.
void NetworkArray::add_crossings(const BiLifJob& job, size_t down) {
  const double tick = static_cast<double>(settings_.tick_us);
  for (uint32_t ticks = job.fired; ticks != 0; ticks &= ticks - 1) {
    const int t = std::countr_zero(ticks);
    std::vector<Crossing>* rows = crossings_[t].data() + down * TILE_SIDE;
    for (uint32_t lanes = job.on[t] | job.off[t]; lanes != 0; lanes &= lanes - 1) {
      const int lane = std::countr_zero(lanes);
      const bool on = (job.on[t] >> lane & 1) != 0;
      const double leaked = job.leaked[t * TILE_LANES + lane];
      const double current = job.current[t * TILE_LANES + lane];
      const double threshold = on ? settings_.bilif.v_on : -settings_.bilif.v_off;
      const int count = static_cast<int>(job.count[t * TILE_LANES + lane]);
      const size_t row = static_cast<size_t>(lane / TILE_SIDE);
      const size_t pixel = job.place.pixel + row * width_ + static_cast<size_t>(lane % TILE_SIDE);
      for (int n = 1; n <= count; n++) {
        const uint32_t stamp = spike_time(leaked, current, threshold, n, tick);
        rows[row].push_back({static_cast<uint32_t>(pixel), (stamp << TAG_BITS) | (on ? 1u : 0u)});
      }
    }
  }
}

}  // namespace evs
