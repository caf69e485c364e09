#include <atomic>

#include "render/integrators.h"

namespace evs {

void PathFollower::set_emitters(const SceneData& data, const Appearance& appearance) {
  emitters_.emplace(data, appearance, scene_.order);
  batches_ = std::make_unique_for_overwrite<PathBatch[]>(pool_.threads());
}

// Copy the emitters' part into the path frame.
void PathFollower::update_paths() {
  PathFrame f = emitters_->frame();
  f.bounces = paths_.bounces;
  f.sample_set = paths_.sample_set;
  f.lobe_samples = paths_.lobe_samples;
  f.quarters = paths_.quarters;
  f.transparent_geoms = paths_.transparent_geoms;
  f.transparent_count = paths_.transparent_count;
  f.log2_samples = paths_.log2_samples;
  f.block = paths_.block;
  f.log2_blocks = paths_.log2_blocks;
  f.emits = f.emissive;
  f.emissive = forced_.decide(EMISSIVE, f.emissive);
  f.transparent = forced_.decide(TRANSPARENT, f.transparent);
  paths_ = f;
}

void PathFollower::forget_mesh(int mesh) {
  emitters_->forget_mesh(mesh);
  update_paths();
}

void PathFollower::forget_geom(int k) {
  if (emitters_->forget_geom(k)) update_paths();
}

void PathFollower::trace_pixels(const int32_t* x, const int32_t* y, int count, float* luminance) {
  for_pixels(count, [&](int i, int n, int worker) {
    kernel_.trace_path_pixels(scene_.frame, paths_, batches_[worker], x + i, y + i, n,
                              luminance + i);
  });
}

PathIntegrator::PathIntegrator(const IntegratorParts& parts) : PathFollower(parts) {
  const Tracing& tracing = parts.tracing;
  const Optics& optics = parts.optics;
  const bool at_edges = tracing.paths_at_edges();
  const int samples = tracing.base_samples();
  set_emitters(parts.data, scene_.appearance);
  paths_.bounces = tracing.bounces;
  paths_.sample_set = tracing.sample_set;
  paths_.lobe_samples = samples;
  while ((1 << paths_.log2_samples) < tracing.samples) paths_.log2_samples++;
  paths_.quarters = at_edges && 1 << paths_.log2_samples == tracing.samples && samples > 1;
  paths_.block = tracing.block;
  while ((1 << paths_.log2_blocks) < tracing.blocks) paths_.log2_blocks++;
  update_paths();
  const size_t geoms = scene_.geoms.size();
  if (at_edges) edges_.emplace(optics.width, optics.height, tracing.samples, tracing.rgb);
  if (incremental_)
    path_cache_.emplace(optics.width, optics.height, samples, geoms, nullptr, at_edges);
  if (incremental_ && at_edges)
    edge_cache_.emplace(optics.width, optics.height, tracing.samples - samples, geoms,
                        edges_->edges(), false);
}

void PathIntegrator::trace_pixels(const int32_t* x, const int32_t* y, int count, float* luminance) {
  if (!edges_) return PathFollower::trace_pixels(x, y, count, luminance);
  for_pixels(count, [&](int i, int n, int worker) {
    edges_->trace_pixels(kernel_, scene_.frame, paths_, batches_[worker], x + i, y + i, n,
                         luminance + i);
  });
}

// One pass of the `path` integrator over all pixels, or over those whose bit in `marked` is set.
// Out: the number of samples traced.
long PathIntegrator::trace_pass(const Frame& f, const PathFrame& p, PathCache* cache,
                                PathCache::Plan plan, const uint32_t* marked, const Outputs& out) {
  std::atomic<long> traced{0};
  if (plan == PathCache::Plan::TRACE_UNCACHED) {
    pool_.run(scene_.sampling.rows, [&](int row, int worker) {
      if (marked) {
        traced += f.samples * kernel_.trace_marked_row(f, p, batches_[worker], row, marked, out);
      } else {
        kernel_.trace_path_row(f, p, batches_[worker], row, out);
      }
    });
    return marked ? traced.load() : static_cast<long>(f.width) * f.height * f.samples;
  }
  // several rows per job fill the packets; more jobs than workers balance the load
  int rows = std::clamp(scene_.sampling.rows / (8 * pool_.threads()), 1, 8);
  pool_.run((scene_.sampling.rows + rows - 1) / rows, [&](int job, int worker) {
    int begin = job * rows, end = std::min(begin + rows, scene_.sampling.rows);
    traced += kernel_.update_cached_paths(f, p, batches_[worker], cache->view(), begin, end, out);
  });
  return traced;
}

double PathIntegrator::trace(const RenderTick& tick, WorkCounters& work, const Outputs& out) {
  // camera, environment and seed are those of the last tick; MuJoCo's lights are
  const bool same_lamps = scene_.same_lights();
  const bool same =
      tick.selective && tick.seed == previous_seed_ && (same_lamps || scene_.same_images());
  previous_seed_ = tick.seed;
  set_seed(tick.seed);
  auto plan = PathCache::Plan::TRACE_UNCACHED, edge_plan = plan;
  if (path_cache_ && !tick.first) {
    PathCache::GeomStates states = {
        scene_.geoms,    scene_.previous_geoms, scene_.bounding_spheres, scene_.previous_spheres,
        scene_.deformed, paths_.emitter_of_geom};
    scene_.find_moved(false);
    if (same && same_lamps && !scene_.any_moved()) {
      return 0;
    }
    plan = path_cache_->plan(states, same, same_lamps, scene_.steady_lights());
    if (edges_) edge_plan = edge_cache_->plan(states, same, same_lamps, scene_.steady_lights());
  }
  const double pixels = static_cast<double>(scene_.frame.width) * scene_.frame.height;
  const Outputs base = edges_ ? edges_->base() : out;
  PathCache* cache = path_cache_ ? &*path_cache_ : nullptr;
  double traced = static_cast<double>(trace_pass(scene_.frame, paths_, cache, plan, nullptr, base));
  double samples = pixels * scene_.frame.samples;
  if (plan != PathCache::Plan::TRACE_UNCACHED) path_cache_->traced(traced / samples);
  if (edges_) {
    std::atomic<long> edges{0};
    pool_.run(scene_.sampling.rows, [&](int row, int) {
      int top = row * PACKET_HEIGHT, bottom = std::min(top + PACKET_HEIGHT, scene_.frame.height);
      for (int y = top; y < bottom; y++) edges += edges_->find_edges(y);
    });
    Frame f = edges_->rest_frame(scene_.frame);
    cache = edge_cache_ ? &*edge_cache_ : nullptr;
    long rest = trace_pass(f, edges_->rest_paths(paths_), cache, edge_plan, edges_->edges(),
                           edges_->rest());
    double rest_samples = static_cast<double>(edges) * f.samples;
    if (edge_plan != PathCache::Plan::TRACE_UNCACHED && edges > 0)
      edge_cache_->traced(static_cast<double>(rest) / rest_samples);
    pool_.run(scene_.sampling.rows, [&](int row, int) {
      int top = row * PACKET_HEIGHT, bottom = std::min(top + PACKET_HEIGHT, scene_.frame.height);
      for (int y = top; y < bottom; y++) edges_->combine(y, out);
    });
    traced += static_cast<double>(rest);
    samples += rest_samples;
  }
  const double share = traced / samples;
  long packets = scene_.packets();
  // as many packets as those samples fill
  if (plan == PathCache::Plan::TRACE_DIRTY) work.packets_tested += packets;
  work.packets_traced += static_cast<long>(static_cast<double>(packets) * share);
  return share;
}

}  // namespace evs
