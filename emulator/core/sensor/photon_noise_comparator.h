// The ON and OFF comparators of one pixel with photon noise through one tick.
//
// As Comparators (comparator.h), with levels that the sum of signal and noise reaches by first
// passage (photon_noise.h): a step of time uses up the budget of the pixel by its hazard, and where
// the hazard is larger there is an event, at which the noise is known. Steps are short while the
// noise loses its memory and may decide when the event comes.
#pragma once

#include <algorithm>
#include <cmath>
#include <cstdint>
#include <limits>
#include <vector>

#include "sensor/comparator.h"
#include "sensor/photon_noise.h"

namespace evs {

struct NoisyComparators {
  Comparators pixel;  // In/out: as there
  NoiseBand band;
  NoiseStep whole;  // the step over the whole tick
  NoiseDraws draws;
  double leak = 0.0;    // log units per us, of a still pixel
  bool still = false;   // its signal stands still, and its reference moves by the leak alone
  double budget = 0.0;  // In/out: hazard up to the next event
  double mean = 0.0;    // In/out: of the noise, log units
  double memory = 0.0;  // In/out

  NoisyComparators(const Comparators& comparators, const NoiseBand& at_light, const NoiseStep& step,
                   const NoiseDraws& numbers)
      : pixel(comparators), band(at_light), whole(step), draws(numbers) {}

  template <bool NOISY>
  void run(uint32_t index, const std::vector<ShotCandidate>& shots, std::vector<Crossing>& out) {
    length_ = pixel.tick;
    v_ = (pixel.to - pixel.from) + pixel.drift;
    r_ = pixel.reference;
    signal_ = pixel.from;
    const bool stepped = r_ == r_;  // `whole` is of this reference
    if (!stepped) {
      if (pixel.blind_until > pixel.begin_us + pixel.tick) {
        forget(length_);
        return;
      }
      const int64_t wake = pixel.blind_until - pixel.begin_us;
      forget(static_cast<double>(wake));
      restart(wake);
    } else if (still && memory == 0.0) {
      const StillNoise quiet(band, pixel.from, pixel.theta_on, pixel.theta_off, leak, r_,
                             pixel.begin_us);
      const size_t first = NOISY ? first_shot(index, shots) : shots.size();
      const uint32_t until = first < shots.size() ? shots[first].offset : pixel.tick;
      const auto outcome = quiet.run(pixel.begin_us + until, budget, draws);
      go_to(static_cast<double>(outcome.us - pixel.begin_us));
      if (outcome.fired) {
        const Cause cause = outcome.leaked ? pixel.drift_cause : Cause::SHOT;
        if (!fire(out, now_, outcome.up, cause)) return;
      }
    }
    const size_t count = NOISY ? shots.size() : 0;
    for (size_t k = 0; k <= count; k++) {
      if (k < count && shots[k].pixel != index) continue;
      const double until = k < count ? shots[k].offset : pixel.tick;
      if (!advance(until, stepped && now_ == 0.0 && until == length_, out)) return;
      if (k == count) break;
      const double draw = shots[k].draw_hz;
      const uint32_t stamp = shots[k].offset;
      if (until < now_) continue;
      if (draw == ROW_READ) {
        if (!lifted_to_threshold()) continue;
        emit(out, stamp, true, Cause::APS);
      } else {
        if (draw >= (pixel.shot_on + pixel.shot_off) * pixel.rate_scale) continue;
        emit(out, stamp, draw < pixel.shot_on * pixel.rate_scale, Cause::SHOT);
      }
      restart(stamp);
      if (!blind(stamp)) return;
    }
    pixel.reference = r_ - pixel.drift;
  }

 private:
  double length_ = 0.0;
  double v_ = 0.0;       // by how much the signal moves against the reference in the tick
  double r_ = 0.0;       // reference at the start of the tick
  double now_ = 0.0;     // us after the start of the tick
  double signal_ = 0.0;  // now
  uint32_t last_ = 1;    // stamp

  size_t first_shot(uint32_t index, const std::vector<ShotCandidate>& shots) const {
    size_t k = 0;
    while (k < shots.size() && shots[k].pixel != index) k++;
    return k;
  }

  double signal_at(double us) const { return pixel.from + pixel.response.moved(us / length_); }

  void go_to(double us) {
    now_ = us;
    signal_ = signal_at(us);
  }

  double keep(double us) const {
    return 1.0 - static_cast<double>(lowpass_a(static_cast<float>(band.decay * us)));
  }

  void forget(double us) {
    const double kept = keep(us);
    memory *= kept;
    mean *= kept;
    if (memory < FORGOTTEN) memory = mean = 0.0;
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
    r_ = on_grid(signal_ + value);
    know(value);
    budget = draws.renew(pixel.begin_us + us);
  }

  // Whether a row read, which lifts the signal for an instant, lifts it to the ON threshold: the
  // level passes some of the noise.
  bool lifted_to_threshold() {
    const double sigma = band.sigma * unknown_share(memory);
    const double distance = pixel.theta_on - (signal_ - r_) - mean;
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

  // Start the refractory period; false if it outlasts the tick.
  bool blind(uint32_t stamp) {
    if (pixel.refractory == 0) return true;
    const int64_t until = static_cast<int64_t>(stamp) + pixel.refractory;
    if (until > pixel.tick) {
      pixel.blind_until = pixel.begin_us + until;
      pixel.reference = std::numeric_limits<double>::quiet_NaN();
      forget(length_ - now_);
      return false;
    }
    forget(static_cast<double>(until) - now_);
    restart(until);
    return true;
  }

  // An event at `us`, after which the reference is the level; false if the pixel is blind for the
  // rest of the tick.
  bool fire(std::vector<Crossing>& out, double us, bool up, Cause cause) {
    const double rounded = std::ceil(us);
    const double late = rounded > last_ ? rounded : last_;
    const uint32_t stamp = static_cast<uint32_t>(late < length_ ? late : length_);
    emit(out, stamp, up, cause);
    r_ += up ? pixel.theta_on : -pixel.theta_off;
    // noise fires once a us
    now_ = cause != Cause::SHOT ? us : rounded > now_ ? rounded : std::floor(now_) + 1.0;
    go_to(now_ < length_ ? now_ : length_);
    know(r_ - signal_);
    if (pixel.refractory > 0) return blind(stamp);
    budget = draws.renew(pixel.begin_us + stamp);
    return true;
  }

  // The mean rate of first passages over a straight way from x to x + length.
  double mean_rate(double x, double way) const {
    const double within = x > NEAREST ? x : NEAREST;
    return PASSAGE_TABLE.rate_at(band.shift, within) *
           mean_over_way(within, PASSAGE_TABLE.slope_at(within), way);
  }

  NoiseLevel level(double x0, double x1, double passages) const {
    NoiseLevel level{x0, x1};
    const double near = x0 < x1 ? x0 : x1;
    if (near >= FAR_LEVEL) return level;
    level.random = passages * mean_rate(near, std::abs(x1 - x0));
    if (x1 < x0) {
      level.moving = PASSAGE_TABLE.loss_at(x1) - PASSAGE_TABLE.loss_at(x0);
    }
    if (x1 < PASSED) level.moving = CERTAIN;
    return level;
  }

  // Where on its way a level has used up a budget: x deviations.
  struct Place {
    double x;
    bool random;  // the noise did it, not the way of the level
  };

  // Of a level that nears the mean. Its hazard up to x1 is at least `used`.
  Place place_of(const NoiseLevel& level, double passages, double used) const {
    const double start = PASSAGE_TABLE.loss_at(level.x0);
    const double rate = passages / (level.x0 - level.x1);
    const double farthest = std::min<double>(level.x0, FAR_LEVEL);
    Place place{level.x1, false};
    if (level.moving > used) {
      place.x = std::max(level.x1, PASSAGE_TABLE.level_of_loss(start + used));
    }
    for (int i = 0; i < 4; i++) {
      const double x = place.x > NEAREST ? place.x : NEAREST;
      const double gone = level.x0 - place.x;
      const double slope = PASSAGE_TABLE.slope_at(x);
      const double passing = rate * PASSAGE_TABLE.rate_at(band.shift, x);
      const double random = passing * gone * mean_over_way(x, slope, gone);
      if (random < 0.01 * used) break;
      // from behind the place, the nearer of two estimates: for a hazard that is exponential in x,
      // and for one that is constant
      const double all = random + PASSAGE_TABLE.loss_at(place.x) - start;
      double before = gone - 2.0 * all * (all - used) / ((all + used) * (passing + slope));
      if (all > used) before = std::max(before, gone * (used / all));
      place = {std::clamp(level.x0 - before, level.x1, farthest), passing > slope};
      if (all < 2.0 * used) break;
    }
    return place;
  }

  NoiseStep step_to(double end) const {
    NoiseStep step;
    const double dt = end - now_;
    const double kept = keep(dt);
    step.memory1 = memory * kept < FORGOTTEN ? 0.0 : memory * kept;
    step.mean1 = step.memory1 > 0.0 ? mean * kept : 0.0;
    step.passages = band.slow * dt / (1.0 - step.memory1 * step.memory1 + 0x1p-40);
    const double scale0 = 1.0 / (band.sigma * unknown_share(memory) + 1e-12);
    const double scale1 = 1.0 / (band.sigma * unknown_share(step.memory1) + 1e-12);
    const double farthest = farthest_level(memory);
    const double above0 = (signal_ - r_) + mean;
    const double above1 = (signal_at(end) - r_) + step.mean1;
    step.on = level(in_deviations((pixel.theta_on - above0) * scale0, farthest),
                    in_deviations((pixel.theta_on - above1) * scale1, farthest), step.passages);
    step.off = level(in_deviations((pixel.theta_off + above0) * scale0, farthest),
                     in_deviations((pixel.theta_off + above1) * scale1, farthest), step.passages);
    return step;
  }

  // Where in a step up to `end` its level has come to x deviations, as a share of the step. The
  // noise fires at any time of the step, the way of the level when it has come there.
  double share_of(const NoiseStep& step, bool up, Place place, double end) const {
    const double x = place.x;
    const NoiseLevel& level = up ? step.on : step.off;
    double share = (level.x0 - x) / (level.x0 - level.x1);
    const double above0 = (signal_ - r_) + mean;
    const double above1 = (signal_at(end) - r_) + step.mean1;
    const double distance0 = up ? pixel.theta_on - above0 : pixel.theta_off + above0;
    const double nearer = up ? above1 - above0 : above0 - above1;
    if (!(nearer > 0.0)) return share;
    double left = 0.0;
    for (int i = 0; i < 2; i++) {
      const double known = memory + (step.memory1 - memory) * share;
      left = distance0 - x * band.sigma * unknown_share(known);
      share = std::clamp(left / nearer, 0.0, 1.0);
    }
    if (place.random || !pixel.response.bends) return share;
    // the mean of the noise drifts, too
    const double begin = now_ / length_;
    const double part = (end - now_) / length_;
    const Response both = pixel.response.drifting((step.mean1 - mean) / part);
    const double from = (signal_ - pixel.from) + (both.end - pixel.response.end) * begin;
    const double at = share_at(both, up ? from + left : from - left, up, begin, from, length_);
    return std::clamp((at - begin) / part, 0.0, 1.0);
  }

  // How much of a long step to step first, us: until the noise has lost its memory, then, where an
  // event comes, until a level is so near that it comes before.
  double part_of_long(const NoiseStep& step, double end) const {
    if (memory > 0.0) return FORGETS / band.decay;
    const double above = signal_ - r_;
    const double moves = (signal_at(end) - r_) - above;
    const double distance = moves > 0.0 ? pixel.theta_on - above : pixel.theta_off + above;
    const NoiseLevel& level = moves > 0.0 ? step.on : step.off;
    if (!(level.x1 < PASSED && level.x0 > NEAREST)) return end - now_;
    return (distance - NEAREST * band.sigma) / std::abs(moves) * (end - now_);
  }

  // Whether the signal is a line up to `end`, but for a part of the noise. If not, the time that it
  // spends at a level, and so the hazard there, is another.
  bool is_straight(double end) const {
    if (!pixel.response.bends) return true;
    const double sag = signal_at(0.5 * (now_ + end)) - 0.5 * (signal_ + signal_at(end));
    return std::abs(sag) < STRAIGHT_PART * band.sigma;
  }

  // Step up to `until`, with all events before it; false if the pixel is blind for the rest.
  bool advance(double until, bool is_whole, std::vector<Crossing>& out) {
    double end = until;
    while (now_ < until) {
      const NoiseStep step = is_whole ? whole : step_to(end);
      is_whole = false;
      const double dt = end - now_;
      const bool can_be_cut = end > now_ + 1.0;  // what is cut lasts 1 us at least
      const double random = step.on.random + step.off.random;
      // a step in which the noise loses its memory, and may fire, is short
      if (memory > KNOWN && band.decay * dt > SHORT_STEP && can_be_cut &&
          random * COARSE_PARTS > budget) {
        end = now_ + std::max(1.0, 0.9 * SHORT_STEP / band.decay);
        continue;
      }
      const double hazard = random + (step.on.moving + step.off.moving);
      if (can_be_cut && band.decay * dt > LONG_STEP && (memory > 0.0 || !(hazard < budget))) {
        const double sooner = part_of_long(step, end);
        if (sooner < dt) {
          end = now_ + std::max(1.0, sooner);
          continue;
        }
      }
      if (hazard < budget) {
        budget = budget_left(budget, hazard);
        go_to(end);
        mean = step.mean1;
        memory = step.memory1;
        end = until;
        continue;
      }
      // draw the level that is reached, and find where its part of the hazard is used up
      const double on = step.on.hazard();
      bool up = on > 0.0;
      if (up && on < hazard) {
        up = draws.polarity(pixel.begin_us + static_cast<int64_t>(now_)) * hazard < on;
      }
      const NoiseLevel& level = up ? step.on : step.off;
      double share = budget / hazard;
      Cause cause = Cause::SHOT;
      if (level.x1 < level.x0) {
        const Place place = place_of(level, step.passages, share * level.hazard());
        if (place.random && can_be_cut && !is_straight(end)) {
          end = now_ + 0.5 * dt;
          continue;
        }
        share = share_of(step, up, place, end);
        const bool moved = std::abs(v_) * (dt / length_) >= std::abs(mean - step.mean1);
        if (moved && !place.random) {
          cause = cause_of(pixel.to - pixel.from, pixel.drift, pixel.drift_cause);
        }
      }
      if (!fire(out, now_ + share * dt, up, cause)) return false;
      end = until;
    }
    return true;
  }
};

}  // namespace evs
