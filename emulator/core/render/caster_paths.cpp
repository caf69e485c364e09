// One tick of the `path` integrator.
#include <algorithm>
#include <atomic>

#include "caster.h"

namespace evs {

// In: whether camera, environment and seed are those of the last tick; and whether MuJoCo's lights
// are.
void Caster::trace_paths(bool first, bool same, bool same_lamps, const Outputs& out) {
  PathCache::Plan plan = PathCache::Plan::TRACE_UNCACHED;
  if (path_cache_ && !first) {
    PathCache::GeomStates states = {
        geoms_,    previous_geoms_,       bounding_spheres_, previous_spheres_,
        deformed_, paths_.emitter_of_geom};
    find_moved();
    if (same && same_lamps && moved_capsules_.empty()) {
      traced_fraction_ = 0;
      return;
    }
    plan = path_cache_->plan(states, same, same_lamps, steady_lights());
  }
  long packets = static_cast<long>(sampling_.rows) * sampling_.columns;
  traced_fraction_ = 1;
  if (plan == PathCache::Plan::TRACE_UNCACHED) {
    pool_->run(sampling_.rows, [&](int row, int worker) {
      kernel_->trace_path_row(frame_, paths_, batches_[worker], row, out);
    });
    work_.packets_traced += packets;
    return;
  }
  std::atomic<long> traced{0};
  // several rows per job fill the packets; more jobs than workers balance the load
  int rows = std::clamp(sampling_.rows / (8 * pool_->threads()), 1, 8);
  pool_->run((sampling_.rows + rows - 1) / rows, [&](int job, int worker) {
    int begin = job * rows, end = std::min(begin + rows, sampling_.rows);
    traced += kernel_->update_cached_paths(frame_, paths_, batches_[worker], path_cache_->view(),
                                           begin, end, out);
  });
  traced_fraction_ = static_cast<double>(traced) /
                     (static_cast<double>(frame_.width) * frame_.height * frame_.samples);
  path_cache_->traced(traced_fraction_);
  // as many packets as those samples fill
  if (plan == PathCache::Plan::TRACE_DIRTY) work_.packets_tested += packets;
  work_.packets_traced += static_cast<long>(static_cast<double>(packets) * traced_fraction_);
}

}  // namespace evs
