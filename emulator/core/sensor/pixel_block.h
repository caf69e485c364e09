// A block of 64 pixels through one tick.
//
// A block is skipped where no event can occur: its luminance has the same bits as in the last tick,
// its filters have settled, no leak reaches a threshold, no refractory period ends and no noise is
// accepted. Skipping changes no byte.
#pragma once

#include <algorithm>
#include <bit>
#include <cmath>
#include <cstddef>
#include <cstdint>
#include <limits>
#include <vector>

#include "sensor/photon_noise_block.h"
#include "sensor/photon_noise_steps.h"
#include "sensor/photon_noise_still.h"
#include "sensor/pixel_front_end.h"

namespace evs {

// Photon noise from the first light on: the noise is known, and in the reference. In/out: by how
// much the leak has moved the reference, which is less where noise would fire the pixel at once.
inline double first_noise(const PixelStep& step, size_t pixel, float dn, double& phase) {
  const PixelArrays& arrays = step.arrays;
  NoiseDraws draws = noise_draws(step.settings, pixel);
  const int64_t us = step.tick.begin_us + step.tick.us;
  const double sigma = noise_at(step.settings, dn).sigma;
  const double share = 1.0 - 4.0 * sigma / step.pattern.theta_on[pixel];
  phase *= share > 0.0 ? share : 0.0;
  const double noise = sigma * draws.standard_normal(us);
  arrays.noise_mean[pixel] = static_cast<float>(noise);
  arrays.noise_memory[pixel] = 1.0f;
  arrays.noise_budget[pixel] = draws.renew(us);
  return noise;
}

// Pixels with photon noise whose comparators step side by side. On a device a thread has one at a
// time.
struct NoisyPixels {
#ifdef EVS_ON_DEVICE
  static constexpr size_t ROOM = 1;
#else
  static constexpr size_t ROOM = 2 * BLOCK_PIXELS;
#endif
  NoisyComparators pixels[ROOM];
  NoisyComparators* stepping[ROOM];  // those with steps left in the tick, and how many
  size_t count = 0;
  NoisyComparators* idle[ROOM];  // the others
  size_t idle_count = 0;
  NoisySteps<ROOM> steps;
#ifndef EVS_ON_DEVICE
  // advance_noisy, compiled for an instruction set, apart from the step of the pixels: with both,
  // that would be so large that compilers no longer inline it
  void (*advance)(const PixelStep&, NoisyPixels&, size_t at_most, std::vector<Crossing>&);
#endif

  NoisyPixels() { clear(); }
  // Forget what an exception has left.
  void clear() {
    count = idle_count = 0;
    for (NoisyComparators& pixel : pixels) idle[idle_count++] = &pixel;
  }
};

// What a pixel's comparators need of it.
template <bool NOISY>
EVS_ALWAYS_INLINE void make_comparators(const PixelStep& step, size_t pixel,
                                        const Response& response, float from, float to, float dn,
                                        double reference, double drift, Comparators& comparators) {
  const PixelPattern& pattern = step.pattern;
  const PixelArrays& arrays = step.arrays;
  comparators.pixel = static_cast<uint32_t>(pixel);
  comparators.theta_on = pattern.theta_on[pixel];
  comparators.theta_off = pattern.theta_off[pixel];
  comparators.reference = reference;
  comparators.from = from;
  comparators.to = to;
  comparators.drift = drift;
  comparators.response = response;
  comparators.begin_us = step.tick.begin_us;
  comparators.tick = step.tick.us;
  comparators.refractory = refractory_us(step.settings, pattern, pixel);
  // load the end of a refractory period only if there is one: it is seldom in the cache
  const bool was_refractory = arrays.blind_until != nullptr && reference != reference;
  if (was_refractory) comparators.blind_until = arrays.blind_until[pixel];
  const bool hot = pattern.hot != nullptr && pattern.hot[pixel] != 0;
  comparators.drift_cause = hot ? Cause::HOT : Cause::LEAK;
  comparators.crosstalk = step.settings.aps_crosstalk;
  if (NOISY && arrays.shot_noise()) {
    comparators.shot_on = pattern.shot_on[pixel];
    comparators.shot_off = pattern.shot_off[pixel];
    comparators.rate_scale = step.settings.shot.rate_scale(dn);
  }
}

EVS_ALWAYS_INLINE void store(const PixelStep& step, const Comparators& comparators) {
  const PixelArrays& arrays = step.arrays;
  arrays.reference[comparators.pixel] = comparators.reference;
  const bool is_refractory = comparators.reference != comparators.reference;
  if (is_refractory) arrays.blind_until[comparators.pixel] = comparators.blind_until;
}
inline void store(const PixelStep& step, NoisyComparators& noisy) {
  const size_t pixel = noisy.pixel.pixel;
  noisy.finish();
  step.arrays.noise_budget[pixel] = noisy.budget;
  step.arrays.noise_mean[pixel] = static_cast<float>(noisy.mean);
  step.arrays.noise_memory[pixel] = static_cast<float>(noisy.memory);
  store(step, noisy.pixel);
}

// The rest of what they need with photon noise.
inline void add_noise(const PixelStep& step, float dn, const BudgetScratch& budgets,
                      NoisyComparators& noisy) {
  const size_t pixel = noisy.pixel.pixel;
  const PixelArrays& arrays = step.arrays;
  const bool still = noisy.pixel.from == noisy.pixel.to && !step.settings.references_follow();
  // that of a still pixel must not depend on the tick
  if (still && arrays.noise_memory[pixel] == 0.0f) {
    noisy.band = noise_at(step.settings, dn);
  } else {
    const size_t place = budgets.place[pixel % BLOCK_PIXELS];
    noisy.band = noise_band_of(budgets, place, step.tick.us);
    noisy.step = noise_step(budgets, place, noisy.pixel.from + noisy.pixel.response.end);
  }
  noisy.draws = noise_draws(step.settings, pixel);
  noisy.leak = step.pattern.leak != nullptr ? leak_rate(step, pixel, dn) : 0.0;
  noisy.still = still;
  noisy.budget = arrays.noise_budget[pixel];
  noisy.mean = arrays.noise_mean[pixel];
  noisy.memory = arrays.noise_memory[pixel];
}

// Step pixels with photon noise until at most so many have steps left, and store the state of the
// others.
EVS_ALWAYS_INLINE void advance_noisy(const PixelStep& step, NoisyPixels& noisy, size_t at_most,
                                     std::vector<Crossing>& out) {
  auto done = [&](NoisyComparators* pixel) {
    store(step, *pixel);
    noisy.idle[noisy.idle_count++] = pixel;
  };
  noisy.count = noisy.steps.advance(noisy.stepping, noisy.count, at_most, out, done);
}

// The comparators of a pixel in any state: at a threshold, without a reference, or with noise.
// Steps of those with photon noise that no candidate ends are left to advance_noisy.
template <bool NOISY>
EVS_CALL_ON_DEVICE void compare(const PixelStep& step, size_t pixel, const Response& response,
                                float from, float to, float dn, double reference, double drift,
                                const BudgetScratch& budgets,
                                const std::vector<ShotCandidate>& shots, NoisyPixels& noisy_pixels,
                                std::vector<Crossing>& out) {
  const PixelPattern& pattern = step.pattern;
  const PixelArrays& arrays = step.arrays;
  if (reference != reference && arrays.last_log[pixel] != arrays.last_log[pixel]) {
    // start from the first light
    double phase = pattern.phase == nullptr ? 0.0 : pattern.phase[pixel];
    const bool begins = arrays.photon_noise() && to == to;  // else there is no light yet
    const double noise = begins ? first_noise(step, pixel, dn, phase) : 0.0;
    arrays.reference[pixel] = on_grid(to - phase + noise);
    return;
  }
  const uint32_t index = static_cast<uint32_t>(pixel % BLOCK_PIXELS);
  if (!arrays.photon_noise()) {
    Comparators comparators;
    make_comparators<NOISY>(step, pixel, response, from, to, dn, reference, drift, comparators);
    comparators.run<NOISY>(index, shots, out);
    store(step, comparators);
    return;
  }
  NoisyComparators* noisy = noisy_pixels.idle[--noisy_pixels.idle_count];
  make_comparators<NOISY>(step, pixel, response, from, to, dn, reference, drift, noisy->pixel);
  add_noise(step, dn, budgets, *noisy);
  size_t k = 0;
  auto next_shot = [&] {
    while (NOISY && k < shots.size() && shots[k].pixel != index) k++;
    return NOISY && k < shots.size() ? shots[k].offset : step.tick.us;
  };
  bool left = noisy->begin(next_shot(), out);
  // up to each candidate alone
  while (NOISY && k < shots.size()) {
    NoisyComparators* alone = noisy;
    if (left) noisy_pixels.steps.advance(&alone, 1, 0, out, [](NoisyComparators*) {});
    left = false;
    if (noisy->is_blind) break;
    noisy->take_shot(shots[k++], out);
    left = noisy->go_on(next_shot());
  }
  if (left) {
    noisy_pixels.stepping[noisy_pixels.count++] = noisy;
  } else {
    store(step, *noisy);
    noisy_pixels.idle[noisy_pixels.idle_count++] = noisy;
  }
}

// The common case: a pixel at a threshold, with a reference and without noise. Gives what
// `Comparators::run` gives. REFRACTORY: there is a refractory period.
template <bool REFRACTORY>
EVS_ALWAYS_INLINE void compare_simple(const PixelStep& step, size_t pixel, const Response& response,
                                      float signal_from, float signal_to, double reference,
                                      double drift, std::vector<Crossing>& out) {
  const double on = step.pattern.theta_on[pixel];
  const double off = step.pattern.theta_off[pixel];
  const double tick = step.tick.us;
  const double from = signal_from;
  const double span = signal_to - from;
  const double end = signal_to + drift;
  uint32_t tag = 0;
  if (step.settings.causes) {
    const bool hot = step.pattern.hot != nullptr && step.pattern.hot[pixel] != 0;
    tag = static_cast<uint32_t>(cause_of(span, drift, hot ? Cause::HOT : Cause::LEAK)) << 1;
  }
  double r = reference;
  uint32_t now = 0;
  double moved = 0.0;  // until now
  bool up = r + on <= end;
  do {
    // fire, and move the reference by a threshold
    const double level = r + select(up, on, -off);
    const uint32_t stamp = stamp_of(response, level - from, up, now, moved, step.tick.us);
    out.push_back({static_cast<uint32_t>(pixel), (stamp << TAG_BITS) | tag | (up ? 1u : 0u)});
    r = level;
    now = stamp;
    if constexpr (REFRACTORY) {
      // reset the reference to the signal when the refractory period ends
      const uint64_t until =
          static_cast<uint64_t>(stamp) + refractory_us(step.settings, step.pattern, pixel);
      if (until > step.tick.us) {
        step.arrays.blind_until[pixel] = step.tick.begin_us + static_cast<int64_t>(until);
        r = std::numeric_limits<double>::quiet_NaN();
        break;
      }
      now = static_cast<uint32_t>(until);
      moved = response.moved(now / tick);
      r = on_grid(from + moved);
    }
    up = r + on <= end;
    if constexpr (!REFRACTORY) {
      if (up | (r - off >= end)) moved = response.moved(now / tick);
    }
  } while (up | (r - off >= end));
  step.arrays.reference[pixel] = r - drift;
}

// Time by the sensor's clock up to which a block has no event if its light is constant and its
// filters have settled.
EVS_CALL_ON_DEVICE inline int64_t quiet_until(const PixelStep& step, size_t first, size_t count,
                                              const float* signal, const float* dn) {
  constexpr double FAR_AWAY = 0x1p61;
  const int64_t end = step.tick.begin_us + step.tick.us;
  double soonest = FAR_AWAY;
  int64_t refractory_end = std::numeric_limits<int64_t>::max();
  for (size_t i = 0; i < count; i++) {
    const double r = step.arrays.reference[first + i];
    if (step.arrays.photon_noise() && step.arrays.noise_memory[first + i] > 0.0f) {
      return end;
    }
    if (r != r) {
      // refractory: until its end
      const bool refractory = step.arrays.blind_until != nullptr && signal[i] == signal[i];
      if (refractory && step.arrays.blind_until[first + i] < refractory_end) {
        refractory_end = step.arrays.blind_until[first + i];
      }
      continue;
    }
    // leaking: until the reference is a threshold below the signal
    if (step.pattern.leak != nullptr) {
      const double leak = leak_rate(step, first + i, dn[i]);
      const double theta = step.pattern.theta_on[first + i];
      const double wait =
          leak > 0.0 ? (r + theta - static_cast<double>(signal[i])) / leak : FAR_AWAY;
      soonest = wait < soonest ? wait : soonest;
    }
    // photon noise: as long as the budget lasts for certain
    if (step.arrays.photon_noise()) {
      const double lasts = noise_lasts(step, first + i, signal[i], dn[i], end, soonest);
      soonest = lasts < soonest ? lasts : soonest;
    }
  }
  // the division rounds by less than a us for waits below 2^50 us
  const int64_t leak_end = soonest < 0x1p50 ? end + static_cast<int64_t>(soonest) - 2 : NEVER;
  return leak_end < refractory_end ? leak_end : refractory_end - 1;
}

// The pixels, as bits, whose signal has reached a threshold or whose reference is NaN. In: the
// signal at the end of the tick, the reference at its start, and by how much it sinks.
template <bool DRIFTS>
EVS_ALWAYS_INLINE uint64_t pixels_at_threshold(const float* __restrict theta_on,
                                               const float* __restrict theta_off,
                                               const float* __restrict to,
                                               const double* __restrict drift,
                                               const double* __restrict reference, size_t count) {
  alignas(64) uint64_t flags[BLOCK_PIXELS];
  uint64_t any = 0;
  for (size_t i = 0; i < count; i++) {
    const double r = reference[i];
    const double on = theta_on[i];
    const double off = theta_off[i];
    double end = to[i];
    if constexpr (DRIFTS) end += drift[i];
    const bool quiet = (end < r + on) & (end > r - off);
    flags[i] = quiet ? 0 : 1;
    any |= flags[i];
  }
  if (any == 0) return 0;
  uint64_t pixels = 0;
  for (size_t i = 0; i < count; i++) pixels |= flags[i] << i;
  return pixels;
}

// A bound of the signal of pixel i of a block inside the tick, against its reference.
EVS_ALWAYS_INLINE double highest_of(const PixelStep& step, size_t first, size_t i, const Scratch& s,
                                    Signal signal, double drift) {
  double highest = std::max<double>(signal.from[i], signal.to[i]);
  if (step.curves) {
    // it is between its inputs, which bend by no more than they differ
    const double x0 = step.arrays.last_log[first + i];
    const double x1 = s.log[i];
    highest = std::max(highest, std::max(x0, x1));
    if (step.settings.lowpass()) {
      const double p0 = s.from[0][i];
      const double p1 = step.arrays.filtered[first + i];
      highest = std::max(highest, std::max(p0, p1)) + std::abs((x1 - x0) - (p1 - p0));
    }
  }
  return std::max(highest, highest + drift);
}

// Whether a candidate is below the rate of its pixel at this light.
EVS_ALWAYS_INLINE bool accepts(const PixelStep& step, size_t first, const ShotCandidate& shot,
                               float dn) {
  if (shot.draw_hz == ROW_READ) return true;
  const ShotNoise& noise = step.settings.shot;
  const double scale = noise.rate_scale(dn);
  // reject most candidates by the bound of the block; the rates are seldom in the cache
  if (!(shot.draw_hz < step.shot_bounds[first / BLOCK_PIXELS] * scale)) return false;
  const double on = step.pattern.shot_on[first + shot.pixel];
  const double off = step.pattern.shot_off[first + shot.pixel];
  return shot.draw_hz < (on + off) * scale;
}

// Pixels [first, first + count) of one block. Out: pixels with unusable luminance.
EVS_ALWAYS_INLINE size_t step_block(const PixelStep& step, size_t first, size_t count, Scratch& s,
                                    BudgetScratch& budgets, NoisyPixels& noisy_pixels,
                                    std::vector<ShotCandidate>& shots, std::vector<Crossing>& out) {
  const PixelArrays& arrays = step.arrays;
  const size_t block = first / BLOCK_PIXELS;
  const int64_t end_us = step.tick.begin_us + step.tick.us;
  float* last_luminance = arrays.last_luminance + first;

  // draw candidates for shot noise
  shots.clear();
  if (arrays.shot_noise() && arrays.shot.next[block] <= end_us * SHOT_UNITS) {
    draw_candidates(step.settings.shot, {arrays.shot.next + block, arrays.shot.count + block},
                    block, count, step.shot_bounds[block], step.tick.begin_us, end_us, shots);
  }
  add_row_reads(step.tick.rows, first, count, shots);
  // skip the block if no event can occur
  const LuminanceCheck seen =
      check_luminance(step.tick.luminance + first, last_luminance, step.safe_below, count);
  bool changed = seen.changed;
  const bool due = step.tick.all_due || (arrays.due_us != nullptr && arrays.due_us[block] < end_us);
  if (!changed && !due) {
    // in a block that is otherwise quiet, drop the candidates that are rejected
    const float* light =
        step.settings.averages() ? arrays.running_mean.mean + first : last_luminance;
    std::erase_if(shots, [&](const ShotCandidate& shot) {
      return !accepts(step, first, shot, to_dn(step.settings.map, light[shot.pixel]));
    });
    if (shots.empty()) return 0;
  }

  // front end
  use_up_skipped_budgets(step, first, count, budgets);
  apply_skipped_leak(step, first, count);
  const size_t clamped = log_intensity(step, first, count, s, seen.safe, changed);
  const Signal signal = limit_bandwidth(step, first, count, s, changed);
  // find the pixels at a threshold and those with noise
  const bool drifts = step.pattern.leak != nullptr || step.settings.highpass > 0.0;
  double* reference = arrays.reference + first;
  const float* theta_on = step.pattern.theta_on + first;
  const float* theta_off = step.pattern.theta_off + first;
  uint64_t noisy = 0;
  uint64_t read = 0;
  for (const ShotCandidate& shot : shots) {
    const uint64_t bit = uint64_t{1} << shot.pixel;
    if (shot.draw_hz == ROW_READ) {
      read |= bit;
    } else if (accepts(step, first, shot, s.dn[shot.pixel])) {
      noisy |= bit;
    }
  }
  uint64_t at_threshold = 0;
  const bool photon_noise = arrays.photon_noise();
  if (drifts) reference_drift(step, first, count, signal, s, changed);
  if (photon_noise) {
    noisy |= read;
    const double* begin = drifts ? s.reference : reference;
    const NoiseReach reach =
        within_reach(step, first, count, s.dn, signal, begin, drifts ? s.drift : nullptr, budgets);
    // those that move come last: NoisyComparators take their steps from the scratch
    at_threshold = use_up_still(step, first, reach.still & ~noisy, s.dn, signal, begin, budgets);
    at_threshold |= use_up_moving(step, first, reach.moving | noisy, noisy, s.dn, begin, budgets);
  } else if (drifts) {
    at_threshold =
        pixels_at_threshold<true>(theta_on, theta_off, signal.to, s.drift, s.reference, count);
  } else {
    at_threshold =
        pixels_at_threshold<false>(theta_on, theta_off, signal.to, nullptr, reference, count);
  }
  if (drifts) {
    // the references sink; those of pixels at a threshold are overwritten below
    for (size_t i = 0; i < count; i++) reference[i] = s.reference[i] - s.drift[i];
  }
  // of the pixels whose row is read, those without another event that the read may fire
  for (uint64_t left = read & ~(noisy | at_threshold); left != 0; left &= left - 1) {
    const size_t i = static_cast<size_t>(std::countr_zero(left));
    const double drift = drifts ? s.drift[i] : 0.0;
    const double highest = highest_of(step, first, i, s, signal, drift);
    const double level = (drifts ? s.reference[i] : reference[i]) + theta_on[i];
    // 2^-40 covers the rounding of the signal
    if (highest + step.settings.aps_crosstalk + 0x1p-40 >= level) noisy |= uint64_t{1} << i;
  }
  noisy |= read & at_threshold;

  // run their comparators
  const bool refractory = step.settings.refractory > 0;
  if (refractory) {
    // prefetch the ends of refractory periods, which are seldom in the cache
    for (uint64_t left = at_threshold; left != 0; left &= left - 1) {
      const size_t i = static_cast<size_t>(std::countr_zero(left));
      __builtin_prefetch(arrays.blind_until + first + i);
    }
  }
  for (uint64_t left = at_threshold | noisy; left != 0; left &= left - 1) {
    const size_t i = static_cast<size_t>(std::countr_zero(left));
    const double r = drifts ? s.reference[i] : reference[i];
    const double drift = drifts ? s.drift[i] : 0.0;
    const Response response = response_of(step, first, i, s, signal, drift);
    if ((noisy >> i & 1) != 0) {
      compare<true>(step, first + i, response, signal.from[i], signal.to[i], s.dn[i], r, drift,
                    budgets, shots, noisy_pixels, out);
    } else if (r != r || photon_noise) {
      compare<false>(step, first + i, response, signal.from[i], signal.to[i], s.dn[i], r, drift,
                     budgets, shots, noisy_pixels, out);
    } else if (refractory) {
      compare_simple<true>(step, first + i, response, signal.from[i], signal.to[i], r, drift, out);
    } else {
      compare_simple<false>(step, first + i, response, signal.from[i], signal.to[i], r, drift, out);
    }
#ifdef EVS_ON_DEVICE
    advance_noisy(step, noisy_pixels, 0, out);
#endif
  }
#ifndef EVS_ON_DEVICE
  // make room for those of another block; what follows needs the state of this one's
  const bool all = !changed && (at_threshold | noisy) != 0;
  if (photon_noise && (all || noisy_pixels.idle_count < BLOCK_PIXELS)) {
    noisy_pixels.advance(step, noisy_pixels, all ? 0 : BLOCK_PIXELS, out);
  }
#endif
  // store the state of the block
  if (arrays.due_us != nullptr) {
    arrays.due_us[block] = changed ? end_us : quiet_until(step, first, count, signal.to, s.dn);
    arrays.since_us[block] = end_us;
  }
  float* last_log = arrays.last_log + first;
  for (size_t i = 0; i < count; i++) last_log[i] = s.log[i];
  for (size_t i = 0; i < count; i++) last_luminance[i] = s.usable[i];
  return clamped;
}

}  // namespace evs
