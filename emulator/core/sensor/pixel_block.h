// A block of 64 pixels through one tick.
//
// A block in which nothing can happen is left out: its light has the same bits as in the last tick,
// its filters stand still, no pixel's leak or blindness ends in this tick, no noise comes. What it
// gives is what going through it would give.
#pragma once

#include <bit>
#include <cstddef>
#include <cstdint>
#include <limits>
#include <vector>

#include "pixel_front_end.h"

namespace evs {

// A pixel that has crossed something, has no reference, or may have noise. Its reference and its
// blindness are written.
template <bool NOISY>
void compare(const PixelStep& step, size_t pixel, float from, float to, float dn, double reference,
             double drift, const std::vector<ShotCandidate>& shots, std::vector<Crossing>& out) {
  const PixelPattern& pattern = step.pattern;
  const PixelArrays& arrays = step.arrays;
  if (reference != reference && arrays.last_log[pixel] != arrays.last_log[pixel]) {
    // the first light only sets the reference
    const double phase = pattern.phase == nullptr ? 0.0 : pattern.phase[pixel];
    arrays.reference[pixel] = on_grid(to - phase);
    return;
  }
  Comparators comparators;
  comparators.pixel = static_cast<uint32_t>(pixel);
  comparators.on = pattern.theta_on[pixel];
  comparators.off = pattern.theta_off[pixel];
  comparators.reference = reference;
  comparators.from = from;
  comparators.to = to;
  comparators.drift = drift;
  comparators.begin_us = step.tick.begin_us;
  comparators.tick = step.tick.us;
  comparators.refractory = step.settings.refractory;
  // the time matters to the blind alone, and is seldom near
  const bool was_blind = arrays.blind_until != nullptr && reference != reference;
  if (was_blind) comparators.blind_until = arrays.blind_until[pixel];
  if (pattern.hot != nullptr && pattern.hot[pixel] != 0) comparators.drifting = Cause::hot;
  if (NOISY) {
    comparators.shot_on = step.settings.shot.on[pixel];
    comparators.shot_off = step.settings.shot.off[pixel];
    comparators.share = step.settings.shot.share(dn);
  }
  comparators.run<NOISY>(static_cast<uint32_t>(pixel % kBlock), shots, out);
  arrays.reference[pixel] = comparators.reference;
  const bool is_blind = comparators.reference != comparators.reference;
  if (is_blind) arrays.blind_until[pixel] = comparators.blind_until;
}

// A pixel that has crossed something, sees, and has no noise: what `Comparators::run` does then,
// without its cases. Most events come this way. BLINDS: there is a refractory period.
template <bool BLINDS>
EVS_ALWAYS_INLINE void compare_simply(const PixelStep& step, size_t pixel, float signal_from,
                                      float signal_to, double reference, double drift,
                                      std::vector<Crossing>& out) {
  const double on = step.pattern.theta_on[pixel];
  const double off = step.pattern.theta_off[pixel];
  const double tick = step.tick.us;
  const double from = signal_from;
  const double span = signal_to - from;
  const double v = span + drift;
  const double end = signal_to + drift;
  uint32_t tag = 0;
  if (step.settings.causes) {
    const bool hot = step.pattern.hot != nullptr && step.pattern.hot[pixel] != 0;
    tag = static_cast<uint32_t>(cause_of(span, drift, hot ? Cause::hot : Cause::leak)) << 1;
  }
  double r = reference;
  uint32_t now = 0;
  bool up = r + on <= end;
  do {
    const double level = r + choose(up, on, -off);
    const uint32_t exact = crossing_time(level - from, v, tick);
    const uint32_t stamp = exact > now ? exact : now;
    out.push_back({static_cast<uint32_t>(pixel), (stamp << kWhenBits) | tag | (up ? 1u : 0u)});
    r = level;
    now = stamp;
    if constexpr (BLINDS) {
      const uint64_t until = static_cast<uint64_t>(stamp) + step.settings.refractory;
      if (until > step.tick.us) {
        step.arrays.blind_until[pixel] = step.tick.begin_us + static_cast<int64_t>(until);
        r = std::numeric_limits<double>::quiet_NaN();
        break;
      }
      now = static_cast<uint32_t>(until);
      r = on_grid(from + v * (now / tick));
    }
    up = r + on <= end;
  } while (up | (r - off >= end));
  step.arrays.reference[pixel] = r - drift;
}

// The last us, by the sensor's clock, until which nothing happens in a block whose light and
// filters stand still.
inline int64_t quiet_until(const PixelStep& step, size_t first, size_t count, const float* signal,
                           const float* dn) {
  constexpr double kFar = 0x1p61;
  const int64_t end = step.tick.begin_us + step.tick.us;
  double soonest = kFar;
  int64_t sees = std::numeric_limits<int64_t>::max();
  for (size_t i = 0; i < count; i++) {
    const double r = step.arrays.reference[first + i];
    if (r != r) {
      const bool blind = step.arrays.blind_until != nullptr && signal[i] == signal[i];
      if (blind && step.arrays.blind_until[first + i] < sees) {
        sees = step.arrays.blind_until[first + i];
      }
      continue;
    }
    if (step.pattern.leak == nullptr) continue;
    const double leak = leak_of(step, first + i, dn[i]);
    const double theta = step.pattern.theta_on[first + i];
    const double wait = leak > 0.0 ? (r + theta - static_cast<double>(signal[i])) / leak : kFar;
    soonest = wait < soonest ? wait : soonest;
  }
  // rounding of the division is below a us for waits of less than 2^50 us
  const int64_t leaks = soonest < 0x1p50 ? end + static_cast<int64_t>(soonest) - 2 : kNever;
  return leaks < sees ? leaks : sees - 1;
}

// The pixels, as bits, whose signal has reached a level or that have no reference: a NaN is loud.
// In: the signal at the end of the tick, the reference at its start, and by how much it sinks.
template <bool DRIFTS>
EVS_ALWAYS_INLINE uint64_t loud_pixels(const float* __restrict on, const float* __restrict off,
                                       const float* __restrict to, const double* __restrict drift,
                                       const double* __restrict reference, size_t count) {
  alignas(64) uint64_t flags[kBlock];
  uint64_t any = 0;
  for (size_t i = 0; i < count; i++) {
    const double r = reference[i];
    const double theta_on = on[i];
    const double theta_off = off[i];
    double end = to[i];
    if constexpr (DRIFTS) end += drift[i];
    const bool quiet = (end < r + theta_on) & (end > r - theta_off);
    flags[i] = quiet ? 0 : 1;
    any |= flags[i];
  }
  if (any == 0) return 0;
  uint64_t loud = 0;
  for (size_t i = 0; i < count; i++) loud |= flags[i] << i;
  return loud;
}

// Whether the rate of a candidate's pixel is high enough at this light.
EVS_ALWAYS_INLINE bool has_noise(const PixelStep& step, size_t first, const ShotCandidate& shot,
                                 float dn) {
  const ShotNoise& noise = step.settings.shot;
  const double share = noise.share(dn);
  // in bright light next to none is; no rate is over the block's bound, and those are seldom near
  if (!(shot.lot < step.shot_bounds[first / kBlock] * share)) return false;
  const double on = noise.on[first + shot.pixel];
  const double off = noise.off[first + shot.pixel];
  return shot.lot < (on + off) * share;
}

// Pixels [first, first + count) of one block. Out: how many of them had no usable light.
EVS_ALWAYS_INLINE size_t step_block(const PixelStep& step, size_t first, size_t count, Scratch& s,
                                    std::vector<ShotCandidate>& shots, std::vector<Crossing>& out) {
  const PixelArrays& arrays = step.arrays;
  const size_t block = first / kBlock;
  const int64_t end_us = step.tick.begin_us + step.tick.us;
  float* last_luminance = arrays.last_luminance + first;

  shots.clear();
  if (arrays.shot.next != nullptr && arrays.shot.next[block] <= end_us * kShotUnits) {
    draw_candidates(step.settings.shot, {arrays.shot.next + block, arrays.shot.count + block},
                    block, count, step.shot_bounds[block], step.tick.begin_us, end_us, shots);
  }
  const BlockLight seen = look(step.tick.luminance + first, last_luminance, step.plain, count);
  bool moved = seen.moved;
  const bool due = arrays.due_us != nullptr && arrays.due_us[block] < end_us;
  if (!moved && !due) {
    // in a block that stands still, candidates without a chance wake nobody
    const float* light = step.settings.average ? arrays.average.mean + first : last_luminance;
    std::erase_if(shots, [&](const ShotCandidate& shot) {
      return !has_noise(step, first, shot, to_dn(step.settings.map, light[shot.pixel]));
    });
    if (shots.empty()) return 0;
  }
  catch_up(step, first, count);

  const size_t clamped =
      step.settings.map.kind == LogKind::linlog
          ? to_log_light<LogKind::linlog>(step, first, count, s, seen.plain, moved)
          : to_log_light<LogKind::log_eps>(step, first, count, s, seen.plain, moved);
  const Signal signal = to_signal(step, first, count, s, moved);
  const bool drifts = step.pattern.leak != nullptr || step.settings.highpass > 0.0;
  double* reference = arrays.reference + first;
  const float* theta_on = step.pattern.theta_on + first;
  const float* theta_off = step.pattern.theta_off + first;
  uint64_t loud = 0;
  if (drifts) {
    to_drift(step, first, count, signal, s, moved);
    loud = loud_pixels<true>(theta_on, theta_off, signal.to, s.drift, s.reference, count);
    // the quiet ones only sink; the others are written below
    for (size_t i = 0; i < count; i++) reference[i] = s.reference[i] - s.drift[i];
  } else {
    loud = loud_pixels<false>(theta_on, theta_off, signal.to, nullptr, reference, count);
  }
  uint64_t noisy = 0;
  for (const ShotCandidate& shot : shots) {
    if (has_noise(step, first, shot, s.dn[shot.pixel])) noisy |= uint64_t{1} << shot.pixel;
  }

  const bool blinds = step.settings.refractory > 0;
  if (blinds) {
    // when the blind see again is seldom near: all of them are fetched at once
    for (uint64_t left = loud; left != 0; left &= left - 1) {
      const size_t i = static_cast<size_t>(std::countr_zero(left));
      __builtin_prefetch(arrays.blind_until + first + i);
    }
  }
  for (uint64_t left = loud | noisy; left != 0; left &= left - 1) {
    const size_t i = static_cast<size_t>(std::countr_zero(left));
    const double r = drifts ? s.reference[i] : reference[i];
    const double drift = drifts ? s.drift[i] : 0.0;
    if ((noisy >> i & 1) != 0) {
      compare<true>(step, first + i, signal.from[i], signal.to[i], s.dn[i], r, drift, shots, out);
    } else if (r != r) {
      compare<false>(step, first + i, signal.from[i], signal.to[i], s.dn[i], r, drift, shots, out);
    } else if (blinds) {
      compare_simply<true>(step, first + i, signal.from[i], signal.to[i], r, drift, out);
    } else {
      compare_simply<false>(step, first + i, signal.from[i], signal.to[i], r, drift, out);
    }
  }
  if (arrays.due_us != nullptr) {
    arrays.due_us[block] = moved ? end_us : quiet_until(step, first, count, signal.to, s.dn);
    arrays.since_us[block] = end_us;
  }
  float* last_log = arrays.last_log + first;
  for (size_t i = 0; i < count; i++) last_log[i] = s.log[i];
  for (size_t i = 0; i < count; i++) last_luminance[i] = s.light[i];
  return clamped;
}

// Pixels [first, last) in order, first a multiple of kBlock. Crossings are appended to `out`.
EVS_ALWAYS_INLINE size_t step_pixels(const PixelStep& step, size_t first, size_t last,
                                     std::vector<Crossing>& out) {
  Scratch scratch;
  std::vector<ShotCandidate> shots;
  size_t clamped = 0;
  for (; first < last; first += kBlock) {
    const size_t count = last - first < kBlock ? last - first : kBlock;
    // the whole blocks are the same code with a count that the compiler knows
    clamped += count == kBlock ? step_block(step, first, kBlock, scratch, shots, out)
                               : step_block(step, first, count, scratch, shots, out);
  }
  return clamped;
}

}  // namespace evs
