// The integrators: how the light of a placed scene reaches the pixels, and what each of them keeps
// between ticks. Scalar code around the wide kernels.
#pragma once

#include <algorithm>
#include <memory>
#include <optional>
#include <vector>

#include "base/thread_pool.h"
#include "render/incremental/packet_cache.h"
#include "render/incremental/path_cache.h"
#include "render/integrators/antialiasing.h"
#include "render/integrators/edge_sampling.h"
#include "render/irradiance/irradiance_cache.h"
#include "render/placed_scene.h"
#include "scene/emitters.h"

namespace evs {

// Work done since the caster was made.
struct WorkCounters {
  long ticks = 0;
  long packets_tested = 0;  // tested for moving geoms
  long packets_traced = 0;  // 4 x 4 pixels
  long packets_relit = 0;   // others, whose light alone was computed again
};

// What an integrator is made of.
struct IntegratorParts {
  const SceneData& data;
  const Optics& optics;
  const Tracing& tracing;
  const Kernel& kernel;
  ThreadPool& pool;
  PlacedScene& scene;
};

// A tick of a scene that is placed.
struct RenderTick {
  int seed;
  bool first, still;  // the first one; the camera is where it was in the last one
  bool selective;     // trace only what may have changed
};

class Integrator {
 public:
  virtual ~Integrator() = default;
  Integrator(const Integrator&) = delete;
  Integrator& operator=(const Integrator&) = delete;

  // Trace the pixels of a tick. Returns the share that was traced, 0 ... 1.
  virtual double trace(const RenderTick& tick, WorkCounters& work, const Outputs& out) = 0;
  // Trace single pixels: the light of `trace`. No cache is read or written.
  virtual void trace_pixels(const int32_t* x, const int32_t* y, int count, float* luminance) = 0;
  // A mesh deforms, or a geom of the kernel was resized: they are not sampled as emitters any more.
  virtual void forget_mesh(int) {}
  virtual void forget_geom(int) {}

  // What kernels of paths read; of `direct` nothing.
  const PathFrame& paths() const { return paths_; }
  void set_seed(int seed) { paths_.seed = seed; }

  // For a device that traces the pixels. The first pass of adaptive antialiasing, of this frame;
  // without samples: there is none.
  virtual Frame first_pass(const Frame&) const { return {}; }
  virtual const Appearance& appearance() const { return scene_.appearance; }
  virtual bool fits_device() const { return true; }
  // Begin a tick. Returns whether there is anything to trace.
  virtual bool begin_device_tick(const Poses& poses) {
    set_seed(poses.seed);
    return true;
  }

 protected:
  explicit Integrator(const IntegratorParts& parts);
  // Call job(first, count, worker) for pixels in packets.
  template <class Job>
  void for_pixels(int count, const Job& job) {
    constexpr int PACKET = PACKET_WIDTH * PACKET_HEIGHT, PACKETS_A_JOB = 16;
    constexpr int PIXELS_A_JOB = PACKET * PACKETS_A_JOB;
    pool_.run((count + PIXELS_A_JOB - 1) / PIXELS_A_JOB, [&](int index, int worker) {
      int end = std::min(count, (index + 1) * PIXELS_A_JOB);
      for (int i = index * PIXELS_A_JOB; i < end; i += PACKET) {
        job(i, std::min(PACKET, end - i), worker);
      }
    });
  }

  const Kernel& kernel_;
  ThreadPool& pool_;
  PlacedScene& scene_;
  const bool incremental_;
  const ForcedFeatures forced_;
  PathFrame paths_ = {};
};

class DirectIntegrator final : public Integrator {
 public:
  explicit DirectIntegrator(const IntegratorParts& parts);
  double trace(const RenderTick& tick, WorkCounters& work, const Outputs& out) override;
  void trace_pixels(const int32_t* x, const int32_t* y, int count, float* luminance) override;
  Frame first_pass(const Frame& frame) const override;

 private:
  std::optional<PacketCache> packet_cache_;   // incremental only
  bool recorded_ = false;                     // in the last tick
  std::optional<Antialiasing> antialiasing_;  // none: all samples everywhere
};

// What `hybrid` and `path` share: the light that paths follow.
class PathFollower : public Integrator {
 public:
  void trace_pixels(const int32_t* x, const int32_t* y, int count, float* luminance) override;
  void forget_mesh(int mesh) override;
  void forget_geom(int k) override;

 protected:
  using Integrator::Integrator;
  void set_emitters(const SceneData& data, const Appearance& appearance);
  virtual void update_paths();

  std::optional<Emitters> emitters_;
  std::unique_ptr<PathBatch[]> batches_;  // one per worker
  int previous_seed_ = 0;
};

class PathIntegrator final : public PathFollower {
 public:
  explicit PathIntegrator(const IntegratorParts& parts);
  double trace(const RenderTick& tick, WorkCounters& work, const Outputs& out) override;
  void trace_pixels(const int32_t* x, const int32_t* y, int count, float* luminance) override;
  // Not samples at edges, which a device does not render.
  bool fits_device() const override { return !edges_; }

 private:
  long trace_pass(const Frame& f, const PathFrame& p, PathCache* cache, PathCache::Plan plan,
                  const uint32_t* marked, const Outputs& out);

  std::optional<EdgeSampling> edges_;  // none: all samples everywhere
  // incremental only: of all pixels, and of the other samples of those at an edge
  std::optional<PathCache> path_cache_, edge_cache_;
};

class HybridIntegrator final : public PathFollower {
 public:
  explicit HybridIntegrator(const IntegratorParts& parts);
  double trace(const RenderTick& tick, WorkCounters& work, const Outputs& out) override;
  Frame first_pass(const Frame& frame) const override;
  const Appearance& appearance() const override {
    return luminance_ ? *luminance_ : scene_.appearance;
  }

  const IrradianceCache& irradiance() const { return *irradiance_; }
  // Take back what IrradianceCache::save gave. Returns false, and changes nothing, where it is
  // damaged.
  bool restore_irradiance(long tick, int coarser, int nodes, const int32_t* ints,
                          const float* floats);
  // Forget what earlier ticks left in the light.
  void restart();

  // For a device, after begin_device_tick. Trace all pixels of the tick here.
  bool begin_device_tick(const Poses& poses) override;
  void trace_here(float* luminance);
  // What pixels read on a device, in a pass over them that begins.
  const IrradianceCache& begin_device_pass(IrradianceCache::Pass pass);
  // Take which nodes they have read, (nodes), and the nodes that they miss, which are lit. Returns
  // false where there is no room, or where they are the first: the tick must then be traced by
  // `trace_here`.
  bool take_from_device(const uint8_t* used, const NodeRequest* missing, size_t count);
  // Take from where nodes were read, as IrradianceCache::take_first_readers.
  void take_first_readers(const uint64_t* words) { irradiance_->take_first_readers(words); }

 private:
  // What packets record: what kept_light.inl keeps while lamps rest, or all of it.
  enum class Recording { NOTHING, LIGHT, SURFACES };

  void choose_channels(const Tracing& tracing);
  void make_cache(const Optics& optics, const Tracing& tracing);
  void keep_packets(const Tracing& tracing);
  void add_lamps(const Appearance& colours);
  void update_paths() override;
  void place();
  bool begin(bool same);
  void trace_tick(bool selective, WorkCounters& work, const Outputs& out);
  IrradianceCache::Tracer node_tracer();
  bool find_dirty(WorkCounters& work);
  bool trace_passes(const IrradianceCache::Tracer& tracer, Recording now, bool selective,
                    WorkCounters& work, const Outputs& out);

  std::optional<IrradianceCache> irradiance_;
  // where lights are grey: the appearance for nodes, and that for pixels
  std::optional<Appearance> colours_, luminance_;
  std::vector<Light> node_lights_, last_lights_;  // of nodes; the pixels', of the last tick
  std::vector<float> tint_;
  std::vector<LampPoint> lamp_points_;
  std::vector<uint8_t> incomplete_;  // packets that missed nodes
  // what packets keep (packets, samples, kept_rows, 16), and whether that is all; null: nothing
  std::unique_ptr<float[]> kept_;
  std::unique_ptr<KeptNodes[]> kept_nodes_;
  std::unique_ptr<float[]> kept_surfaces_;       // of packets, while lamps move
  size_t kept_floats_ = 0, surface_floats_ = 0;  // of a packet
  Recording kept_of_last_ = Recording::NOTHING;  // in the last tick, of every packet
  std::vector<uint8_t> kept_whole_;
  std::vector<BoundingSphere> emitter_spheres_;
  long rest_ticks_ = 0;                       // without a change
  std::optional<PacketCache> packet_cache_;   // incremental only
  Frame colour_frame_ = {};                   // for the nodes of the cache
  std::optional<Antialiasing> antialiasing_;  // none: all samples everywhere
  double traced_fraction_ = 1;                // of the last pass
};

}  // namespace evs
