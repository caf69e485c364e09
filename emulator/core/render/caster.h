// The caster renders one camera's view of one scene, tick after tick: it places the scene, and its
// integrator traces the pixels.
#pragma once

#include <memory>
#include <string>
#include <vector>

#include "base/thread_pool.h"
#include "render/integrators.h"
#include "render/placed_scene.h"

namespace evs {

class Caster {
 public:
  // threads: 0 is one per core; isa: "auto" or one of isa_available(). before: the caster that
  // rendered the scene until now, whose threads and images are shared where they are equal; or
  // null.
  Caster(const SceneData& data, const Optics& optics, const Tracing& tracing, int threads = 1,
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
  void set_light_gains(const float* gains) { scene_.set_light_gains(gains); }

  // Set new vertices and normals (nv, 3) of a mesh, before a call of render.
  void deform_mesh(int mesh, const float* vertices, const float* normals);
  // Set new sizes (count, 3) of geoms that are neither planes nor meshes, before a call of render.
  // A geom with radius 0 is invisible. From now on the geoms are not sampled as emitters.
  void resize_geoms(const int32_t* geoms, const float* sizes, int count);
  int shape(int geom) const { return scene_.geoms.at(scene_.index.at(geom)).shape; }
  int mesh_count() const { return static_cast<int>(scene_.mesh_data.size()); }
  const SceneData::MeshData& mesh(int index) const { return *scene_.mesh_data.at(index); }
  // To share the mesh with another scene, until one of them deforms it.
  const std::shared_ptr<SceneData::MeshData>& shared_mesh(int index) const {
    return scene_.mesh_data.at(index);
  }

  // The integrator if it is `hybrid`; or null.
  HybridIntegrator* hybrid() { return hybrid_; }
  const HybridIntegrator* hybrid() const { return hybrid_; }

  // For the tests of the samplers: the kernel and its inputs, with everything placed. Paths only.
  struct KernelInputs {
    const Kernel& kernel;
    const Frame& frame;
    const PathFrame& paths;
  };
  KernelInputs kernel_inputs(const Poses& poses);

  bool fits_device() const { return integrator_->fits_device(); }
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

  double traced_fraction() const { return traced_fraction_; }
  int channels() const { return scene_.frame.channels; }
  // Return the active features; where a tick decides, those of the last one.
  FeatureFlags features() const;
  const WorkCounters& work() const { return work_; }
  const PlacedScene& scene() const { return scene_; }

 private:
  const Kernel* kernel_;
  std::shared_ptr<ThreadPool> pool_;
  bool incremental_;
  ForcedFeatures forced_;
  PlacedScene scene_;
  std::unique_ptr<Integrator> integrator_;
  HybridIntegrator* hybrid_ = nullptr;
  WorkCounters work_;
  double traced_fraction_ = 1;
};

// Return the instruction sets that this build and this machine support, fastest first; and the
// kernel of one.
std::vector<std::string> isa_available();
const Kernel* kernel_of(const std::string& isa);

}  // namespace evs
