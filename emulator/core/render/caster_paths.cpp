// A tick of the caster whose light comes along paths.
#include <algorithm>
#include <atomic>

#include "caster.h"

namespace evs {

// In: whether camera, sky and seed are those of the last tick, and MuJoCo's lights.
void Caster::trace_paths(bool first, bool same, bool same_lamps, const Outputs& out) {
  KeptPaths::Plan plan = KeptPaths::Plan::FORGET;
  if (kept_ && !first) {
    KeptPaths::Places places = {geoms_,          previous_geoms_, balls_,
                                previous_balls_, deformed_,       paths_.emitter_of_geom};
    find_moved();
    if (same && same_lamps && moved_rods_.empty()) {
      traced_fraction_ = 0;
      return;
    }
    plan = kept_->plan(places, same, same_lamps, steady_lights());
  }
  long packets = static_cast<long>(sampling_.rows) * sampling_.columns;
  traced_fraction_ = 1;
  if (plan == KeptPaths::Plan::FORGET) {
    pool_->run(sampling_.rows, [&](int row, int worker) {
      kernel_->trace_path_row(frame_, paths_, batches_[worker], row, out);
    });
    work_.packets_traced += packets;
    return;
  }
  std::atomic<long> traced{0};
  // some rows a job, so that few packets are not full; yet more jobs than workers
  int rows = std::clamp(sampling_.rows / (8 * pool_->threads()), 1, 8);
  pool_->run((sampling_.rows + rows - 1) / rows, [&](int job, int worker) {
    int begin = job * rows, end = std::min(begin + rows, sampling_.rows);
    traced +=
        kernel_->retrace_paths(frame_, paths_, batches_[worker], kept_->light(), begin, end, out);
  });
  traced_fraction_ = static_cast<double>(traced) /
                     (static_cast<double>(frame_.width) * frame_.height * frame_.samples);
  kept_->traced(traced_fraction_);
  // as many packets as those samples fill
  if (plan == KeptPaths::Plan::SOME) work_.packets_asked += packets;
  work_.packets_traced += static_cast<long>(static_cast<double>(packets) * traced_fraction_);
}

}  // namespace evs
