// A scene at one instant, seen by one camera: what the kernels read, and what has changed since the
// last tick.
#pragma once

#include <memory>
#include <optional>
#include <vector>

#include "render/feature_flags.h"
#include "render/geometry/geom_bvh.h"
#include "scene/appearance.h"
#include "scene/optics.h"
#include "scene/path_scene.h"
#include "scene/scene_data.h"

namespace evs {

// Poses in the world's frame, in double. Shapes as emulator/base/scene.py gives them.
struct Poses {
  const double *geom_pos, *geom_mat, *light_pos, *light_dir, *camera_pos, *camera_mat;
  int seed = 0;  // of the path sampler
};

// How light is computed, and which outputs are rendered.
struct Tracing {
  int samples = 1;           // per pixel
  bool adaptive = false;     // all samples only at edges; elsewhere one, or a quarter (path)
  bool shadows = true;       // direct
  bool incremental = false;  // under a still camera reuse what nothing that moved can affect,
                             // where the kernel can tell
  bool rgb = false;          // `render` can output colour
  bool path = false;
  bool hybrid = false;  // neither: direct
  int bounces = 0;      // of paths
  SampleSet sample_set = SAMPLES_OWEN;
  int nodes = 0;               // of the irradiance cache, at most; 0: as the image needs
  int block = 0, blocks = 1;   // the samples of paths are a block of a point set with so many
  ForcedFeatures forced = {};  // features forced on or off, whatever the scene needs

  // Do only pixels at the edges of geoms take all samples of a path?
  bool paths_at_edges() const { return path && adaptive && samples > 1; }
  // Samples that every pixel takes in the first pass of `path`, or in all of them.
  int base_samples() const;
};

class PlacedScene {
 public:
  // before: the scene until now, whose images are shared where they are equal; or null.
  PlacedScene(const SceneData& data, const Optics& optics, const Tracing& tracing,
              const PlacedScene* before);
  PlacedScene(const PlacedScene&) = delete;
  PlacedScene& operator=(const PlacedScene&) = delete;

  // Place geoms, lights and medium; or geoms alone.
  void place(const Poses& poses);
  void place_geoms(const Poses& poses);

  // Scale each light's strength from now on; 1 is the scene's. In: gains (light_count), >= 0.
  void set_light_gains(const float* gains);
  // Set new vertices and normals (nv, 3) of a mesh. Returns false where they are those of the last
  // call.
  bool deform_mesh(int mesh, const float* vertices, const float* normals);
  // Set a new size of the kernel's geom k.
  void resize_geom(int k, const float* size);

  // What has changed since the last tick. has_begun: there was one.
  bool has_begun() const { return !camera_.empty(); }
  // Is the camera where it was in the last call?
  bool is_still(const Poses& poses);
  bool same_lights() const;
  // Are the image lights those of the last tick?
  bool same_images() const;
  // Find which of the first 32 lights are unchanged and cast no shadow, one bit each.
  uint32_t steady_lights() const;
  // Are all geoms where they were in the last tick, in the same shape?
  bool same_geoms() const;
  // Has the kernel's geom k moved, or changed its shape?
  bool has_changed(size_t k) const;
  // Bound every geom that moved; soft: with what SceneChange::soft says of them as well.
  void find_moved(bool soft);
  bool any_moved() const { return !moved_.capsules.empty(); }
  SceneChange moved() const { return moved_.change(); }
  SceneChange moved_soft() const { return moved_soft_.change(); }
  // What is placed now is the last tick's from now on.
  void end_tick();

  // Put an empty sphere around the first geom: the kernels' bounds before the first tick.
  BoundingSphereArray first_bounds();
  BoundingSphereArray bounds() const { return spheres_.view(); }
  const GeomBvhBuilder& bvh() const { return *bvh_; }
  long packets() const { return static_cast<long>(sampling.rows) * sampling.columns; }

  Frame frame = {};
  Sampling sampling = {};
  Appearance appearance;
  std::vector<Light> full_lights, previous_lights;  // at gain 1; of the last tick
  std::vector<int> order;  // kernel's geom -> scene's geom: planes first, then shapes, then meshes
  std::vector<int> index;  // scene's geom -> kernel's geom
  std::vector<Geom> geoms, previous_geoms;
  std::vector<BoundingSphere> bounding_spheres, previous_spheres;  // around each geom
  std::vector<std::shared_ptr<SceneData::MeshData>> mesh_data;
  std::vector<bool> deformed;              // meshes, since the last tick
  long bvhs_built = 0, bvhs_refitted = 0;  // one per mesh

 private:
  struct Spheres {  // structure of arrays behind a BoundingSphereArray
    std::vector<float> x, y, z, radius;
    void reserve(int count);
    void resize(int count);
    void set(int i, const BoundingSphere& s);
    BoundingSphereArray view() const;
  };

  struct Moved {
    std::vector<BoundingCapsule> capsules;
    std::vector<BoundingSphere> spheres;  // around those
    Spheres view;                         // the same
    BoundingSphere around = {{0, 0, 0}, -1};
    void reserve(int geoms);
    void add(const BoundingCapsule& before, const BoundingCapsule& now);
    void finish();
    SceneChange change() const;
  };

  struct Reaches {  // structure of arrays behind a LightReachArray
    std::vector<float> parts[9];
    void resize(size_t lights);
    void set(size_t i, const Light& light);
    LightReachArray view() const;
  };

  void order_geoms(const SceneData& data);
  void reserve_tick();
  void set_frame(const Optics& optics, const Tracing& tracing);
  uint32_t non_occluding_planes(const Light& light) const;
  void place_lights(const Poses& poses);
  void place_medium();
  BoundingSphere bounding_sphere_of(const Geom& g) const;
  BoundingSphere mirrored_in_plane() const;

  ForcedFeatures forced_;
  bool has_bulbs_;  // lights have a size
  std::vector<Mesh> meshes_;
  std::vector<float> gains_;                // one per light
  int haze_plane_ = -1;                     // kernel's geom, -1 none
  std::vector<std::vector<float>> shapes_;  // last vertices and normals of each deforming mesh
  Spheres spheres_;
  std::optional<GeomBvhBuilder> bvh_;
  Reaches reaches_;             // of the lights
  Moved moved_, moved_soft_;    // geoms that moved, before and now
  std::vector<double> camera_;  // previous pose, 12 numbers; empty before the first call
};

// Return a sphere around spheres, empty if there are none. Non-finite spheres are bounded by
// everything.
BoundingSphere sphere_around(const BoundingSphere* spheres, size_t count);

}  // namespace evs
