// Glowing geoms and the sky as lights that can be aimed at, for the `path` integrator. Made once;
// nothing here moves.
#pragma once

#include <vector>

#include "appearance.h"
#include "path_scene.h"
#include "scene_data.h"

namespace evs {

class Emitters {
 public:
  // order: kernel's geom -> scene's geom. The appearance has three channels.
  Emitters(const SceneData& scene, const Appearance& look, const std::vector<int>& order);

  // The mesh changes its shape from now on: geoms that have it are found by chance only.
  void forget_mesh(int mesh);
  // The same of one geom; whether it was an emitter.
  bool forget_geom(int geom);

  // The constant part of a frame, which points into this.
  PathFrame frame() const;

 private:
  struct Glow {
    int geom, mesh;
    double power;
    float area;
    std::vector<float> cumulative;
  };

  template <class Which>
  bool forget(Which which);
  void share();
  void make_sky(const Appearance& look);

  std::vector<Glow> glows_;
  std::vector<Emitter> emitters_;
  std::vector<int> emitter_of_geom_;
  std::vector<float> rows_, cells_, density_;
  std::vector<int32_t> row_guide_, cell_guide_;
  int side_ = 0;
  bool transparent_ = false, glowing_ = false, open_ = false;
  int lamps_ = 0;
  float dome_[3] = {0, 0, 0};
};

}  // namespace evs
