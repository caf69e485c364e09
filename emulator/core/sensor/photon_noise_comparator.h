// The ON and OFF comparators of pixels with photon noise through one tick.
//
// As Comparators (comparator.h), with levels that the sum of signal and noise reaches by first
// passage (photon_noise.h): a step of time uses up the budget of the pixel by its hazard, and where
// the hazard is larger there is an event, at which the noise is known. Steps are short while the
// noise loses its memory and may decide when the event comes. Pixels step side by side,
// each at its own time (photon_noise_steps.h).
#pragma once

#include <algorithm>
#include <cmath>
#include <cstdint>
#include <limits>
#include <vector>

#include "sensor/comparator.h"
#include "sensor/photon_noise.h"

namespace evs {

// One pixel. NoisySteps works out its next step, from `now` to `end`.
struct NoisyComparators {
  Comparators pixel;  // In/out: as there
  NoiseBand band = {};
  NoiseStep step = {};  // the next one; at first that over the whole tick
  NoiseDraws draws = {};
  double leak = 0.0;       // log units per us, of a still pixel
  bool still = false;      // its signal stands still, and its reference moves by the leak alone
  double budget = 0.0;     // In/out: hazard up to the next event
  double mean = 0.0;       // In/out: of the noise, log units
  double memory = 0.0;     // In/out
  double now = 0.0;        // us after the start of the tick
  double end = 0.0;        // of the next step
  double signal = 0.0;     // now
  double reference = 0.0;  // at the start of the tick
  bool has_step = false;   // `step` holds
  bool up = false;         // which level is reached in the step
  double used = 0.0;       // of its hazard, where it is reached
  bool is_blind = false;   // for the rest of the tick
  // After an event, at `now`: when its refractory period ends, or the tick before it, us after the
  // start of the tick; whether the noise is sampled then; and the counters of its random numbers
  double over = 0.0;
  bool samples = false;
  uint64_t normal_counter = 0;
  uint64_t budget_counter = 0;

  // What comes after a step: another one, finding the place of an event, what the event leaves of
  // the noise, or nothing.
  enum class Next { STEP, PLACE, EVENT, DONE };

  // Begin the tick. Candidates, of which this pixel's first is at `first_shot` us, or the end of
  // the tick, are left to the caller. Out: whether steps are left before it.
  bool begin(uint32_t first_shot, std::vector<Crossing>& out) {
    length_ = pixel.tick;
    v_ = (pixel.to - pixel.from) + pixel.drift;
    reference = pixel.reference;
    signal = pixel.from;
    now = 0.0;
    last_ = 1;
    is_blind = false;
    has_step = reference == reference;
    if (!has_step) {
      if (pixel.blind_until > pixel.begin_us + pixel.tick) {
        forget(length_);
        is_blind = true;
        return false;
      }
      const int64_t wake = pixel.blind_until - pixel.begin_us;
      forget(static_cast<double>(wake));
      restart(wake);
    } else if (still && memory == 0.0) {
      const StillNoise quiet(band, pixel.from, pixel.theta_on, pixel.theta_off, leak, reference,
                             pixel.begin_us);
      const auto outcome = quiet.run(pixel.begin_us + first_shot, budget, draws);
      go_to(static_cast<double>(outcome.us - pixel.begin_us));
      has_step = false;
      if (outcome.fired) {
        const Cause cause = outcome.leaked ? pixel.drift_cause : Cause::SHOT;
        fire(out, now, outcome.up, cause);
        recover();
      }
    }
    return go_on(first_shot);
  }

  // Step on up to a time; false if nothing is left up to there.
  bool go_on(double to) {
    until_ = end = to;
    has_step = has_step && to == length_;
    return !is_blind && now < to;
  }

  // Draw what a candidate for shot noise or a row read does to the pixel.
  void take_shot(const ShotCandidate& shot, std::vector<Crossing>& out) {
    const double draw = shot.draw_hz;
    const uint32_t stamp = shot.offset;
    if (stamp < now) return;
    if (draw == ROW_READ) {
      if (!lifted_to_threshold()) return;
      emit(out, stamp, true, Cause::APS);
    } else {
      if (draw >= (pixel.shot_on + pixel.shot_off) * pixel.rate_scale) return;
      emit(out, stamp, draw < pixel.shot_on * pixel.rate_scale, Cause::SHOT);
    }
    restart(stamp);
    start_refractory(stamp);
    end_refractory();
  }

  // What comes after an event whose noise NoisySteps has worked out.
  Next go_on_after_event() {
    now = over;
    end = until_;
    return !is_blind && now < until_ ? Next::STEP : Next::DONE;
  }

  // The end of the tick.
  void finish() {
    if (!is_blind) pixel.reference = reference - pixel.drift;
  }

  // Take the step, or choose a shorter one.
  Next take_step(std::vector<Crossing>& out) {
    has_step = false;
    const double dt = end - now;
    const bool can_be_cut = end > now + 1.0;  // what is cut lasts 1 us at least
    const double random = step.on.random + step.off.random;
    // a step in which the noise loses its memory, and may fire, is short
    if (memory > KNOWN && band.decay * dt > SHORT_STEP && can_be_cut &&
        random * COARSE_PARTS > budget) {
      end = now + std::max(1.0, 0.9 * SHORT_STEP / band.decay);
      return Next::STEP;
    }
    const double hazard = random + (step.on.moving + step.off.moving);
    if (can_be_cut && band.decay * dt > LONG_STEP && (memory > 0.0 || !(hazard < budget))) {
      const double sooner = part_of_long();
      if (sooner < dt) {
        end = now + std::max(1.0, sooner);
        return Next::STEP;
      }
    }
    if (hazard < budget) {
      budget = budget_left(budget, hazard);
      now = end;
      signal = step.signal1;
      mean = step.mean1;
      memory = step.memory1;
      end = until_;
      return now < until_ ? Next::STEP : Next::DONE;
    }
    // draw the level that is reached
    const double on = step.on.hazard();
    up = on > 0.0;
    if (up && on < hazard) {
      up = draws.polarity(pixel.begin_us + static_cast<int64_t>(now)) * hazard < on;
    }
    const double share = budget / hazard;
    used = share * level().hazard();
    return level().x1 < level().x0 ? Next::PLACE : fire_in_step(share, Cause::SHOT, out);
  }

  // The level that is reached in the step.
  const NoiseLevel& level() const { return up ? step.on : step.off; }

  // Fire where the level is reached: after a share of the step. `random`: the noise did it, not the
  // way of the level.
  Next arrive(double share, bool random, std::vector<Crossing>& out) {
    const double dt = end - now;
    if (random && end > now + 1.0 && !is_straight()) {
      end = now + 0.5 * dt;
      return Next::STEP;
    }
    const bool moved = std::abs(v_) * (dt / length_) >= std::abs(mean - step.mean1);
    const bool by_signal = moved && !random;
    const Cause cause =
        by_signal ? cause_of(pixel.to - pixel.from, pixel.drift, pixel.drift_cause) : Cause::SHOT;
    return fire_in_step(share, cause, out);
  }

 private:
  double length_ = 0.0;
  double v_ = 0.0;      // by how much the signal moves against the reference in the tick
  double until_ = 0.0;  // us after the start of the tick
  uint32_t last_ = 1;   // stamp

  double signal_at(double us) const { return pixel.from + pixel.response.moved(us / length_); }

  void go_to(double us) {
    now = us;
    signal = signal_at(us);
  }

  void forget(double us) {
    const NoiseMemory left = evs::forget({memory, mean}, band.decay, us);
    memory = left.memory;
    mean = left.mean;
  }

  // From here on the noise is known.
  void know(double value) {
    mean = value;
    memory = 1.0;
  }

  // Sample the noise, and set the reference to signal and noise.
  void restart(int64_t us) {
    const double value =
        mean + band.sigma * unknown_share(memory) * draws.standard_normal(pixel.begin_us + us);
    go_to(static_cast<double>(us));
    reference = on_grid(signal + value);
    know(value);
    budget = draws.renew(pixel.begin_us + us);
  }

  // Whether a row read, which lifts the signal for an instant, lifts it to the ON threshold: the
  // level passes some of the noise.
  bool lifted_to_threshold() {
    const double sigma = band.sigma * unknown_share(memory);
    const double distance = pixel.theta_on - (signal - reference) - mean;
    const double scale = 1.0 / (sigma + 1e-12);
    const double lifted = in_deviations((distance - pixel.crosstalk) * scale, 8.0);
    const double passed = lifted < PASSED
                              ? CERTAIN
                              : PASSAGE_TABLE.loss_at(lifted) -
                                    PASSAGE_TABLE.loss_at(in_deviations(distance * scale, 8.0));
    if (passed >= budget) return true;
    budget = budget_left(budget, passed);
    return false;
  }

  void emit(std::vector<Crossing>& out, uint32_t stamp, bool up, Cause cause) {
    last_ = stamp;
    out.push_back(
        {pixel.pixel, (stamp << TAG_BITS) | (static_cast<uint32_t>(cause) << 1) | (up ? 1u : 0u)});
  }

  // Start the refractory period after an event; it may be none.
  void start_refractory(uint32_t stamp) {
    const bool any = pixel.refractory > 0;
    const int64_t until = static_cast<int64_t>(stamp) + pixel.refractory;
    is_blind = any && until > pixel.tick;
    samples = any && !is_blind;
    over = samples ? static_cast<double>(until) : is_blind ? length_ : now;
    if (is_blind) {
      pixel.blind_until = pixel.begin_us + until;
      pixel.reference = std::numeric_limits<double>::quiet_NaN();
    }
  }

  // The refractory period passes.
  void end_refractory() {
    forget(over - now);
    if (samples) restart(static_cast<int64_t>(over));
  }

  Next fire_in_step(double share, Cause cause, std::vector<Crossing>& out) {
    const uint32_t stamp = fire(out, now + share * (end - now), up, cause);
    if (!is_blind) {
      const int64_t us = pixel.begin_us + (samples ? static_cast<int64_t>(over) : stamp);
      normal_counter = draws.normal_at(us);
      budget_counter = draws.next_budget(us);
    }
    return Next::EVENT;
  }

  // An event at `us`, after which the reference is the level. Out: its stamp.
  uint32_t fire(std::vector<Crossing>& out, double us, bool up, Cause cause) {
    const double rounded = std::ceil(us);
    const double late = rounded > last_ ? rounded : last_;
    const uint32_t stamp = static_cast<uint32_t>(late < length_ ? late : length_);
    emit(out, stamp, up, cause);
    reference += up ? pixel.theta_on : -pixel.theta_off;
    // noise fires once a us
    const double at = cause != Cause::SHOT ? us : rounded > now ? rounded : std::floor(now) + 1.0;
    now = at < length_ ? at : length_;
    start_refractory(stamp);
    return stamp;
  }

  // What an event leaves of the noise, of one pixel; NoisySteps has it for many.
  void recover() {
    go_to(now);
    know(reference - signal);
    end_refractory();
    if (pixel.refractory == 0) budget = draws.renew(pixel.begin_us + last_);
  }

  // How much of a long step to step first, us: until the noise has lost its memory, then, where an
  // event comes, until a level is so near that it comes before.
  double part_of_long() const {
    if (memory > 0.0) return FORGETS / band.decay;
    const double above = signal - reference;
    const double moves = (step.signal1 - reference) - above;
    const double distance = moves > 0.0 ? pixel.theta_on - above : pixel.theta_off + above;
    const NoiseLevel& level = moves > 0.0 ? step.on : step.off;
    if (!(level.x1 < PASSED && level.x0 > NEAREST)) return end - now;
    return (distance - NEAREST * band.sigma) / std::abs(moves) * (end - now);
  }

  // Whether the signal is a line in the step, but for a part of the noise. If not, the time that it
  // spends at a level, and so the hazard there, is another.
  bool is_straight() const {
    if (!pixel.response.bends) return true;
    const double sag = signal_at(0.5 * (now + end)) - 0.5 * (signal + step.signal1);
    return std::abs(sag) < STRAIGHT_PART * band.sigma;
  }
};

}  // namespace evs
