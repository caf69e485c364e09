// The ON and OFF comparators of one pixel with photon noise through one tick.
//
// As Comparators (comparator.h), with levels that the sum of signal and noise reaches by first
// passage (photon_noise.h): a step of time uses up the budget of the pixel by its hazard, and where
// the hazard is larger there is an event, at which the noise is known. A step is halved while it is
// coarse and noise may decide when the event comes.
#pragma once

#include <cmath>
#include <cstdint>
#include <limits>
#include <vector>

#include "comparator.h"
#include "photon_noise.h"

namespace evs {

struct NoisyComparators {
  Comparators pixel;  // In/out: as there
  NoiseBand band;
  NoiseDraws draws;
  double leak = 0.0;    // log units per us, of a still pixel
  bool still = false;   // its signal stands still, and its reference moves by the leak alone
  double budget = 0.0;  // In/out: hazard up to the next event
  double mean = 0.0;    // In/out: of the noise, log units
  double memory = 0.0;  // In/out

  NoisyComparators(const Comparators& comparators, const NoiseBand& at_light,
                   const NoiseDraws& numbers)
      : pixel(comparators), band(at_light), draws(numbers) {}

  template <bool NOISY>
  void run(uint32_t index, const std::vector<ShotCandidate>& shots, std::vector<Crossing>& out) {
    length = pixel.tick;
    v = (pixel.to - pixel.from) + pixel.drift;
    r = pixel.reference;
    if (r != r) {
      if (pixel.blind_until > pixel.begin_us + pixel.tick) {
        forget(length);
        return;
      }
      const int64_t wake = pixel.blind_until - pixel.begin_us;
      forget(static_cast<double>(wake));
      restart(wake);
    } else if (still && memory == 0.0) {
      const StillNoise quiet(band, pixel.from, pixel.theta_on, pixel.theta_off, leak, r,
                             pixel.begin_us);
      const size_t first = NOISY ? first_shot(index, shots) : shots.size();
      const uint32_t until = first < shots.size() ? shots[first].offset : pixel.tick;
      const auto outcome = quiet.run(pixel.begin_us + until, budget, draws);
      now = static_cast<double>(outcome.us - pixel.begin_us);
      if (outcome.fired) {
        const Cause cause = outcome.leaked ? pixel.drift_cause : Cause::shot;
        if (!fire(out, now, outcome.up, cause)) return;
      }
    }
    const size_t count = NOISY ? shots.size() : 0;
    for (size_t k = 0; k <= count; k++) {
      if (k < count && shots[k].pixel != index) continue;
      const double until = k < count ? shots[k].offset : pixel.tick;
      if (!advance(until, out)) return;
      if (k == count) break;
      const double draw = shots[k].draw_hz;
      const uint32_t stamp = shots[k].offset;
      if (until < now) continue;
      if (draw == kRowRead) {
        if (!lifted_to_threshold()) continue;
        emit(out, stamp, true, Cause::aps);
      } else {
        if (draw >= (pixel.shot_on + pixel.shot_off) * pixel.rate_scale) continue;
        emit(out, stamp, draw < pixel.shot_on * pixel.rate_scale, Cause::shot);
      }
      restart(stamp);
      if (!blind(stamp)) return;
    }
    pixel.reference = r - pixel.drift;
  }

 private:
  double length = 0.0;
  double v = 0.0;     // by how much the signal moves against the reference in the tick
  double r = 0.0;     // reference at the start of the tick
  double now = 0.0;   // us after the start of the tick
  uint32_t last = 1;  // stamp

  size_t first_shot(uint32_t index, const std::vector<ShotCandidate>& shots) const {
    size_t k = 0;
    while (k < shots.size() && shots[k].pixel != index) k++;
    return k;
  }

  double signal_at(double us) const { return pixel.from + v * (us / length); }

  double keep(double us) const {
    return 1.0 - static_cast<double>(lowpass_a(static_cast<float>(band.decay * us)));
  }

  void forget(double us) {
    const double kept = keep(us);
    memory *= kept;
    mean *= kept;
    if (memory < kForgotten) memory = mean = 0.0;
  }

  // From here on the noise is known.
  void know(double value, int64_t us) {
    mean = value;
    memory = 1.0;
    budget = draws.renew(pixel.begin_us + us);
  }

  // Sample the noise, and set the reference to signal and noise.
  void restart(int64_t us) {
    const double value =
        mean + band.sigma * unknown_share(memory) * draws.standard_normal(pixel.begin_us + us);
    now = static_cast<double>(us);
    r = on_grid(signal_at(now) + value);
    know(value, us);
  }

  // Whether a row read, which lifts the signal for an instant, lifts it to the ON threshold: the
  // level passes some of the noise.
  bool lifted_to_threshold() {
    const double sigma = band.sigma * unknown_share(memory);
    const double distance = pixel.theta_on - (signal_at(now) - r) - mean;
    const double lifted = in_deviations(distance - pixel.crosstalk, sigma);
    const double passed =
        lifted < kPassed
            ? kCertain
            : kPassageTable.loss_at(lifted) - kPassageTable.loss_at(in_deviations(distance, sigma));
    if (passed >= budget) return true;
    budget -= on_budget_grid(passed);
    return false;
  }

  void emit(std::vector<Crossing>& out, uint32_t stamp, bool up, Cause cause) {
    last = stamp;
    out.push_back(
        {pixel.pixel, (stamp << kTagBits) | (static_cast<uint32_t>(cause) << 1) | (up ? 1u : 0u)});
  }

  // Start the refractory period; false if it outlasts the tick.
  bool blind(uint32_t stamp) {
    if (pixel.refractory == 0) return true;
    const int64_t until = static_cast<int64_t>(stamp) + pixel.refractory;
    if (until > pixel.tick) {
      pixel.blind_until = pixel.begin_us + until;
      pixel.reference = std::numeric_limits<double>::quiet_NaN();
      forget(length - now);
      return false;
    }
    forget(static_cast<double>(until) - now);
    restart(until);
    return true;
  }

  // An event at `us`, after which the reference is the level; false if the pixel is blind for the
  // rest of the tick.
  bool fire(std::vector<Crossing>& out, double us, bool up, Cause cause) {
    const double rounded = std::ceil(us);
    const double late = rounded > last ? rounded : last;
    const uint32_t stamp = static_cast<uint32_t>(late < length ? late : length);
    emit(out, stamp, up, cause);
    r += up ? pixel.theta_on : -pixel.theta_off;
    // noise fires once a us
    now = cause == Cause::shot ? (us < length - 1.0 ? std::floor(us) + 1.0 : length) : us;
    know(r - signal_at(now), stamp);
    return blind(stamp);
  }

  // Of a level that goes from x0 to x1 deviations.
  double mean_rate(double x0, double x1) const {
    const double rates = kPassageTable.rate_at(band.shift, x0) +
                         4.0 * kPassageTable.rate_at(band.shift, 0.5 * (x0 + x1)) +
                         kPassageTable.rate_at(band.shift, x1);
    return rates / 6.0;
  }

  // The hazard of a level from x0 to x1 deviations in a step.
  struct Level {
    double x0, x1, passages = 0.0, loss = 0.0;
  };

  Level level(double distance0, double distance1, double sigma0, double sigma1,
              double passages) const {
    Level level;
    level.x0 = in_deviations(distance0, sigma0);
    level.x1 = in_deviations(distance1, sigma1);
    if (level.x0 >= kFarLevel && level.x1 >= kFarLevel) return level;
    level.passages = passages * mean_rate(level.x0, level.x1);
    const double fallen = kPassageTable.loss_at(level.x1) - kPassageTable.loss_at(level.x0);
    level.loss = level.x1 < kPassed ? kCertain : fallen > 0.0 ? fallen : 0.0;
    return level;
  }

  // Whether the noise loses much of its memory in a step.
  bool relaxes(double dt, double kept) const { return memory > kept && band.decay * dt > 0.1; }

  // Step up to `until`, with all events before it; false if the pixel is blind for the rest.
  bool advance(double until, std::vector<Crossing>& out) {
    double end = until;
    while (now < until) {
      const double dt = end - now;
      const double kept = keep(dt);
      const double memory1 = memory * kept < kForgotten ? 0.0 : memory * kept;
      const double mean1 = memory1 > 0.0 ? mean * kept : 0.0;
      const double sigma0 = band.sigma * unknown_share(memory);
      const double sigma1 = band.sigma * unknown_share(memory1);
      const double above0 = (signal_at(now) - r) + mean;
      const double above1 = (signal_at(end) - r) + mean1;
      const double passages = band.slow * dt / (1.0 - memory * memory1 + 0x1p-40);
      const Level on =
          level(pixel.theta_on - above0, pixel.theta_on - above1, sigma0, sigma1, passages);
      const Level off =
          level(pixel.theta_off + above0, pixel.theta_off + above1, sigma0, sigma1, passages);
      const double limit = kCoarseHazard * budget;
      bool up = on.loss > off.loss;
      const Level& moving = up ? on : off;
      if (moving.loss >= budget) {
        // the signal moves the level past the noise: the event is where the loss reaches the
        // budget, or earlier by what passages of the noise use up of it
        const double distance0 = up ? pixel.theta_on - above0 : pixel.theta_off + above0;
        const double distance1 = up ? pixel.theta_on - above1 : pixel.theta_off + above1;
        const double loss0 = kPassageTable.loss_at(moving.x0);
        double place = 0.5;
        double known = memory;
        double x = moving.x1;
        auto cross_at = [&](double loss) {
          x = kPassageTable.level_of_loss(loss0 + loss);
          for (int i = 0; i < 2; i++) {
            known = memory + (memory1 - memory) * place;
            const double part =
                (distance0 - x * band.sigma * unknown_share(known)) / (distance0 - distance1);
            place = part > 0.0 ? (part < 1.0 ? part : 1.0) : 0.0;
          }
        };
        cross_at(budget);
        const double earlier =
            band.slow * (place * dt) / (1.0 - memory * known + 0x1p-40) * mean_rate(moving.x0, x);
        const bool rough = moving.x0 - x > 1.0 || relaxes(dt, kept);
        if (rough && place * dt > 1.0 && earlier > limit) {
          end = now + 0.5 * (place * dt);
          continue;
        }
        Cause cause = cause_of(pixel.to - pixel.from, pixel.drift, pixel.drift_cause);
        if (earlier >= budget) {
          cause = Cause::shot;
          place *= budget / earlier;
        } else if (earlier > 0.1 * budget) {
          cross_at(budget - earlier);
        }
        if (!fire(out, now + place * dt, up, cause)) return false;
        end = until;
        continue;
      }
      const double random = on.passages + off.passages;
      const bool coarse =
          std::abs(on.x1 - on.x0) > 1.0 || std::abs(off.x1 - off.x0) > 1.0 || relaxes(dt, kept);
      if (coarse && dt > 1.0 && random > limit) {
        end = now + 0.5 * dt;
        continue;
      }
      const double hazard = random + on.loss + off.loss;
      if (hazard < budget) {
        budget -= on_budget_grid(hazard);
        now = end;
        mean = mean1;
        memory = memory1;
        end = until;
        continue;
      }
      const double on_share = on.passages + on.loss;
      up = draws.polarity(pixel.begin_us + static_cast<int64_t>(now)) * hazard < on_share;
      const bool moved = (up ? on.loss : off.loss) > random && sigma1 == sigma0;
      const Cause cause =
          moved ? cause_of(pixel.to - pixel.from, pixel.drift, pixel.drift_cause) : Cause::shot;
      if (!fire(out, now + budget / hazard * dt, up, cause)) return false;
      end = until;
    }
    return true;
  }
};

}  // namespace evs
