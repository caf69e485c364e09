// The ON and OFF comparators of one pixel through one tick: the exact order of threshold crossings,
// shot noise and refractory periods.
//
// Contract. Inside a tick the signal s moves as its poles respond (response.h) and the reference r,
// the memorised log intensity, sinks linearly by `drift` (the leak, less the rise by the high
// pass). A comparator fires when s >= r + theta_on (ON) or s <= r - theta_off (OFF); both limits
// are inclusive. Without a refractory period a crossing moves the reference by exactly one
// threshold, so no contrast is lost. With one, the pixel ignores everything from its event on, and
// in the microsecond in which the period ends it resets its reference to the signal. A noise event
// always resets the reference to the signal of its microsecond.
//
// Order within one microsecond: the refractory period ends, threshold crossings, noise. Noise is
// lost during the refractory period, but not in the microsecond in which it ends. Stamps never
// decrease.
//
// References are float64 multiples of 2^-43, as are float32 thresholds from 2^-20 on and the leak
// of a microsecond. Sums below 2^10 are exact, so a day of events accumulates no rounding error.
// Within a tick, references are expressed at its start, r + drift t / tick: there levels are
// constant, and the signal moves by v = (to - from) + drift. The signal at an instant is
// on_grid(from + what it has moved by). A level is reached if it is within to + drift, so no level
// is exceeded at the start of the next tick. Only stamps round.
#pragma once

#include <cmath>
#include <cstddef>
#include <cstdint>
#include <limits>
#include <vector>

#include "base/reproducible_math.h"
#include "sensor/aps_crosstalk.h"
#include "sensor/response.h"
#include "sensor/shot_noise.h"

namespace evs {

// The cause of an event. 0 in an event means that labels are off.
enum class Cause : uint32_t { SIGNAL = 1, LEAK = 2, SHOT = 3, HOT = 4, APS = 5 };

// A threshold crossing or noise event, before sorting.
struct Crossing {
  uint32_t pixel;
  uint32_t packed;  // (stamp - t_begin) * 16 + cause * 2 + polarity
};
inline constexpr uint32_t TAG_BITS = 4;  // of cause and polarity

// Round to a multiple of 2^-43, ties to even, for |value| < 2^8; beyond that, to a multiple of the
// last bit of value + 768.
EVS_ALWAYS_INLINE double on_grid(double value) { return (value + 0x1.8p9) - 0x1.8p9; }

// Microseconds after the start of a tick at which a line that moves by `span` in `tick` us has
// moved by `part`; rounded up, in [1, tick]. A NaN gives 1.
EVS_ALWAYS_INLINE uint32_t crossing_time(double part, double span, double tick) {
  const double exact = part * tick / span;
  const double late = exact > 1.0 ? exact : 1.0;
  const double inside = late < tick ? late : tick;
  const uint32_t whole = static_cast<uint32_t>(static_cast<int32_t>(inside));
  return whole + (static_cast<double>(static_cast<int32_t>(whole)) < inside ? 1u : 0u);
}

// The stamp of a level, which the signal has not passed `now`: it has moved by `part` there, and by
// `begin` now, which counts only if it bends.
EVS_ALWAYS_INLINE uint32_t stamp_of(const Response& response, double part, bool up, uint32_t now,
                                    double begin, uint32_t tick) {
  if (response.bends) return reach_time(response, part, up, now, begin, tick);
  const uint32_t exact = crossing_time(part, response.end, tick);
  return exact > now ? exact : now;
}

// The cause of a crossing: what moved the pixel further in this tick; the signal if both did alike.
EVS_ALWAYS_INLINE Cause cause_of(double span, double drift, Cause drift_cause) {
  return std::abs(drift) > std::abs(span) ? drift_cause : Cause::SIGNAL;
}

// One pixel and its inputs in a tick.
struct Comparators {
  uint32_t pixel = 0;
  double theta_on = 0.0;
  double theta_off = 0.0;
  double reference = 0.0;   // In/out: at the start, then the end of the tick; NaN: refractory
  double from = 0.0;        // signal at the start of the tick
  double to = 0.0;          // signal at its end
  double drift = 0.0;       // by how much the reference sinks in the tick
  int64_t begin_us = 0;     // start of the tick by the sensor's clock
  uint32_t tick = 0;        // us
  uint32_t refractory = 0;  // us
  int64_t blind_until = 0;  // In/out: end of the refractory period, if `reference` is NaN
  Cause drift_cause = Cause::LEAK;  // of an event that the drift causes
  double shot_on = 0.0;             // Hz in the dark
  double shot_off = 0.0;            // Hz in the dark
  double rate_scale = 1.0;          // of the shot noise at this light
  double crosstalk = 0.0;           // of a row read, log units
  Response response;                // of the signal against the reference; its end is v

  // Append the crossings of the tick in order. NOISY: with those candidates for shot noise whose
  // pixel is `index`, this pixel's place in the block.
  template <bool NOISY>
  EVS_ALWAYS_INLINE void run(uint32_t index, const std::vector<ShotCandidate>& shots,
                             std::vector<Crossing>& out) {
    const double length = tick;
    const double end = to + drift;
    const uint32_t cause = static_cast<uint32_t>(cause_of(to - from, drift, drift_cause));
    double r = reference;  // expressed at the start of the tick
    uint32_t now = 0;
    auto signal_at = [&](uint32_t offset) {
      return on_grid(from + response.moved(offset / length));
    };
    // start the refractory period; false if it outlasts the tick
    auto start_refractory = [&](uint32_t stamp) {
      if (refractory == 0) return true;
      const int64_t until = static_cast<int64_t>(stamp) + refractory;
      if (until > tick) {
        blind_until = begin_us + until;
        reference = std::numeric_limits<double>::quiet_NaN();
        return false;
      }
      now = static_cast<uint32_t>(until);
      r = signal_at(now);
      return true;
    };
    // end a refractory period in this tick
    if (r != r) {
      if (blind_until > begin_us + tick) return;
      now = static_cast<uint32_t>(blind_until - begin_us);
      r = signal_at(now);
    }
    const size_t count = NOISY ? shots.size() : 0;
    for (size_t k = 0; k <= count; k++) {
      if (k < count && shots[k].pixel != index) continue;
      const uint32_t until = k < count ? shots[k].offset : tick;
      // fire for each level that is crossed before the next candidate
      for (;;) {
        const bool up = r + theta_on <= end;
        const double theta = up ? theta_on : -theta_off;
        const double level = r + theta;
        if (!up && !(level >= end)) break;
        const double begin = response.moved(now / length);
        const uint32_t stamp = stamp_of(response, level - from, up, now, begin, tick);
        if (NOISY && stamp > until) break;
        out.push_back(crossing(stamp, cause, up));
        r = level;
        now = stamp;
        if (!start_refractory(stamp)) return;
      }
      if (k == count) break;
      // fire for the candidate, unless the pixel is refractory or its rate too low at this light
      const double draw = shots[k].draw_hz;
      if (until < now) continue;
      if (draw != ROW_READ && draw >= (shot_on + shot_off) * rate_scale) continue;
      if (draw == ROW_READ) {
        // a row read lifts the signal for an instant
        if (!((signal_at(until) - r) + crosstalk >= theta_on)) continue;
        out.push_back(crossing(until, static_cast<uint32_t>(Cause::APS), true));
      } else {
        out.push_back(
            crossing(until, static_cast<uint32_t>(Cause::SHOT), draw < shot_on * rate_scale));
      }
      now = until;
      r = signal_at(until);
      if (!start_refractory(until)) return;
    }
    reference = r - drift;
  }

 private:
  Crossing crossing(uint32_t stamp, uint32_t cause, bool up) const {
    return {pixel, (stamp << TAG_BITS) | (cause << 1) | (up ? 1u : 0u)};
  }
};

}  // namespace evs
