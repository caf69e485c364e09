// What the native core's own tests share: a scene of everything, and who counts the failures.
#pragma once

#include <algorithm>
#include <random>
#include <vector>

#include "render/caster.h"
#include "sensor/pixel.h"

namespace evs {

extern int failures;

// Print `what` and count it where it does not hold.
void check(bool holds, const char* what);

// The arrays of the state of pixels, as before the first light.
class PixelMemory {
 public:
  PixelArrays arrays;

  PixelMemory(const PixelSettings& settings, const PixelPattern& pattern, size_t count) {
    each_array(arrays, settings, pattern,
               [&]<class T>(const char*, T*& array, size_t pixels, double first, bool on) {
                 if (!on) return;
                 const size_t numbers = (count + pixels - 1) / pixels;
                 memory_.emplace_back(numbers * sizeof(T));
                 array = reinterpret_cast<T*>(memory_.back().data());
                 std::fill_n(array, numbers, static_cast<T>(first));
               });
  }

  const std::vector<std::vector<char>>& bytes() const { return memory_; }

 private:
  std::vector<std::vector<char>> memory_;
};

// Poses of a scene, as Python would hand them over.
struct Stage {
  std::vector<double> geom_pos, geom_mat, light_pos, light_dir;
  std::vector<double> camera_pos = {0, -4, 1}, camera_mat = {1, 0, 0, 0, 0, -1, 0, 1, 0};

  Poses poses() const {
    return {geom_pos.data(),  geom_mat.data(),   light_pos.data(),
            light_dir.data(), camera_pos.data(), camera_mat.data()};
  }
};

// Every shape, texture and kind of light; lights are coloured unless the tint is 0.5.
SceneData scene_of_everything(float tint);

// The features of a scene of many geoms and lights.
ForcedFeatures as_with_many();

// Its geoms at random places within `scale` of the origin.
Stage stage_of(const SceneData& s, std::mt19937& random, double scale);

// Each operation of the wide code gives a lane what it gives one lane alone.
void lanes_depend_on_themselves_alone();

// The render path allocates nothing after its first tick.
void ticks_allocate_nothing();

// The event pixel with each of its terms, on light of every kind.
void pixels_survive_any_light();

// EvSNet on light of every kind, in chunks of any length.
void networks_survive_any_light();

// The readout with any settings.
void readouts_lose_nothing_uncounted();

// The row accesses of the arbiter, in batches.
void row_access_times_are_drawn_exactly();

}  // namespace evs
