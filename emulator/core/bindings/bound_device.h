// Shared by the bindings of what runs on a device with memory of its own.
#pragma once

#include <cstring>

#include "base/device_block.h"
#include "bindings/bound_caster.h"
#include "bindings/bound_pixels.h"
#include "render/device_frame.h"
#include "sensor/device_pixels.h"
#include "sensor/pixel_array.h"

namespace evs {

template <class T>
T* at(uint64_t address) {
  return reinterpret_cast<T*>(address);
}

struct BoundDeviceFrame {
  const BoundCaster& caster;
  DeviceFrame frame;
  bool adaptive;
};

// Where pixels write what they find, and how much room a block of them has there.
struct DeviceRoom {
  uint64_t crossings;
  uint32_t crossing_room;
  uint64_t candidates;
  uint32_t candidate_room;
  uint64_t counts;
};

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
    return pixels_.needed(addresses_of(addresses));
  }

  // The argument of the kernels for a tick, the first after so many ticks.
  DevicePixels arguments(uint64_t constant, const PixelArrays& arrays, const Tick& tick,
                         int64_t ticks, const DeviceRoom& room) const {
    DevicePixels made{pixels_.array().prepare(pixels_.with_gains(arrays, ticks), tick),
                      pixels_.array().pixels(),
                      room.crossing_room,
                      room.candidate_room,
                      at<Crossing>(room.crossings),
                      at<ShotCandidate>(room.candidates),
                      at<BlockCounts>(room.counts)};
    DeviceBlock block(constant, nullptr);
    const Constant there = lay_out(block);
    made.step.pattern = there.pattern;
    made.step.settings.shot.on = there.shot_on;
    made.step.settings.shot.off = there.shot_off;
    made.step.shot_bounds = there.shot_bounds;
    return made;
  }

  void copy_arguments(uint64_t constant, const nb::dict& arrays, uint64_t luminance,
                      int64_t clock_us, int64_t tick_us, int64_t ticks, bool all_due,
                      uint64_t row_reads, size_t row_read_count, uint64_t crossings,
                      uint32_t crossing_room, uint64_t candidates, uint32_t candidate_room,
                      uint64_t counts, Array<uint8_t, 1> out) const {
    require_size(out, sizeof(DevicePixels));
    BoundPixels::check_tick_us(tick_us);
    Tick tick{at<const float>(luminance), clock_us, static_cast<uint32_t>(tick_us)};
    tick.rows = {at<const RowRead>(row_reads), row_read_count, pixels_.width()};
    tick.all_due = all_due;
    const DevicePixels made =
        arguments(constant, needed(arrays), tick, ticks,
                  {crossings, crossing_room, candidates, candidate_room, counts});
    std::memcpy(out.data(), &made, sizeof made);
  }

 private:
  // What stays, where it lies.
  struct Constant {
    PixelPattern pattern;
    const float *shot_on, *shot_off;
    const double* shot_bounds;
  };

  Constant lay_out(DeviceBlock& block) const {
    const PixelArray& array = pixels_.array();
    const ShotNoise& shot = array.settings().shot;
    PixelPattern pattern = array.pattern();
    const size_t count = array.pixels();
    for (const float** each : {&pattern.theta_on, &pattern.theta_off, &pattern.leak,
                               &pattern.parasitic, &pattern.phase}) {
      *each = block.put(*each, count);
    }
    pattern.hot = block.put(pattern.hot, count);
    pattern.refractory = block.put(pattern.refractory, count);
    const float *on = block.put(shot.on, count), *off = block.put(shot.off, count);
    return {pattern, on, off, block.put(array.shot_bounds().data(), array.shot_bounds().size())};
  }

  static PixelArrays addresses_of(const nb::dict& arrays) {
    auto find = [&]<class T>(const char* name, T*& to) {
      if (arrays.contains(name)) to = at<T>(nb::cast<uint64_t>(arrays[name]));
    };
    PixelArrays found;
    find("reference", found.reference);
    find("last_log", found.last_log);
    find("last_luminance", found.last_luminance);
    find("filtered", found.filtered);
    find("followed", found.followed);
    find("blind_until", found.blind_until);
    find("noise_budget", found.noise_budget);
    find("noise_mean", found.noise_mean);
    find("noise_memory", found.noise_memory);
    find("mean", found.running_mean.mean);
    find("noise", found.running_mean.noise);
    find("drift", found.running_mean.drift);
    find("due_us", found.due_us);
    find("since_us", found.since_us);
    find("shot_next", found.shot.next);
    find("shot_count", found.shot.count);
    return found;
  }

  static void require_size(const Array<uint8_t, 1>& out, size_t bytes) {
    if (out.shape(0) != bytes) throw std::invalid_argument("out has another size");
  }

  const BoundPixels& pixels_;
  uint64_t constant_bytes_;
};

}  // namespace evs
