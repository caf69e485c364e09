#include <atomic>

#include "render/integrators.h"

namespace evs {
namespace {

bool has_shading(const CachedShading& shading) { return shading.numbers && *shading.geom >= 0; }

// Can two packets be relit at once? In: the first has cached shading.
bool alike(const CachedShading& a, const CachedShading& b) {
  return has_shading(b) && *a.geom == *b.geom && a.lights == b.lights;
}

}  // namespace

Integrator::Integrator(const IntegratorParts& parts)
    : kernel_(parts.kernel),
      pool_(parts.pool),
      scene_(parts.scene),
      incremental_(parts.tracing.incremental && parts.kernel.find_dirty_packets),
      forced_(parts.tracing.forced) {}

DirectIntegrator::DirectIntegrator(const IntegratorParts& parts) : Integrator(parts) {
  const Tracing& tracing = parts.tracing;
  if (tracing.adaptive && tracing.samples > 1) {
    antialiasing_.emplace(parts.optics, scene_.sampling, tracing.rgb);
  }
  if (!incremental_) return;
  // a packet's shading can be cached with one sample a pixel
  int channels = scene_.frame.channels;
  channels = antialiasing_ ? channels + 1 : tracing.samples == 1 ? channels : 0;
  packet_cache_.emplace(scene_.sampling, channels, scene_.appearance.lights, scene_.frame.shadows);
}

Frame DirectIntegrator::first_pass(const Frame& frame) const {
  return antialiasing_ ? antialiasing_->base_frame(frame) : Frame{};
}

void DirectIntegrator::trace_pixels(const int32_t* x, const int32_t* y, int count,
                                    float* luminance) {
  const Frame base = first_pass(scene_.frame);
  for_pixels(count, [&](int i, int n, int) {
    if (antialiasing_) {
      antialiasing_->trace_pixels(kernel_, scene_.frame, base, x + i, y + i, n, luminance + i);
    } else {
      kernel_.trace_pixels(scene_.frame, x + i, y + i, n, luminance + i, nullptr);
    }
  });
}

double DirectIntegrator::trace(const RenderTick& tick, WorkCounters& work, const Outputs& out) {
  bool selective = tick.selective;
  bool recording = packet_cache_ && (work.ticks == 1 || tick.still);
  selective = selective && recorded_ &&
              !packet_cache_->drop_changed_lights(scene_.appearance.lights, scene_.previous_lights);
  recorded_ = recording;
  long packets = scene_.packets();
  if (selective) {
    work.packets_tested += packets;
    scene_.find_moved(false);
    bool lights_stay = scene_.same_lights();
    if (!scene_.any_moved() && lights_stay) {
      return 0;
    }
    SceneChange change = scene_.moved();
    change.lights = lights_stay ? nullptr : scene_.previous_lights.data();
    packet_cache_->find_dirty(kernel_, scene_.frame, change, pool_);
  } else if (recording) {
    packet_cache_->record_all();
  }

  Outputs first_out = antialiasing_ ? antialiasing_->base() : out;
  Frame first_frame = antialiasing_ ? antialiasing_->base_frame(scene_.frame) : scene_.frame;
  std::atomic<long> traced{0}, relit{0};
  bool pairs = kernel_.trace_pair && scene_.frame.pairs;
  pool_.run(scene_.sampling.rows, [&](int row, int) {
    using Dirty = PacketCache::Dirty;
    long retraced = 0, lit = 0;
    auto dirty_of = [&](int column) {
      if (selective) return packet_cache_->dirty(column, row);
      return recording ? Dirty::RETRACE : Dirty::RETRACE_UNRECORDED;
    };
    for (int column = 0; column < scene_.sampling.columns; column++) {
      if (selective && column % BLOCK_WIDTH == 0 && !packet_cache_->any_dirty(column, row)) {
        column += BLOCK_WIDTH - 1;
        continue;
      }
      Dirty dirty = dirty_of(column);
      if (dirty == Dirty::CLEAN) continue;
      bool even = column % 2 == 0 && column + 1 < scene_.sampling.columns;
      if (pairs && even && dirty == Dirty::RETRACE_UNRECORDED &&
          dirty_of(column + 1) == Dirty::RETRACE_UNRECORDED) {
        kernel_.trace_pair(first_frame, column, row, first_out);
        for (int k = 0; k < 2 && antialiasing_; k++) antialiasing_->traced(column + k, row);
        retraced += 2;
        column++;
        continue;
      }
      PacketRecord record = {};
      if (recording) record = packet_cache_->record(column, row);
      if (dirty == Dirty::RELIGHT && has_shading(record.shading)) {
        CachedShading cached[2] = {record.shading, {}};
        if (kernel_.relight_pair && column + 1 < scene_.sampling.columns &&
            dirty_of(column + 1) == Dirty::RELIGHT) {
          cached[1] = packet_cache_->record(column + 1, row).shading;
        }
        if (alike(cached[0], cached[1])) {
          kernel_.relight_pair(first_frame, column, row, first_out, cached);
          if (antialiasing_) antialiasing_->traced(column, row);
          column++;
          lit++;
        } else {
          kernel_.relight(first_frame, column, row, first_out, cached);
        }
        lit++;
      } else {
        // where only light changes, the recorded rays stay valid
        bool recording_rays = recording && dirty == Dirty::RETRACE;
        kernel_.trace(first_frame, column, row, first_out, recording_rays ? &record : nullptr);
        retraced++;
      }
      if (antialiasing_) antialiasing_->traced(column, row);
    }
    traced += retraced;
    relit += lit;
  });
  if (antialiasing_ && traced + relit > 0) {
    antialiasing_->close_margin();
    pool_.run(scene_.sampling.rows, [&](int row, int) {
      antialiasing_->finish_row(kernel_, scene_.frame, row, out,
                                recording ? &*packet_cache_ : nullptr);
    });
    antialiasing_->next_tick();
  }
  work.packets_traced += traced;
  work.packets_relit += relit;
  return static_cast<double>(traced) / static_cast<double>(packets);
}

}  // namespace evs
