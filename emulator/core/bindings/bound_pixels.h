// Shared by the bindings of the event pixel: arrays of checked shape, and pixels with a fixed
// pattern whose state the caller owns.
#pragma once

#include <nanobind/nanobind.h>
#include <nanobind/ndarray.h>
#include <nanobind/stl/optional.h>
#include <nanobind/stl/string.h>

#include <algorithm>
#include <array>
#include <memory>
#include <optional>
#include <stdexcept>
#include <string>
#include <vector>

#include "bindings/gil.h"
#include "bindings/values.h"
#include "sensor/events.h"
#include "sensor/pixel_array.h"

namespace nb = nanobind;

namespace evs {

template <class T>
using FrameIn = Array<const T, 2>;

class BoundPixels {
 public:
  BoundPixels(nb::object settings, nb::object pattern, int width, int height, int threads,
              const std::string& isa);
  BoundPixels(const BoundPixels&) = delete;
  BoundPixels& operator=(const BoundPixels&) = delete;

  // The arrays of a state whose terms are on: read(value, pixels, array) each of those values by
  // name. Throws std::invalid_argument where one is not there.
  template <class Read>
  PixelArrays read_state(const nb::dict& state, Read&& read) const {
    PixelArrays arrays;
    each_array(arrays, array_->settings(), array_->pattern(),
               [&](const char* name, auto*& array, size_t pixels, double, bool on) {
                 if (!on) return;
                 const nb::handle value = PyDict_GetItemString(state.ptr(), name);
                 require(value.is_valid(), "the state lacks a term that is on");
                 read(value, pixels, array);
               });
    return arrays;
  }

  // The memory of a state. Throws std::invalid_argument where it is of another sensor, too.
  PixelArrays bind(const nb::dict& state) const {
    return read_state(state, [&]<class T>(nb::handle value, size_t pixels, T*& array) {
      array = pixels == 1 ? memory<T, 2>(value, {height_, width_})
                          : memory<T, 1>(value, {(width_ * height_ + pixels - 1) / pixels});
    });
  }

  // With the gains of the running mean after so many ticks.
  PixelArrays with_gains(PixelArrays arrays, int64_t ticks) const {
    const PixelSettings& settings = array_->settings();
    const float first = 1.0f / static_cast<float>(ticks + 1);
    arrays.running_mean.noise_gain = std::max(settings.noise_gain, first);
    arrays.running_mean.drift_gain = settings.drift_gain;
    arrays.running_mean.noise_weight = settings.noise_weight;
    arrays.running_mean.least_gain = std::max(settings.least_gain, first);
    return arrays;
  }

  // Step all pixels by a tick, the first after so many ticks; needs no GIL.
  EventBuffer step(PixelArrays arrays, const Tick& tick, int64_t t_begin_us, int64_t ticks,
                   size_t& clamped);

  nb::tuple step_tick(FrameIn<float> luminance, int64_t t_begin_us, int64_t clock_us,
                      int64_t tick_us, int64_t ticks, const nb::dict& state,
                      std::optional<Array<const int32_t, 2>> row_reads, bool all_due);

  const PixelArray& array() const { return *array_; }
  size_t width() const { return width_; }
  size_t height() const { return height_; }
  bool causes() const { return array_->settings().causes; }
  static void check_tick_us(int64_t tick_us) {
    if (tick_us <= 0 || tick_us >= (int64_t{1} << 28)) {
      throw std::invalid_argument("tick_us must be in [1, 2^28)");
    }
  }

  // The names of the arrays of the state that are on.
  std::vector<std::string> state() const;

  void settle(int64_t clock_us, const nb::dict& state) const {
    array_->settle(bind(state), clock_us);
  }

 private:
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
  // The memory of an array. Throws std::invalid_argument for those of another type or shape.
  template <class T, size_t DIMENSIONS>
  static T* memory(nb::handle value, const std::array<size_t, DIMENSIONS>& shape) {
    Array<T, DIMENSIONS> array;
    require(nb::try_cast(nb::borrow(value), array, false), "an array has another type");
    for (size_t i = 0; i < DIMENSIONS; i++) {
      require(array.shape(i) == shape[i],
              DIMENSIONS == 2 ? "every array of pixels must be (height, width)"
                              : "every array of blocks must have one number for 64 pixels");
    }
    return array.data();
  }

  size_t width_;
  size_t height_;
  nb::object keep_;  // memory of the pattern
  std::unique_ptr<PixelArray> array_;
};

}  // namespace evs
