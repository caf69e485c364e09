// What paths keep from tick to tick while the camera stands, scalar code around retrace.h.
//
// A sample is traced again when something that one of its rays met has moved, or when the motion
// since it was traced, that of the fastest thing summed over the ticks, has used up the gap between
// its rays and whatever moves. So nothing is foreseen, and no bound is ever left.
#pragma once

#include <cstdint>
#include <vector>

#include "geometry/bounding_capsule.h"
#include "large_pages.h"
#include "path_scene.h"

namespace evs {

class KeptPaths {
 public:
  // What a tick does: trace everything and keep nothing, or all of it, or trace what may have
  // changed.
  enum class Plan { FORGET, ALL, SOME };

  KeptPaths(int width, int height, int samples, size_t geoms);

  // Geoms and the balls around them, now and in the last tick.
  struct Places {
    const std::vector<Geom>&now, &before;
    const std::vector<Ball>&balls, &balls_before;
    const std::vector<bool>& deformed;  // meshes
    const int* emitter_of_geom;         // at which paths aim, else -1
  };
  // same: camera, sky and seed are those of the last tick; same_lamps: and MuJoCo's lights; steady:
  // which of them are and cast no shadow.
  Plan plan(const Places& places, bool same, bool same_lamps, uint32_t steady);
  const KeptLight& light() const { return light_; }
  // After the tick. In: the share of the samples that was traced.
  void traced(double share);

 private:
  bool follow(const Places& places, double& farthest, bool& is_new);
  void start_again();

  KeptLight light_ = {};
  size_t entries_;
  LargeArray<float> numbers_;
  LargeArray<uint32_t> touched_;
  std::vector<int32_t> seen_;
  std::vector<float> balls_;
  std::vector<uint8_t> unlit_;
  std::vector<uint32_t> due_, doubtful_;
  LargeArray<float> fans_;
  std::vector<float> soonest_;
  std::vector<uint32_t> met_;
  std::vector<uint8_t> changed_;
  float* rest_[6] = {};          // KeptLight's, once it is kept
  std::vector<bool> watched_;    // geoms that have ever moved
  std::vector<int32_t> moving_;  // geoms that moved since the last tick
  std::vector<Rod> rods_;
  bool valid_ = false;
  double travelled_ = 0;
  int ticks_ = 0;        // since `until` was counted from 0
  int lamps_still_ = 0;  // ticks
  int pause_ = 0;        // ticks until keeping is tried again
};

}  // namespace evs
