// Shared by the bindings of what runs on a device with memory of its own.
#pragma once

#include <nanobind/stl/tuple.h>

#include <cstring>
#include <tuple>

#include "base/device_block.h"
#include "bindings/bound_caster.h"
#include "bindings/bound_pixels.h"
#include "render/device_frame.h"
#include "sensor/device_pixels.h"
#include "sensor/pixel_array.h"

namespace evs {

struct BoundDeviceFrame {
  const BoundCaster& caster;
  DeviceFrame frame;
  bool adaptive;
};

// Where pixels write what they find, and how much room a block of them has there: crossings,
// crossing_room, candidates, candidate_room, counts.
using DeviceRoom = std::tuple<uint64_t, uint32_t, uint64_t, uint32_t, uint64_t>;

class BoundDevicePixels {
 public:
  explicit BoundDevicePixels(const BoundPixels& pixels) : pixels_(pixels) {
    DeviceBlock counted(0, nullptr);
    lay_out(counted);
    constant_bytes_ = counted.bytes();
  }

  uint64_t constant_bytes() const { return constant_bytes_; }

  void copy_constant(uint64_t address, Array<uint8_t, 1> out) const {
    require_size(out, constant_bytes_);
    DeviceBlock block(address, reinterpret_cast<char*>(out.data()));
    lay_out(block);
  }

  // The arrays of a state where they lie on the device. Throws std::invalid_argument where one is
  // not there.
  PixelArrays needed(const nb::dict& addresses) const {
    return pixels_.read_state(addresses, []<class T>(nb::handle address, size_t, T*& array) {
      array = at<T>(nb::cast<uint64_t>(address));
    });
  }

  // The argument of the kernels for a tick, the first after so many ticks.
  DevicePixels arguments(uint64_t constant, const PixelArrays& arrays, const Tick& tick,
                         int64_t ticks, const DeviceRoom& room) const {
    const auto [crossings, crossing_room, candidates, candidate_room, counts] = room;
    DevicePixels made{pixels_.array().prepare(pixels_.with_gains(arrays, ticks), tick),
                      pixels_.array().pixels(),
                      crossing_room,
                      candidate_room,
                      at<Crossing>(crossings),
                      at<ShotCandidate>(candidates),
                      at<BlockCounts>(counts)};
    DeviceBlock block(constant, nullptr);
    const Constant there = lay_out(block);
    made.step.pattern = there.pattern;
    made.step.shot_bounds = there.shot_bounds;
    return made;
  }

  void copy_arguments(uint64_t constant, const nb::dict& arrays, uint64_t luminance,
                      int64_t clock_us, int64_t tick_us, int64_t ticks, bool all_due,
                      uint64_t row_reads, size_t row_read_count, const DeviceRoom& room,
                      Array<uint8_t, 1> out) const {
    require_size(out, sizeof(DevicePixels));
    BoundPixels::check_tick_us(tick_us);
    Tick tick{at<const float>(luminance), clock_us, static_cast<uint32_t>(tick_us)};
    tick.rows = {at<const RowRead>(row_reads), row_read_count, pixels_.width()};
    tick.all_due = all_due;
    const DevicePixels made = arguments(constant, needed(arrays), tick, ticks, room);
    std::memcpy(out.data(), &made, sizeof made);
  }

 private:
  // What stays, where it lies.
  struct Constant {
    PixelPattern pattern;
    const double* shot_bounds;
  };

  Constant lay_out(DeviceBlock& block) const {
    const PixelArray& array = pixels_.array();
    PixelPattern pattern = array.pattern();
    pattern.each([&](const char*, auto*& each) { each = block.put(each, array.pixels()); });
    return {pattern, block.put(array.shot_bounds().data(), array.shot_bounds().size())};
  }

  static void require_size(const Array<uint8_t, 1>& out, size_t bytes) {
    if (out.shape(0) != bytes) throw std::invalid_argument("out has another size");
  }

  const BoundPixels& pixels_;
  uint64_t constant_bytes_;
};

}  // namespace evs
