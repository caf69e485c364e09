// A tick of the caster whose light comes straight from the lamps.
#include <atomic>

#include "caster.h"

namespace evs {
namespace {

bool keeps(const KeptPatch& patch) { return patch.numbers && *patch.geom >= 0; }

// Can two packets be lit at once? In: the first, which keeps something.
bool alike(const KeptPatch& a, const KeptPatch& b) {
  return keeps(b) && *a.geom == *b.geom && a.lights == b.lights;
}

}  // namespace

// In: whether the camera is where it was, and whether what can have changed is asked for then.
void Caster::trace_direct(bool still, bool selective, const Outputs& out) {
  bool recording = ray_blocks_ && (work_.ticks == 1 || still);
  selective = selective && recorded_ && !ray_blocks_->outdated(look_.lights, previous_lights_);
  recorded_ = recording;
  long packets = static_cast<long>(sampling_.rows) * sampling_.columns;
  if (selective) {
    work_.packets_asked += packets;
    find_moved();
    bool lights_stay = same_lights();
    if (moved_rods_.empty() && lights_stay) {
      traced_fraction_ = 0;
      return;
    }
    Change change = {moved_rods_.data(), moved_.view(), around_moved_,
                     lights_stay ? nullptr : previous_lights_.data()};
    ray_blocks_->ask(*kernel_, frame_, change, *pool_);
  } else if (recording) {
    ray_blocks_->begin();
  }

  Outputs first_out = antialiasing_ ? antialiasing_->base() : out;
  Frame first_frame = antialiasing_ ? antialiasing_->base_frame(frame_) : frame_;
  std::atomic<long> traced{0}, relit{0};
  bool pairs = kernel_->trace_pair && frame_.pairs;
  pool_->run(sampling_.rows, [&](int row, int) {
    using Need = RayBlocks::Need;
    long anew = 0, lit = 0;
    auto need_of = [&](int column) {
      if (selective) return ray_blocks_->need(column, row);
      return recording ? Need::ALL : Need::MET;
    };
    for (int column = 0; column < sampling_.columns; column++) {
      if (selective && column % BLOCK_WIDTH == 0 && !ray_blocks_->any_need(column, row)) {
        column += BLOCK_WIDTH - 1;
        continue;
      }
      Need need = need_of(column);
      if (need == Need::NOTHING) continue;
      bool even = column % 2 == 0 && column + 1 < sampling_.columns;
      if (pairs && even && need == Need::MET && need_of(column + 1) == Need::MET) {
        kernel_->trace_pair(first_frame, column, row, first_out);
        for (int k = 0; k < 2 && antialiasing_; k++) antialiasing_->traced(column + k, row);
        anew += 2;
        column++;
        continue;
      }
      Record record = {};
      if (recording) record = ray_blocks_->record(column, row);
      if (need == Need::LIGHT && keeps(record.patch)) {
        KeptPatch kept[2] = {record.patch, {}};
        if (kernel_->relight_pair && column + 1 < sampling_.columns &&
            need_of(column + 1) == Need::LIGHT) {
          kept[1] = ray_blocks_->record(column + 1, row).patch;
        }
        if (alike(kept[0], kept[1])) {
          kernel_->relight_pair(first_frame, column, row, first_out, kept);
          if (antialiasing_) antialiasing_->traced(column, row);
          column++;
          lit++;
        } else {
          kernel_->relight(first_frame, column, row, first_out, kept);
        }
        lit++;
      } else {
        // where only the light changes, what is noted of the rays stays right
        bool noting = recording && need == Need::ALL;
        kernel_->trace(first_frame, column, row, first_out, noting ? &record : nullptr);
        anew++;
      }
      if (antialiasing_) antialiasing_->traced(column, row);
    }
    traced += anew;
    relit += lit;
  });
  if (antialiasing_ && traced + relit > 0) {
    antialiasing_->close_margin();
    pool_->run(sampling_.rows, [&](int row, int) {
      antialiasing_->finish_row(*kernel_, frame_, row, out, recording ? &*ray_blocks_ : nullptr);
    });
    antialiasing_->next_tick();
  }
  work_.packets_traced += traced;
  work_.packets_relit += relit;
  traced_fraction_ = static_cast<double>(traced) / static_cast<double>(packets);
}

}  // namespace evs
