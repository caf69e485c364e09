#include "render/caster.h"

#include <algorithm>

namespace evs {

Caster::Caster(const SceneData& data, const Optics& optics, const Tracing& tracing, int threads,
               const std::string& isa, const Caster* before)
    : kernel_(kernel_of(isa)),
      pool_(before ? before->pool_ : std::make_shared<ThreadPool>(threads)),
      incremental_(tracing.incremental && kernel_->find_dirty_packets),
      forced_(tracing.forced),
      scene_(data, optics, tracing, before ? &before->scene_ : nullptr) {
  IntegratorParts parts = {data, optics, tracing, *kernel_, *pool_, scene_};
  if (tracing.hybrid) {
    auto hybrid = std::make_unique<HybridIntegrator>(parts);
    hybrid_ = hybrid.get();
    integrator_ = std::move(hybrid);
  } else if (tracing.path) {
    integrator_ = std::make_unique<PathIntegrator>(parts);
  } else {
    integrator_ = std::make_unique<DirectIntegrator>(parts);
  }
}

void Caster::render(const Poses& poses, float* luminance, float* rgb) {
  scene_.place(poses);
  bool first = !scene_.has_begun(), still = scene_.is_still(poses);
  bool selective = incremental_ && still && !forced_.on(FULL_RETRACE);
  work_.ticks++;
  if (!first && forced_.off(FULL_RETRACE)) {
    traced_fraction_ = 0;
    return;
  }
  RenderTick tick = {poses.seed, first, still, selective};
  traced_fraction_ = integrator_->trace(tick, work_, {luminance, rgb, nullptr, 0, nullptr});
  scene_.end_tick();
}

void Caster::trace_truth(const Poses& poses, const Truth& out) {
  scene_.place_geoms(poses);
  pool_->run(scene_.sampling.rows, [&](int row, int) {
    for (int column = 0; column < scene_.sampling.columns; column++) {
      kernel_->trace_truth(scene_.frame, column, row, out);
    }
    // map the kernel's order of geoms and triangles to the scene's
    long begin = static_cast<long>(row) * PACKET_HEIGHT * scene_.frame.width;
    long end = std::min<long>(begin + PACKET_HEIGHT * scene_.frame.width,
                              static_cast<long>(scene_.frame.width) * scene_.frame.height);
    for (long i = begin; i < end; i++) {
      if (out.geom[i] < 0) continue;
      const Geom& g = scene_.geoms[out.geom[i]];
      if (out.triangle[i] >= 0)
        out.triangle[i] = scene_.mesh_data[g.mesh]->bvh.order[out.triangle[i]];
      out.geom[i] = scene_.order[out.geom[i]];
    }
  });
}

void Caster::trace_pixels(const Poses& poses, const int32_t* x, const int32_t* y, int count,
                          float* luminance) {
  scene_.place(poses);
  integrator_->set_seed(poses.seed);
  integrator_->trace_pixels(x, y, count, luminance);
}

void Caster::deform_mesh(int mesh, const float* vertices, const float* normals) {
  if (scene_.deform_mesh(mesh, vertices, normals)) integrator_->forget_mesh(mesh);
}

void Caster::resize_geoms(const int32_t* geoms, const float* sizes, int count) {
  for (int i = 0; i < count; i++) {
    int k = scene_.index[geoms[i]];
    scene_.resize_geom(k, sizes + 3 * i);
    integrator_->forget_geom(k);
  }
}

Caster::KernelInputs Caster::kernel_inputs(const Poses& poses) {
  scene_.place(poses);
  return {*kernel_, scene_.frame, integrator_->paths()};
}

Caster::DeviceInputs Caster::device_inputs() const {
  const GeomBvhBuilder& bvh = scene_.bvh();
  DeviceInputs inputs = {scene_.frame, {},         integrator_->paths(), integrator_->appearance(),
                         {},           bvh.geoms()};
  inputs.frame.bounds = scene_.bounds();
  inputs.frame.bvh = bvh.view();
  inputs.first_pass = integrator_->first_pass(inputs.frame);
  for (int level = 0; level < GeomBvh::LEVELS; level++) inputs.bvh_boxes[level] = bvh.boxes(level);
  return inputs;
}

Caster::Place Caster::place_for_device(const Poses& poses) {
  scene_.place(poses);
  work_.ticks++;
  traced_fraction_ = 0;
  if (!integrator_->begin_device_tick(poses)) return Place::NOWHERE;
  work_.packets_traced += scene_.packets();
  traced_fraction_ = 1;
  return Place::THERE;
}

FeatureFlags Caster::features() const {
  bool casting = false, through_planes = false;
  uint32_t planes = scene_.frame.plane_count < 32 ? (1u << scene_.frame.plane_count) - 1 : ~0u;
  for (const Light& light : scene_.appearance.lights) {
    casting = casting || light.castshadow;
    through_planes = through_planes || (light.castshadow && (planes & ~light.non_occluders) != 0);
  }
  casting = casting && scene_.frame.shadows;
  const PathFrame& paths = integrator_->paths();
  bool on[FEATURE_COUNT] = {};
  on[COLOUR] = scene_.frame.channels >= 3;
  on[LOBES] = scene_.frame.lobes;
  on[NORMAL_MAPS] = scene_.frame.normal_mapped;
  on[TEXTURE_FILTER] = scene_.frame.probes > 0;
  on[OUTLINES] = scene_.frame.outlines;
  on[FOG] = scene_.frame.medium.fog;
  on[HAZE] = scene_.frame.medium.haze;
  on[SHADOWS] = casting;
  on[PLANE_SHADOWS] = casting && through_planes;
  on[FULL_RETRACE] = forced_.decide(FULL_RETRACE, !incremental_);
  on[REFITS] = forced_.decide(REFITS, scene_.bvhs_refitted > 0);
  on[EMISSIVE] = paths.emissive;
  on[TRANSPARENT] = paths.transparent;
  on[HIERARCHY] = scene_.frame.bvh.top > 0;
  on[LIGHT_REACH] = scene_.frame.cull_lights;
  on[CACHED_LIGHT] = hybrid_ && !forced_.off(CACHED_LIGHT);
  FeatureFlags flags;
  for (int feature = 0; feature < FEATURE_COUNT; feature++) {
    flags[FEATURE_NAMES[feature]] = on[feature];
  }
  return flags;
}

}  // namespace evs
