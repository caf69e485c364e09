// The comparators of one pixel through one tick: the exact order of crossings, noise and blindness.
//
// Contract. Inside a tick the signal s moves linearly and the reference r sinks linearly by `drift`
// (leak, less what the high pass lifts it), so that s - r moves linearly. A level is reached when
// s >= r + theta_on (ON) or s <= r - theta_off (OFF): the closed side is the far one. Without a
// refractory period every event of a level moves the reference by exactly one threshold, so that no
// contrast is lost. With one the pixel is blind from its event on, whatever comes, and in the
// microsecond in which the period ends the reference becomes the signal. Noise always makes the
// reference the signal of its microsecond.
//
// In one microsecond the order is: blindness ends, levels, noise. Noise is lost while the pixel is
// blind, not any more in the microsecond in which that ends. No stamp is before the one before it.
//
// References are float64 and multiples of 2^-43, and so are float32 thresholds from 2^-20 on and
// the leak of a microsecond: adding and subtracting them is exact below 2^10, and a day of events
// drifts by nothing. In a tick they are told as they would be at its start, r + drift t / tick:
// there levels stand still, and the signal moves by v = (to - from) + drift. The signal of an
// instant is on_grid(from + v (t / tick)); a level is reached if it is within to + drift, so that
// what a tick leaves is never over a level at the start of the next. Only the division in a stamp
// rounds.
#pragma once

#include <cmath>
#include <cstddef>
#include <cstdint>
#include <limits>
#include <vector>

#include "shot_noise.h"
#include "vmath.h"

namespace evs {

// Why an event came about. 0 in an event: nobody asked.
enum class Cause : uint32_t { signal = 1, leak = 2, shot = 3, hot = 4 };

// An event before it is sorted: its pixel, and (stamp - t_begin) * 16 + cause * 2 + polarity.
struct Crossing {
  uint32_t pixel;
  uint32_t when;
};
inline constexpr uint32_t kWhenBits = 4;

// Round to a multiple of 2^-43, ties to even, for |value| < 2^8; beyond, to a multiple of the last
// bit of value + 768.
EVS_ALWAYS_INLINE double on_grid(double value) { return (value + 0x1.8p9) - 0x1.8p9; }

// Microseconds after the start of a tick at which a line that moves `span` in `tick` us has moved
// `part`: rounded up, in [1, tick]. A NaN gives 1.
EVS_ALWAYS_INLINE uint32_t crossing_time(double part, double span, double tick) {
  const double exact = part * tick / span;
  const double late = exact > 1.0 ? exact : 1.0;
  const double inside = late < tick ? late : tick;
  const uint32_t whole = static_cast<uint32_t>(static_cast<int32_t>(inside));
  return whole + (static_cast<double>(static_cast<int32_t>(whole)) < inside ? 1u : 0u);
}

// Why a level was reached: by what moved the pixel further in this tick, the signal if both did.
EVS_ALWAYS_INLINE Cause cause_of(double span, double drift, Cause drifting) {
  return std::abs(drift) > std::abs(span) ? drifting : Cause::signal;
}

// One pixel and what the tick brings it.
struct Comparators {
  uint32_t pixel = 0;
  double on = 0.0;  // thresholds
  double off = 0.0;
  double reference = 0.0;   // In/out: at the start of the tick; after `run` at its end; NaN: blind
  double from = 0.0;        // the signal at the start of the tick
  double to = 0.0;          // the signal at its end
  double drift = 0.0;       // how far the reference sinks in the tick
  int64_t begin_us = 0;     // the tick's start by the sensor's clock
  uint32_t tick = 0;        // us
  uint32_t refractory = 0;  // us
  int64_t blind_until = 0;  // In/out, by the sensor's clock; for a NaN reference only
  Cause drifting = Cause::leak;  // what an event is called that the drift brought about
  double shot_on = 0.0;          // Hz, in the dark
  double shot_off = 0.0;         // Hz, in the dark
  double share = 1.0;            // of those two that is left at this light

  // Crossings of the whole tick in order. NOISY: among them those candidates for shot noise of its
  // block that are at `place`, which is this pixel.
  template <bool NOISY>
  EVS_ALWAYS_INLINE void run(uint32_t place, const std::vector<ShotCandidate>& shots,
                             std::vector<Crossing>& out) {
    const double length = tick;
    const double v = (to - from) + drift;  // of signal against reference
    const double end = to + drift;
    const uint32_t cause = static_cast<uint32_t>(cause_of(to - from, drift, drifting));
    double r = reference;  // continued to the start of the tick
    uint32_t now = 0;
    auto at = [&](uint32_t offset) { return on_grid(from + v * (offset / length)); };
    // the pixel has fired: false where it is blind for the rest of the tick
    auto rest = [&](uint32_t stamp) {
      if (refractory == 0) return true;
      const int64_t until = static_cast<int64_t>(stamp) + refractory;
      if (until > tick) {
        blind_until = begin_us + until;
        reference = std::numeric_limits<double>::quiet_NaN();
        return false;
      }
      now = static_cast<uint32_t>(until);
      r = at(now);
      return true;
    };
    if (r != r) {
      if (blind_until > begin_us + tick) return;
      now = static_cast<uint32_t>(blind_until - begin_us);
      r = at(now);
    }
    const size_t count = NOISY ? shots.size() : 0;
    for (size_t k = 0; k <= count; k++) {
      if (k < count && shots[k].pixel != place) continue;
      const uint32_t until = k < count ? shots[k].offset : tick;
      // every level on the way to there
      for (;;) {
        const bool up = r + on <= end;
        const double theta = up ? on : -off;
        const double level = r + theta;
        if (!up && !(level >= end)) break;
        const uint32_t exact = crossing_time(level - from, v, length);
        const uint32_t stamp = exact > now ? exact : now;
        if (NOISY && stamp > until) break;
        out.push_back(crossing(stamp, cause, up));
        r = level;
        now = stamp;
        if (!rest(stamp)) return;
      }
      if (k == count) break;
      // noise, unless the pixel is blind or its rate too low now
      const double lot = shots[k].lot;
      if (until < now || lot >= (shot_on + shot_off) * share) continue;
      out.push_back(crossing(until, static_cast<uint32_t>(Cause::shot), lot < shot_on * share));
      now = until;
      r = at(until);
      if (!rest(until)) return;
    }
    reference = r - drift;
  }

 private:
  Crossing crossing(uint32_t stamp, uint32_t cause, bool up) const {
    return {pixel, (stamp << kWhenBits) | (cause << 1) | (up ? 1u : 0u)};
  }
};

}  // namespace evs
