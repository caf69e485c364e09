// One tick of the `direct` integrator.
#include <atomic>

#include "caster.h"

namespace evs {
namespace {

bool has_shading(const CachedShading& shading) { return shading.numbers && *shading.geom >= 0; }

// Can two packets be relit at once? In: the first has cached shading.
bool alike(const CachedShading& a, const CachedShading& b) {
  return has_shading(b) && *a.geom == *b.geom && a.lights == b.lights;
}

}  // namespace

// In: whether the camera stands still, and whether only dirty packets are traced then.
void Caster::trace_direct(bool still, bool selective, const Outputs& out) {
  bool recording = packet_cache_ && (work_.ticks == 1 || still);
  selective = selective && recorded_ &&
              !packet_cache_->drop_changed_lights(appearance_.lights, previous_lights_);
  recorded_ = recording;
  long packets = static_cast<long>(sampling_.rows) * sampling_.columns;
  if (selective) {
    work_.packets_tested += packets;
    find_moved();
    bool lights_stay = same_lights();
    if (moved_capsules_.empty() && lights_stay) {
      traced_fraction_ = 0;
      return;
    }
    SceneChange change = {moved_capsules_.data(), moved_.view(), around_moved_,
                          lights_stay ? nullptr : previous_lights_.data()};
    packet_cache_->find_dirty(*kernel_, frame_, change, *pool_);
  } else if (recording) {
    packet_cache_->record_all();
  }

  Outputs first_out = antialiasing_ ? antialiasing_->base() : out;
  Frame first_frame = antialiasing_ ? antialiasing_->base_frame(frame_) : frame_;
  std::atomic<long> traced{0}, relit{0};
  bool pairs = kernel_->trace_pair && frame_.pairs;
  pool_->run(sampling_.rows, [&](int row, int) {
    using Dirty = PacketCache::Dirty;
    long retraced = 0, lit = 0;
    auto dirty_of = [&](int column) {
      if (selective) return packet_cache_->dirty(column, row);
      return recording ? Dirty::RETRACE : Dirty::RETRACE_UNRECORDED;
    };
    for (int column = 0; column < sampling_.columns; column++) {
      if (selective && column % BLOCK_WIDTH == 0 && !packet_cache_->any_dirty(column, row)) {
        column += BLOCK_WIDTH - 1;
        continue;
      }
      Dirty dirty = dirty_of(column);
      if (dirty == Dirty::CLEAN) continue;
      bool even = column % 2 == 0 && column + 1 < sampling_.columns;
      if (pairs && even && dirty == Dirty::RETRACE_UNRECORDED &&
          dirty_of(column + 1) == Dirty::RETRACE_UNRECORDED) {
        kernel_->trace_pair(first_frame, column, row, first_out);
        for (int k = 0; k < 2 && antialiasing_; k++) antialiasing_->traced(column + k, row);
        retraced += 2;
        column++;
        continue;
      }
      PacketRecord record = {};
      if (recording) record = packet_cache_->record(column, row);
      if (dirty == Dirty::RELIGHT && has_shading(record.shading)) {
        CachedShading cached[2] = {record.shading, {}};
        if (kernel_->relight_pair && column + 1 < sampling_.columns &&
            dirty_of(column + 1) == Dirty::RELIGHT) {
          cached[1] = packet_cache_->record(column + 1, row).shading;
        }
        if (alike(cached[0], cached[1])) {
          kernel_->relight_pair(first_frame, column, row, first_out, cached);
          if (antialiasing_) antialiasing_->traced(column, row);
          column++;
          lit++;
        } else {
          kernel_->relight(first_frame, column, row, first_out, cached);
        }
        lit++;
      } else {
        // where only light changes, the recorded rays stay valid
        bool recording_rays = recording && dirty == Dirty::RETRACE;
        kernel_->trace(first_frame, column, row, first_out, recording_rays ? &record : nullptr);
        retraced++;
      }
      if (antialiasing_) antialiasing_->traced(column, row);
    }
    traced += retraced;
    relit += lit;
  });
  if (antialiasing_ && traced + relit > 0) {
    antialiasing_->close_margin();
    pool_->run(sampling_.rows, [&](int row, int) {
      antialiasing_->finish_row(*kernel_, frame_, row, out, recording ? &*packet_cache_ : nullptr);
    });
    antialiasing_->next_tick();
  }
  work_.packets_traced += traced;
  work_.packets_relit += relit;
  traced_fraction_ = static_cast<double>(traced) / static_cast<double>(packets);
}

}  // namespace evs
