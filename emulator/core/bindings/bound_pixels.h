// Shared by the bindings of the event pixel: arrays of checked shape, and pixels with a fixed
// pattern whose state the caller owns.
#pragma once

#include <nanobind/nanobind.h>
#include <nanobind/ndarray.h>
#include <nanobind/stl/optional.h>

#include <algorithm>
#include <memory>
#include <optional>
#include <stdexcept>
#include <string>

#include "bindings/gil.h"
#include "bindings/owned_array.h"
#include "sensor/events.h"
#include "sensor/pixel.h"

namespace nb = nanobind;

namespace evs {

template <class T, size_t DIMENSIONS>
using Array = nb::ndarray<T, nb::ndim<DIMENSIONS>, nb::c_contig, nb::device::cpu>;
template <class T>
using FrameIn = Array<const T, 2>;
template <class T>
using MaybeIn = std::optional<FrameIn<T>>;
template <class T>
using MaybeFrame = std::optional<Array<T, 2>>;
using MaybeBlocks = std::optional<Array<int64_t, 1>>;
using Bytes = nb::ndarray<nb::numpy, uint8_t, nb::ndim<1>>;

class PixelArray;

// The state as Python has it, emulator/sensor/pixel.py.
struct PixelState {
  Array<double, 2> reference;
  Array<float, 2> last_log, last_luminance;
  MaybeFrame<float> filtered, followed;
  MaybeFrame<int64_t> blind_until;
  MaybeFrame<double> noise_budget;
  MaybeFrame<float> noise_mean, noise_memory, mean, noise, drift;
  MaybeBlocks due_us, since_us, shot_next, shot_count;
};

class BoundPixels {
 public:
  BoundPixels(const PixelSettings& settings, int width, int height, FrameIn<float> theta_on,
              FrameIn<float> theta_off, MaybeIn<float> leak, MaybeIn<float> parasitic,
              MaybeIn<float> phase, MaybeIn<uint8_t> hot, MaybeIn<float> shot_on,
              MaybeIn<float> shot_off, MaybeIn<uint32_t> refractory, int threads,
              const std::string& isa);
  BoundPixels(const BoundPixels&) = delete;
  BoundPixels& operator=(const BoundPixels&) = delete;
  ~BoundPixels();

  // The memory of a state. Throws std::invalid_argument where it is of another sensor, or lacks a
  // term that is on.
  PixelArrays bind(const PixelState& state) const {
    PixelArrays arrays;
    arrays.reference = pixels(state.reference);
    arrays.last_log = pixels(state.last_log);
    arrays.last_luminance = pixels(state.last_luminance);
    arrays.filtered = pixels(state.filtered);
    arrays.followed = pixels(state.followed);
    arrays.blind_until = pixels(state.blind_until);
    arrays.noise_budget = pixels(state.noise_budget);
    arrays.noise_mean = pixels(state.noise_mean);
    arrays.noise_memory = pixels(state.noise_memory);
    arrays.running_mean.mean = pixels(state.mean);
    arrays.running_mean.noise = pixels(state.noise);
    arrays.running_mean.drift = pixels(state.drift);
    arrays.due_us = blocks(state.due_us);
    arrays.since_us = blocks(state.since_us);
    arrays.shot = {blocks(state.shot_next), blocks(state.shot_count)};
    return needed(arrays);
  }

  // Of the arrays of a state those whose terms are on. Throws std::invalid_argument where one is
  // not there.
  PixelArrays needed(PixelArrays arrays) const {
    arrays.filtered = needed(settings_.lowpass(), arrays.filtered);
    arrays.followed = needed(settings_.follower > 0.0, arrays.followed);
    arrays.blind_until = needed(settings_.refractory > 0, arrays.blind_until);
    const bool photon = settings_.photon.scale > 0.0;
    arrays.noise_budget = needed(photon, arrays.noise_budget);
    arrays.noise_mean = needed(photon, arrays.noise_mean);
    arrays.noise_memory = needed(photon, arrays.noise_memory);
    RunningMean& average = arrays.running_mean;
    average.mean = needed(settings_.running_mean, average.mean);
    average.noise = needed(settings_.running_mean, average.noise);
    average.drift = needed(settings_.running_mean, average.drift);
    arrays.due_us = needed(skips(), arrays.due_us);
    arrays.since_us = needed(skips(), arrays.since_us);
    const bool shot = settings_.shot.on != nullptr;
    arrays.shot.next = needed(shot, arrays.shot.next);
    arrays.shot.count = needed(shot, arrays.shot.count);
    return arrays;
  }

  // With the gains of the running mean after so many ticks.
  PixelArrays with_gains(PixelArrays arrays, int64_t ticks) const {
    const float first = 1.0f / static_cast<float>(ticks + 1);
    arrays.running_mean.noise_gain = std::max(settings_.noise_gain, first);
    arrays.running_mean.drift_gain = settings_.drift_gain;
    arrays.running_mean.noise_weight = settings_.noise_weight;
    arrays.running_mean.least_gain = std::max(settings_.least_gain, first);
    return arrays;
  }

  // Step all pixels by a tick, the first after so many ticks; needs no GIL.
  EventBuffer step(PixelArrays arrays, const Tick& tick, int64_t t_begin_us, int64_t ticks,
                   size_t& clamped);

  nb::tuple step_tick(FrameIn<float> luminance, int64_t t_begin_us, int64_t clock_us,
                      int64_t tick_us, int64_t ticks, Array<double, 2> reference,
                      Array<float, 2> last_log, Array<float, 2> last_luminance,
                      MaybeFrame<float> filtered, MaybeFrame<float> followed,
                      MaybeFrame<int64_t> blind_until, MaybeFrame<double> noise_budget,
                      MaybeFrame<float> noise_mean, MaybeFrame<float> noise_memory,
                      MaybeFrame<float> mean, MaybeFrame<float> noise, MaybeFrame<float> drift,
                      MaybeBlocks due_us, MaybeBlocks since_us, MaybeBlocks shot_next,
                      MaybeBlocks shot_count, std::optional<Array<const int32_t, 2>> row_reads,
                      bool all_due);

  const PixelArray& array() const { return *array_; }
  size_t width() const { return width_; }
  size_t height() const { return height_; }
  bool causes() const { return settings_.causes; }
  static void check_tick_us(int64_t tick_us) {
    if (tick_us <= 0 || tick_us >= (int64_t{1} << 28)) {
      throw std::invalid_argument("tick_us must be in [1, 2^28)");
    }
  }

  void settle(int64_t clock_us, Array<double, 2> reference, Array<float, 2> last_luminance,
              MaybeBlocks due_us, MaybeBlocks since_us, MaybeFrame<float> filtered,
              MaybeFrame<float> followed, MaybeFrame<double> noise_budget, MaybeFrame<float> mean);

 private:
  // Whether there is a term for which skipped blocks have to be looked at again.
  bool skips() const {
    return has_leak_ || settings_.lowpass() || settings_.follower > 0.0 ||
           settings_.highpass > 0.0 || settings_.refractory > 0 || settings_.running_mean;
  }
  // The row reads of a tick; throws std::invalid_argument for those outside sensor or tick.
  RowReads checked_reads(const Array<const int32_t, 2>& reads, int64_t tick_us) const {
    bool good = reads.shape(0) == 0 || reads.shape(1) == 2;
    for (size_t k = 0; good && k < reads.shape(0); k++) {
      const int32_t row = reads.data()[2 * k], offset = reads.data()[2 * k + 1];
      const int32_t earlier = k > 0 ? reads.data()[2 * k - 1] : 1;
      good =
          row >= 0 && static_cast<size_t>(row) < height_ && offset >= earlier && offset <= tick_us;
    }
    if (!good) throw std::invalid_argument("row reads are (row, us in the tick), by time");
    static_assert(sizeof(RowRead) == 2 * sizeof(int32_t));
    return {reinterpret_cast<const RowRead*>(reads.data()), reads.shape(0), width_};
  }
  template <class Frame>
  auto pixels(const Frame& frame) const -> decltype(frame.data()) {
    if (frame.shape(0) != height_ || frame.shape(1) != width_) {
      throw std::invalid_argument("every array of pixels must be (height, width)");
    }
    return frame.data();
  }
  template <class Frame>
  auto pixels(const std::optional<Frame>& frame) const -> decltype(frame->data()) {
    return frame ? pixels(*frame) : nullptr;
  }
  int64_t* blocks(const MaybeBlocks& line) const {
    if (!line) return nullptr;
    if (line->shape(0) != (width_ * height_ + kBlock - 1) / kBlock) {
      throw std::invalid_argument("every array of blocks must have one number for 64 pixels");
    }
    return line->data();
  }
  // The state of a term; required if the term is on, else null.
  template <class T>
  static T* needed(bool on, T* state) {
    if (on && state == nullptr) throw std::invalid_argument("the state lacks a term that is on");
    return on ? state : nullptr;
  }

  PixelSettings settings_;
  size_t width_;
  size_t height_;
  bool has_leak_ = false;
  nb::object keep_;  // memory of the pattern
  std::unique_ptr<PixelArray> array_;
};

}  // namespace evs
