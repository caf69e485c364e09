#include "network_array.h"

#include <bit>
#include <new>

#include "pixel_targets.h"

namespace evs {

const NetworkKernel* network_kernel_of(const std::string& isa) {
  const std::vector<std::string> names = isa_available();
  const std::string wanted = isa == "auto" ? names.front() : isa;
  if (std::find(names.begin(), names.end(), wanted) == names.end()) {
    throw std::invalid_argument("this machine cannot run instruction set '" + isa + "'; use auto");
  }
#if defined(__x86_64__)
  if (wanted == "avx512") return &NETWORK_AVX512;
  if (wanted == "avx2") return &NETWORK_AVX2;
#endif
  return &NETWORK_PORTABLE;
}

namespace {

// Bits of the least positive luminance that is none: DN rises with luminance, and so do bits.
uint32_t least_unusable(const LogMap& map) {
  uint32_t usable = 0, unusable = 0x7f800000u;
  while (unusable - usable > 1) {
    const uint32_t middle = usable + (unusable - usable) / 2;
    const float luminance = std::bit_cast<float>(middle);
    (is_light(luminance, to_dn(map, luminance)) ? usable : unusable) = middle;
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
      across_((width_ + kSide - 1) / kSide),
      down_((height_ + kSide - 1) / kSide),
      pool_(threads) {
  work_.resize(tiles());
  lines_.resize(down_);
  auto floats = [](size_t count) { return Floats(new (std::align_val_t{64}) float[count]()); };
  for (int worker = 0; worker < pool_.threads(); worker++) {
    benches_.push_back(
        {floats(settings_.net.scratch_floats()), floats(across_ * kChunk * kLanes), {}});
  }
  old_places_.resize(static_cast<size_t>(settings_.net.pixel_floats()));
  new_places_.resize(old_places_.size());
}

TilePlace NetworkArray::place(size_t tile) const {
  const size_t x = tile % across_ * kSide, y = tile / across_ * kSide;
  return {y * width_ + x, width_, static_cast<int>(std::min<size_t>(kSide, width_ - x)),
          static_cast<int>(std::min<size_t>(kSide, height_ - y))};
}

std::vector<EventBuffer> NetworkArray::step(NetworkArrays arrays, const NetworkChunk& chunk,
                                            const Grow& grow, NetworkCounts& counts) {
  const Front front{settings_.map, unusable_from_, chunk.luminance,       width_ * height_,
                    chunk.tick,    chunk.ticks,    arrays.last_luminance, arrays.last_log};
  const int lines = static_cast<int>(down_);
  rows_.begin(arrays.tile_row, tiles(), arrays.rows);  // refuses before anything has changed
  pool_.run(lines, [&](int line, int) { look(arrays, front, static_cast<size_t>(line)); });
  const size_t rows = settle(arrays, chunk);
  if (rows > arrays.rows) {
    arrays.fifo = grow(rows);
    arrays.rows = rows;
  }

  for (int t = 0; t < chunk.ticks; t++) crossings_[t].resize(down_ * kSide);
  if (chunk.currents != nullptr) {
    std::fill_n(chunk.currents, static_cast<size_t>(chunk.ticks) * front.frame, 0.0f);
  }
  find_places(chunk);
  pool_.run(lines, [&](int line, int worker) {
    const size_t down = static_cast<size_t>(line);
    Bench& bench = benches_[static_cast<size_t>(worker)];
    gather(arrays, chunk, down, bench);
    infer(chunk, bench);
    fire(arrays, chunk, down, bench);
  });
  std::vector<EventBuffer> events(static_cast<size_t>(chunk.ticks));
  pool_.run(chunk.ticks, [&](int t, int) {
    events[static_cast<size_t>(t)] = order_events(
        crossings_[t], chunk.begin_us + t * settings_.tick_us,
        static_cast<uint32_t>(settings_.tick_us), static_cast<uint32_t>(width_), false);
  });
  for (const Line& line : lines_) {
    counts.clamped += line.front.clamped;
    counts.x_clamped += line.front.x_clamped;
    counts.v_clamped += line.v_clamped;
  }
  return events;
}

// Light to X, for those tiles whose light changes.
void NetworkArray::look(const NetworkArrays& arrays, const Front& front, size_t down) {
  Line& line = lines_[down];
  line.front = {};
  line.v_clamped = 0;
  const size_t first = down * across_;
  std::vector<uint32_t> flags(across_, 0);
  const int rows = place(first).rows;
  kernel_->look(front, down * kSide * width_, width_, rows, flags.data());

  const size_t floats = static_cast<size_t>(front.ticks) * kLanes;
  size_t used = 0;
  for (size_t i = 0; i < across_; i++) {
    Work& work = work_[first + i];
    work = {};
    work.flags = flags[i];
    int64_t* moved = arrays.tile_moved + (first + i) * kLanes;
    if (arrays.tile_row[first + i] != -1) work.before = *std::max_element(moved, moved + kLanes);
    if (work.flags == 0) continue;
    if (line.x.size() < used + floats) line.x.resize(std::max(used + floats, 2 * line.x.size()));
    float* x = line.x.data() + used;
    work.moved = kernel_->to_x(front, place(first + i), work.flags, x, moved, line.front);
    if (work.moved == 0) continue;
    work.x = static_cast<int32_t>(used / kLanes);
    used += floats;
  }
}

// Which tiles have something to compute, and in which rows. Out: how many rows there must be.
size_t NetworkArray::settle(const NetworkArrays& arrays, const NetworkChunk& chunk) {
  const int64_t first = chunk.tick;
  const int64_t window = settings_.net.window(), hold = window + kChunk;
  for (size_t tile = 0; tile < tiles(); tile++) {
    Work& work = work_[tile];
    const int64_t moved = work.before;
    const bool held = arrays.tile_row[tile] != -1;
    work.hot = settings_.dense || work.moved != 0 || (held && moved >= first - window);
    if (settings_.dense) {
      if (!held) rows_.take(tile, 0);
    } else if (held || work.moved != 0) {
      const int moves = std::countr_zero(work.moved);  // kChunk where it does not
      if (held && moved < first + chunk.ticks - hold) {
        const int given = moved < first - hold ? 0 : static_cast<int>(moved + hold - first);
        if (given < moves) {
          rows_.give(tile, given);
          if (moves < kChunk) rows_.take(tile, moves);
        }
      } else if (!held) {
        rows_.take(tile, moves);
      }
    }
  }
  return rows_.settle(arrays.tile_row);
}

void NetworkArray::find_places(const NetworkChunk& chunk) {
  const int features = settings_.net.features();
  for (int slot = 0; slot < kOld; slot++) {
    // the oldest tick is in the slot that comes next
    auto age = [&](int64_t next) { return (slot - static_cast<int>(next % kOld) + kOld) % kOld; };
    const int before = age(chunk.tick), after = age(chunk.tick + chunk.ticks);
    for (int f = 0; f < features; f++) {
      const size_t at = static_cast<size_t>(slot * features + f);
      old_places_[at] = (f * kSlots + before) * kLanes;
      new_places_[at] = (f * kSlots + after) * kLanes;
    }
  }
}

// Those pixels of a line of tiles in whose windows some X is not 0.
void NetworkArray::gather(const NetworkArrays& arrays, const NetworkChunk& chunk, size_t down,
                          Bench& bench) {
  alignas(64) static constexpr float kStill[kChunk * kLanes] = {};
  const size_t floats = static_cast<size_t>(chunk.ticks) * kLanes, first = down * across_;
  const size_t pixel_floats = static_cast<size_t>(settings_.net.pixel_floats());
  const int64_t since = chunk.tick - settings_.net.window();
  float* current = bench.current.get();
  bench.pixels.clear();
  for (size_t tile = first; tile < first + across_; tile++) {
    const Work& work = work_[tile];
    if (!work.hot) continue;
    float* row = arrays.fifo + static_cast<size_t>(arrays.tile_row[tile]) * kLanes * pixel_floats;
    const float* x =
        work.x < 0 ? kStill : lines_[down].x.data() + static_cast<size_t>(work.x) * kLanes;
    const int64_t* moved = arrays.tile_moved + tile * kLanes;
    const uint32_t lanes = place(tile).lanes();
    std::fill_n(current, floats, 0.0f);
    for (size_t lane = 0; lane < kLanes; lane++) {
      const bool hot = settings_.dense || moved[lane] >= since;
      if (!hot || (lanes >> lane & 1) == 0) continue;
      bench.pixels.push_back({row + lane * pixel_floats, x + lane, current + lane});
    }
    current += floats;
  }
}

// Those pixels through all layers, 16 at once.
void NetworkArray::infer(const NetworkChunk& chunk, const Bench& bench) {
  PixelJob job;
  job.net = &settings_.net;
  job.scratch = bench.scratch.get();
  job.old_places = old_places_.data();
  job.new_places = new_places_.data();
  job.tick = chunk.tick;
  job.ticks = chunk.ticks;
  const std::vector<Pixel>& pixels = bench.pixels;
  for (size_t at = 0; at < pixels.size(); at += kLanes) {
    for (size_t i = 0; i < kLanes; i++) {
      const Pixel& pixel = pixels[std::min(at + i, pixels.size() - 1)];
      job.row[i] = pixel.row;
      job.x[i] = pixel.x;
      job.current[i] = pixel.current;
      job.next_row[i] = pixels[std::min(at + kLanes + i, pixels.size() - 1)].row;
    }
    kernel_->infer(job);
  }
}

// A line of tiles from currents to events.
void NetworkArray::fire(const NetworkArrays& arrays, const NetworkChunk& chunk, size_t down,
                        const Bench& bench) {
  alignas(64) static constexpr float kNone[kChunk * kLanes] = {};
  const size_t floats = static_cast<size_t>(chunk.ticks) * kLanes, first = down * across_;
  for (int t = 0; t < chunk.ticks; t++) {
    for (size_t r = 0; r < kSide; r++) crossings_[t][down * kSide + r].clear();
  }
  TileJob job;
  job.membrane = &settings_.membrane;
  job.tick = chunk.tick;
  job.ticks = chunk.ticks;
  job.v = arrays.v;
  job.last = arrays.last;
  const float* current = bench.current.get();
  for (size_t tile = first; tile < first + across_; tile++) {
    const bool hot = work_[tile].hot;
    if (!hot && arrays.tile_loud[tile] == 0) continue;
    job.place = place(tile);
    job.current = hot ? current : kNone;
    if (hot) current += floats;
    kernel_->fire(job);
    arrays.tile_loud[tile] = job.loud ? 1 : 0;
    lines_[down].v_clamped += job.v_clamped;
    if (job.fired != 0) cross(job, down);
    if (hot && chunk.currents != nullptr) give(job, chunk.currents);
  }
}

// A tile's currents into images of them.
void NetworkArray::give(const TileJob& job, float* currents) const {
  for (int t = 0; t < job.ticks; t++) {
    float* image = currents + static_cast<size_t>(t) * width_ * height_ + job.place.pixel;
    for (int r = 0; r < job.place.rows; r++) {
      const float* line = job.current + (t * kSide + r) * kSide;
      std::copy_n(line, job.place.columns, image + static_cast<size_t>(r) * width_);
    }
  }
}

// The events of a tile, to the lines of pixels that they belong to.
void NetworkArray::cross(const TileJob& job, size_t down) {
  const double tick = static_cast<double>(settings_.tick_us);
  for (uint32_t left = job.fired; left != 0; left &= left - 1) {
    const int t = std::countr_zero(left);
    std::vector<Crossing>* lines = crossings_[t].data() + down * kSide;
    for (uint32_t lanes = job.on[t] | job.off[t]; lanes != 0; lanes &= lanes - 1) {
      const int lane = std::countr_zero(lanes);
      const bool up = (job.on[t] >> lane & 1) != 0;
      const double before = job.before[t * kLanes + lane];
      const double level = up ? settings_.membrane.on : -settings_.membrane.off;
      // what was over its threshold already fires at once
      const bool missing = up ? before < level : before > level;
      const uint32_t stamp =
          missing ? crossing_time(level - before, job.current[t * kLanes + lane], tick) : 1;
      const size_t row = static_cast<size_t>(lane / kSide);
      const size_t pixel = job.place.pixel + row * width_ + static_cast<size_t>(lane % kSide);
      lines[row].push_back({static_cast<uint32_t>(pixel), (stamp << kWhenBits) | (up ? 1u : 0u)});
    }
  }
}

}  // namespace evs
