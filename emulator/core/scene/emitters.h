// Emitters of the `path` integrator: emissive geoms and the environment as light sources that can
// be sampled. Built once; nothing here moves.
#pragma once

#include <vector>

#include "scene/appearance.h"
#include "scene/path_scene.h"
#include "scene/scene_data.h"

namespace evs {

class Emitters {
 public:
  // order: kernel's geom -> scene's geom. The appearance has three channels.
  Emitters(const SceneData& scene, const Appearance& appearance, const std::vector<int>& order);

  // The mesh deforms from now on: its geoms are found by BSDF sampling only.
  void forget_mesh(int mesh);
  // The same for one geom. Returns whether it was an emitter.
  bool forget_geom(int geom);

  // Return the constant part of a frame, which points into this.
  PathFrame frame() const;

  // The geoms that rays can pass through, in ascending order.
  const std::vector<int>& transparent_geoms() const { return transparent_geoms_; }

 private:
  struct EmissiveGeom {
    int geom, mesh;
    double power;
    float area;
    std::vector<float> cumulative;
    bool uniform;
    int axis;
  };

  template <class Which>
  bool remove_emitters(Which which);
  void update_probabilities();
  void make_environment(const Appearance& appearance);

  std::vector<EmissiveGeom> emissive_geoms_;
  std::vector<Emitter> emitters_;
  std::vector<int> emitter_of_geom_, transparent_geoms_;
  std::vector<float> rows_, cells_, pdf_;
  std::vector<int32_t> row_guide_, cell_guide_;
  int side_ = 0;
  bool emissive_ = false, has_environment_ = false;
  int lamp_count_ = 0;
  float ambient_radiance_[3] = {0, 0, 0};
};

}  // namespace evs
