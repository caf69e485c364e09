// The path cache: what `path` keeps between ticks while the camera stands still. Scalar code around
// dirty_set.inl.
//
// A sample is traced again when a geom that one of its rays touched has moved, or when the motion
// since it was traced (of the fastest geom, summed over the ticks) exceeds the gap between its rays
// and the moving geoms. No motion is predicted, so no bound can be violated.
#pragma once

#include <cstdint>
#include <vector>

#include "base/large_pages.h"
#include "render/geometry/bounding_capsule.h"
#include "scene/path_scene.h"

namespace evs {

class PathCache {
 public:
  // What a tick does: trace without the cache, trace everything into the cache, or trace the dirty
  // set.
  enum class Plan { TRACE_UNCACHED, TRACE_ALL, TRACE_DIRTY };

  // geoms: of the scene. marked: (h, columns / 32) one bit for each pixel to cache, as of each
  // tick, whose samples are cached in blocks; null: all pixels. first_geoms: keep those, too.
  PathCache(int width, int height, int samples, size_t geoms, const uint32_t* marked,
            bool first_geoms);

  // Geoms and their bounding spheres, now and in the last tick.
  struct GeomStates {
    const std::vector<Geom>&now, &before;
    const std::vector<BoundingSphere>&spheres, &spheres_before;
    const std::vector<bool>& deformed;  // meshes
    const int* emitter_of_geom;         // of sampled emitters, else -1
  };
  // same: camera, environment and seed are those of the last tick; same_lamps: so are MuJoCo's
  // lights; steady: which lights are unchanged and cast no shadow.
  Plan plan(const GeomStates& states, bool same, bool same_lamps, uint32_t steady);
  const PathCacheView& view() const { return view_; }
  // Call after the tick. In: the share of the samples that was traced.
  void traced(double share);

 private:
  bool track_motion(const GeomStates& states, double& max_motion, bool& is_new);
  void rebase_motion();

  PathCacheView view_ = {};
  size_t entries_;
  LargeArray<float> numbers_;
  LargeArray<uint32_t> touched_;
  LargeArray<int32_t> first_geoms_;
  std::vector<uint32_t> known_;
  std::vector<int32_t> hit_geoms_;
  std::vector<float> hit_spheres_;
  std::vector<uint8_t> only_steady_light_;
  std::vector<uint32_t> dirty_, expired_;
  LargeArray<float> secondary_rays_;
  std::vector<float> next_expiry_;
  std::vector<uint32_t> touched_any_;
  std::vector<uint8_t> changed_;
  float* indirect_[6] = {};      // PathCacheView's, once it is in use
  std::vector<bool> tracked_;    // geoms that have ever moved
  std::vector<int32_t> moving_;  // geoms that moved since the last tick
  std::vector<BoundingCapsule> capsules_;
  bool valid_ = false;
  double motion_ = 0;
  int ticks_ = 0;             // since the last rebase
  int still_lamp_ticks_ = 0;  // ticks
  int pause_ = 0;             // ticks until the cache is tried again
};

}  // namespace evs
