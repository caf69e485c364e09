// The caster renders one camera's view of one scene, tick after tick. Scalar code around the wide
// kernels.
#pragma once

#include <memory>
#include <optional>
#include <string>
#include <vector>

#include "base/thread_pool.h"
#include "render/feature_flags.h"
#include "render/geometry/geom_bvh.h"
#include "render/incremental/packet_cache.h"
#include "render/incremental/path_cache.h"
#include "render/integrators/antialiasing.h"
#include "render/integrators/edge_sampling.h"
#include "render/irradiance/irradiance_cache.h"
#include "scene/appearance.h"
#include "scene/emitters.h"
#include "scene/optics.h"
#include "scene/scene.h"
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
};

// Work done since the caster was made.
struct WorkCounters {
  long ticks = 0;
  long packets_tested = 0;  // tested for moving geoms
  long packets_traced = 0;  // 4 x 4 pixels
  long packets_relit = 0;   // others, whose light alone was computed again
  long bvhs_built = 0;      // one per mesh
  long bvhs_refitted = 0;
};

class Caster {
 public:
  // threads: 0 is one per core; isa: "auto" or one of isa_available(). before: the caster that
  // rendered the scene until now, whose threads and images are shared where they are equal; or
  // null.
  Caster(const SceneData& scene, const Optics& optics, const Tracing& tracing, int threads = 1,
         const std::string& isa = "auto", const Caster* before = nullptr);

  // Out: luminance (h, w) and, with Tracing::rgb, linear rgb (h, w, 3) or null. Pass the same
  // memory, unmodified, to every call.
  void render(const Poses& poses, float* luminance, float* rgb);

  // Render ground truth at each pixel's centre. Geoms are indices into geom_type, triangles a
  // mesh's faces.
  void trace_truth(const Poses& poses, const Truth& out);

  // Render the luminance (count) of single pixels inside the image, equal to that of `render`. No
  // cache is read or written.
  void trace_pixels(const Poses& poses, const int32_t* x, const int32_t* y, int count,
                    float* luminance);

  // Scale each light's strength from now on; 1 is the scene's. In: gains (light_count), >= 0.
  void set_light_gains(const float* gains);

  // Set new vertices and normals (nv, 3) of a mesh, before a call of render.
  void deform_mesh(int mesh, const float* vertices, const float* normals);
  // Set new sizes (count, 3) of geoms that are neither planes nor meshes, before a call of render.
  // A geom with radius 0 is invisible. From now on the geoms are not sampled as emitters.
  void resize_geoms(const int32_t* geoms, const float* sizes, int count);
  int shape(int geom) const { return geoms_.at(static_cast<size_t>(place_.at(geom))).shape; }
  int mesh_count() const { return static_cast<int>(mesh_data_.size()); }
  const SceneData::MeshData& mesh(int index) const { return *mesh_data_.at(index); }
  // To share the mesh with another scene, until one of them deforms it.
  const std::shared_ptr<SceneData::MeshData>& shared_mesh(int index) const {
    return mesh_data_.at(index);
  }

  // The irradiance cache of `hybrid`; or null.
  const IrradianceCache* irradiance() const { return irradiance_ ? &*irradiance_ : nullptr; }
  // Take back what IrradianceCache::save gave. Returns false, and changes nothing, where it is
  // damaged.
  bool restore_irradiance(long tick, int coarser, int nodes, const int32_t* ints,
                          const float* floats);
  // Forget what earlier ticks left in the light.
  void restart();

  // For the tests of the samplers: the kernel and its inputs, with everything placed. Paths only.
  struct KernelInputs {
    const Kernel& kernel;
    const Frame& frame;
    const PathFrame& paths;
  };
  KernelInputs kernel_inputs(const Poses& poses) {
    place_geoms(poses);
    place_lights(poses);
    place_medium();
    return {*kernel_, frame_, paths_};
  }

  // Not samples at edges of `path`, which a device does not render.
  bool fits_device() const { return !edges_; }
  // What a device needs to render a tick: see DeviceFrame.
  struct DeviceInputs {
    Frame frame;
    Frame first_pass;  // of adaptive antialiasing; else without samples
    PathFrame paths;
    const Appearance& appearance;
    size_t bvh_boxes[GeomBvh::LEVELS], bvh_geoms;
  };
  DeviceInputs device_inputs() const;
  // Where the pixels of a tick are traced: nowhere, as no light has changed, or on a device.
  enum class Place { NOWHERE, THERE };
  // Place everything for a tick that a device renders.
  Place place_for_device(const Poses& poses);
  // Trace all pixels of `hybrid`, after that.
  void trace_here(float* luminance);
  // What pixels of `hybrid` read on a device, in a pass over them that begins.
  const IrradianceCache& begin_device_pass(IrradianceCache::Pass pass);
  // Take which nodes they have read, (nodes), and the nodes that they miss, which are lit. Returns
  // false where there is no room, or where they are the first: the tick must then be traced by
  // `trace_here`.
  bool take_from_device(const uint8_t* used, const NodeRequest* missing, size_t count);
  // Take from where nodes were read, as IrradianceCache::take_first_readers.
  void take_first_readers(const uint64_t* words) { irradiance_->take_first_readers(words); }

  double traced_fraction() const { return traced_fraction_; }
  int channels() const { return frame_.channels; }
  // Return the active features, as of the last tick where that decides.
  FeatureFlags features() const;
  const WorkCounters& work() const { return work_; }

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

  void set_paths();
  void place_geoms(const Poses& poses);
  uint32_t non_occluding_planes(const Light& light) const;
  void place_lights(const Poses& poses);
  void place_medium();
  bool is_still(const Poses& poses);
  bool has_changed(size_t geom) const;
  void find_moved();
  bool same_lights() const;
  void trace_paths(bool first, bool same, bool same_lamps, const Outputs& out);
  long trace_pass(const Frame& f, const PathFrame& p, PathCache* cache, PathCache::Plan plan,
                  const uint32_t* marked, const Outputs& out);
  void set_hybrid(const Optics& optics, const Tracing& tracing, const SceneData& scene);
  void place_hybrid();
  // What packets of `hybrid` record: what kept_light.inl keeps while lamps rest, or all of it.
  enum class Recording { NOTHING, LIGHT, SURFACES };
  bool begin_hybrid(bool same);
  void trace_hybrid(bool selective, const Outputs& out);
  IrradianceCache::Tracer node_tracer();
  bool find_dirty_of_hybrid();
  bool hybrid_passes(const IrradianceCache::Tracer& tracer, Recording now, bool selective,
                     const Outputs& out);
  bool same_scene() const;
  bool same_images() const;
  uint32_t steady_lights() const;
  void trace_direct(bool still, bool selective, const Outputs& out);
  void end_tick();
  BoundingSphere bounding_sphere_of(const Geom& g) const;
  BoundingSphere mirrored_in_plane() const;

  const Kernel* kernel_;
  std::shared_ptr<ThreadPool> pool_;
  bool incremental_;
  ForcedFeatures forced_;
  WorkCounters work_;
  std::vector<std::shared_ptr<SceneData::MeshData>> mesh_data_;
  Appearance appearance_;
  std::optional<Emitters> emitters_;   // path, hybrid
  std::optional<EdgeSampling> edges_;  // path only; none: all samples everywhere
  // incremental `path` only: of all pixels, and of the other samples of those at an edge
  std::optional<PathCache> path_cache_, edge_cache_;
  std::optional<IrradianceCache> irradiance_;  // of `hybrid`
  // of `hybrid`, where lights are grey: the appearance for nodes, and that for pixels
  std::optional<Appearance> colours_, luminance_;
  std::vector<Light> node_lights_;
  std::vector<float> tint_;
  std::vector<LampPoint> lamp_points_;
  std::vector<uint8_t> incomplete_;  // packets that missed nodes
  // what packets keep (packets, samples, kept_rows, 16), and whether that is all; null: nothing
  std::unique_ptr<float[]> kept_;
  std::unique_ptr<float[]> kept_surfaces_;       // of packets, while lamps move
  size_t kept_floats_ = 0, surface_floats_ = 0;  // of a packet
  Recording kept_of_last_ = Recording::NOTHING;  // in the last tick, of every packet
  std::vector<uint8_t> kept_whole_;
  std::vector<BoundingSphere> emitter_spheres_;
  long rest_ticks_ = 0;  // of `hybrid`: ticks without a change
  PathFrame paths_ = {};
  std::unique_ptr<PathBatch[]> batches_;  // one per worker
  int previous_seed_ = 0;
  std::vector<Mesh> meshes_;
  std::vector<Light> previous_lights_;
  std::vector<float> gains_;        // one per light
  std::vector<Light> full_lights_;  // at gain 1
  int haze_plane_ = -1;             // kernel's geom, -1 none
  std::vector<int> order_;  // kernel's geom -> scene's geom: planes first, then shapes, then meshes
  std::vector<int> place_;  // scene's geom -> kernel's geom
  std::vector<Geom> geoms_, previous_geoms_;
  std::vector<BoundingSphere> bounding_spheres_, previous_spheres_;  // around each geom
  std::vector<std::vector<float>> shapes_;  // last vertices and normals of each deforming mesh
  std::vector<bool> deformed_;              // meshes, since the last render
  Spheres spheres_;
  std::optional<GeomBvhBuilder> bvh_;
  Reaches reaches_;  // of the lights
  // Geoms that moved, before and now; and, of `hybrid`, what SceneChange::soft says of them.
  Moved moved_, moved_soft_;
  Sampling sampling_ = {};
  std::optional<PacketCache> packet_cache_;  // of `direct` and `hybrid`, incremental
  bool recorded_ = false;                    // in the last tick
  std::vector<double> camera_;  // previous pose, 12 numbers; empty before the first call
  Frame frame_ = {};
  Frame colour_frame_ = {};                   // of `hybrid`: for the nodes of the cache
  std::optional<Antialiasing> antialiasing_;  // none: all samples everywhere
  double traced_fraction_ = 1;
};

// Return a sphere around spheres, empty if there are none. Non-finite spheres are bounded by
// everything.
BoundingSphere sphere_around(const BoundingSphere* spheres, size_t count);

// Return the instruction sets that this build and this machine support, fastest first; and the
// kernel of one.
std::vector<std::string> isa_available();
const Kernel* kernel_of(const std::string& isa);

}  // namespace evs
