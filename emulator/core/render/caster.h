// The caster: one camera's view of one scene, tick after tick. Scalar code around the wide kernels.
#pragma once

#include <memory>
#include <optional>
#include <string>
#include <vector>

#include "appearance.h"
#include "emitters.h"
#include "feature_flags.h"
#include "incremental/packet_cache.h"
#include "incremental/path_cache.h"
#include "integrators/antialiasing.h"
#include "optics.h"
#include "pool.h"
#include "scene.h"
#include "scene_data.h"

namespace evs {

// Where everything is, in the world's frame, double. Shapes as emulator/scene.py gives them.
struct Poses {
  const double *geom_pos, *geom_mat, *light_pos, *light_dir, *camera_pos, *camera_mat;
  int seed = 0;  // of the paths' samples
};

// How the light is found, and what is given of it.
struct Tracing {
  int samples = 1;           // a pixel
  bool adaptive = false;     // direct: all of them only where neighbours differ, one elsewhere
  bool shadows = true;       // direct
  bool incremental = false;  // a still camera keeps what nothing that moved can touch
  bool rgb = false;          // `render` can give colour
  bool path = false;         // else: direct
  int bounces = 0;           // of paths
  SampleSet sample_set = SAMPLES_OWEN;
  Forced forced = {};  // code paths that are on or off whatever the scene asks for
};

// What a caster has done since it was made.
struct Work {
  long ticks = 0;
  long packets_asked = 0;   // whether something that moved can touch them
  long packets_traced = 0;  // 4 x 4 pixels
  long packets_relit = 0;   // others, of which only the light was found again
  long trees_built = 0;     // one for each mesh
  long trees_refitted = 0;
};

class Caster {
 public:
  // threads: 0 is one a core; isa: "auto" or one of isa_available(). before: what showed the scene
  // until now, whose threads and images are shared where they are the same; or null.
  Caster(const SceneData& scene, const Optics& optics, const Tracing& tracing, int threads = 1,
         const std::string& isa = "auto", const Caster* before = nullptr);

  // Out: luminance (h, w) and, where Tracing::rgb was set, linear rgb (h, w, 3) or null: the same
  // memory, untouched, in every call.
  void render(const Poses& poses, float* luminance, float* rgb);

  // What each pixel's centre shows; geoms as indices into geom_type, triangles as a mesh's faces.
  void trace_truth(const Poses& poses, const Truth& out);

  // Luminance (count) of single pixels, which lie in the image: the same as `render` gives them.
  // Nothing is kept from it, and nothing that is kept is used.
  void trace_pixels(const Poses& poses, const int32_t* x, const int32_t* y, int count,
                    float* luminance);

  // Each light's strength from now on, 1 as the scene has it. In: gains (light_count), >= 0.
  void set_light_gains(const float* gains);

  // New vertices and normals (nv, 3) of a mesh, before a call of render.
  void deform_mesh(int mesh, const float* vertices, const float* normals);
  // New sizes (count, 3) of geoms that are neither planes nor meshes, before a call of render. With
  // a radius of 0 none is hit. Paths do not aim at them, from now on.
  void resize_geoms(const int32_t* geoms, const float* sizes, int count);
  int shape(int geom) const { return geoms_.at(static_cast<size_t>(place_.at(geom))).shape; }
  int mesh_count() const { return static_cast<int>(mesh_data_.size()); }
  const SceneData::MeshData& mesh(int index) const { return *mesh_data_.at(index); }
  // For another scene with the same mesh: shared until one of them deforms it.
  const std::shared_ptr<SceneData::MeshData>& shared_mesh(int index) const {
    return mesh_data_.at(index);
  }

  // For the tests of the samplers: the kernel and what it reads, with everything in its place.
  // Paths only.
  struct Placed {
    const Kernel& kernel;
    const Frame& frame;
    const PathFrame& paths;
  };
  Placed placed(const Poses& poses) {
    place_geoms(poses);
    place_lights(poses);
    place_air();
    return {*kernel_, frame_, paths_};
  }

  double traced_fraction() const { return traced_fraction_; }
  int channels() const { return frame_.channels; }
  // Which code paths it runs: as the last tick was placed, where that decides.
  FeatureFlags features() const;
  const Work& work() const { return work_; }

 private:
  struct Spheres {  // structure of arrays behind a Bounds
    std::vector<float> x, y, z, radius;
    void reserve(int count);
    void resize(int count);
    void set(int i, const Ball& s);
    Bounds view() const;
  };

  void set_paths();
  void place_geoms(const Poses& poses);
  uint32_t idle_planes(const Light& light) const;
  void place_lights(const Poses& poses);
  void place_air();
  void find_moved();
  void add_moved(const Rod& before, const Rod& now);
  bool same_lights() const;
  void trace_paths(bool first, bool same, bool same_lamps, const Outputs& out);
  bool same_images() const;
  uint32_t steady_lights() const;
  void trace_direct(bool still, bool selective, const Outputs& out);
  void end_tick();
  Ball sphere_of(const Geom& g) const;
  Ball mirrored_in_plane() const;

  const Kernel* kernel_;
  std::shared_ptr<Pool> pool_;
  bool incremental_;
  Forced forced_;
  Work work_;
  std::vector<std::shared_ptr<SceneData::MeshData>> mesh_data_;
  Appearance look_;
  std::optional<Emitters> emitters_;  // of paths only
  std::optional<KeptPaths> kept_;     // of paths that are traced only where something changed
  PathFrame paths_ = {};
  std::unique_ptr<PathBatch[]> batches_;  // of each worker
  int previous_seed_ = 0;
  std::vector<Mesh> meshes_;
  std::vector<Light> previous_lights_;
  std::vector<float> gains_;        // of each light
  std::vector<Light> full_lights_;  // at gain 1
  int haze_plane_ = -1;             // kernel's geom, -1 none
  std::vector<int> order_;  // kernel's geom -> scene's geom: planes first, then shapes, then meshes
  std::vector<int> place_;  // scene's geom -> kernel's geom
  std::vector<Geom> geoms_, previous_geoms_;
  std::vector<Ball> balls_, previous_balls_;  // around each geom
  std::vector<std::vector<float>> shapes_;    // last vertices and normals of each deforming mesh
  std::vector<bool> deformed_;                // meshes, since the last render
  Spheres spheres_, moved_;
  std::vector<Rod> moved_rods_;    // around geoms that moved, before and now
  std::vector<Ball> moved_balls_;  // around those; as `moved_`
  Ball around_moved_ = {{0, 0, 0}, -1};
  Sampling sampling_ = {};
  std::optional<RayBlocks> ray_blocks_;  // of `direct`, incremental
  bool recorded_ = false;                // in the last tick
  std::vector<double> camera_;           // previous pose, 12 numbers; empty before the first call
  Frame frame_ = {};
  std::optional<Antialiasing> antialiasing_;  // none: all samples everywhere
  double traced_fraction_ = 1;
};

// A ball around balls, empty if there are none. Those that are not finite: around everything.
Ball ball_around(const Ball* balls, size_t count);

// Instruction sets that this build and this machine have, fastest first; and the kernel of one.
std::vector<std::string> isa_available();
const Kernel* kernel_of(const std::string& isa);

}  // namespace evs
