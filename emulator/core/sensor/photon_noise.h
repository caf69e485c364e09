// Photon noise: what the shot noise of the photocurrent adds to the log intensity in front of the
// comparators (Graca and Delbruck 2023, arXiv 2304.04019).
//
// White noise passes the poles of photoreceptor and source follower, w1 and w2, so its variance is
// sigma^2 = scale w / DN with w = w1 w2 / (w1 + w2), where w is also the rate at which it loses its
// memory. A pixel knows its noise only at an event: the reference is signal plus noise. From then
// on the noise is Gaussian with mean m = n memory and deviation sigma sqrt(1 - memory^2), where
// memory falls as e^-wt. A level at x deviations from the mean is reached with the hazard
//   a rate(x) / (1 - memory^2) + d/dt loss(x) while x falls,
// where a is the slower pole, rate is that of a process with one pole (quasi-stationary), at a
// level that the faster pole moves away, and loss = -ln Phi. An event comes when the hazard has
// used up the budget of the pixel, an exponential random number. So a still pixel draws nothing and
// costs nothing until its event is due, and ticks of any length give the same statistics.
#pragma once

#include <algorithm>
#include <cmath>
#include <cstddef>
#include <cstdint>

#include "lowpass.h"
#include "random.h"

namespace evs {

inline constexpr uint64_t kTermPhotonNoise = 10;

inline constexpr float kFarLevel = 6.0f;       // deviations; a level beyond is not reached
inline constexpr double kPassed = -7.0;        // a level beyond was passed for certain
inline constexpr double kCertain = 30.0;       // no budget is larger
inline constexpr float kForgotten = 0x1p-10f;  // a smaller memory counts as none
inline constexpr double kCoarseHazard = 0.02;  // of the budget: a coarse step with more is halved

struct PhotonNoise {
  uint64_t key = 0;
  double scale = 0.0;  // sigma^2 DN / w, us; 0: no noise
};

// Round to a multiple of 2^-46, |value| < 32.
EVS_ALWAYS_INLINE double on_budget_grid(double value) { return (value + 96.0) - 96.0; }

// ln of the rate of first passages and of the loss at 8 t deviations, |t| <= 1: fits, with errors
// of 1.6 % and 0.8 % of rate and loss between -3 and 6 deviations. The rate is the lowest
// eigenvalue of f'' - x f' = -rate f below the level, where f = 0.
template <class Real>
EVS_ALWAYS_INLINE Real log_passage_rate(Real t) {
  Real p = Real(-0x1.1ec48cp+3);
  p = p * t + Real(-0x1.05ac36p+0);
  p = p * t + Real(0x1.53adfep+4);
  p = p * t + Real(0x1.4b056p+2);
  p = p * t + Real(-0x1.291d9cp+4);
  p = p * t + Real(-0x1.dc26c6p+3);
  p = p * t + Real(-0x1.ed776cp+2);
  p = p * t + Real(-0x1.8d04dep+2);
  return p * t + Real(-0x1.b1e422p-10);
}

template <class Real>
EVS_ALWAYS_INLINE Real log_passage_loss(Real t) {
  Real p = Real(-0x1.3bd722p+1);
  p = p * t + Real(-0x1.0ffc32p+2);
  p = p * t + Real(0x1.6cd316p+2);
  p = p * t + Real(0x1.4ae1dp+3);
  p = p * t + Real(-0x1.4366ap+2);
  p = p * t + Real(-0x1.03d2a6p+4);
  p = p * t + Real(-0x1.b3b8aep+3);
  p = p * t + Real(-0x1.27535ep+3);
  return p * t + Real(-0x1.6f5184p-2);
}

// e^log for a logarithm below 4.
template <class Real>
EVS_ALWAYS_INLINE Real from_log(Real log) {
  const float below = static_cast<float>(Real(4) - log);
  const ExpParts parts = exp_parts(select(below < kSettled, below, kSettled));
  return static_cast<Real>(0x1.b4c902p+5f * exp_minus(parts));
}

// By how much the faster pole moves a level away, deviations. In: `ratio`, the slower pole over the
// faster. A fit to simulated first passages; the rates agree within 5 %.
template <class Real>
EVS_ALWAYS_INLINE Real level_shift(Real ratio) {
  return Real(1.43) * std::sqrt(ratio / (Real(1) + Real(0.39) * ratio));
}

// Rate of first passages at a level x, in units of the slower pole.
template <class Real>
EVS_ALWAYS_INLINE Real passage_rate(Real shift, Real x) {
  const Real positive = select(x > Real(0), x, Real(0));
  const Real level = x + shift / (Real(1) + Real(0.23) * positive * shift);
  const Real near = select(level < Real(7), level, Real(7));
  const Real rate = from_log(log_passage_rate(near * Real(0.125)));
  return select(x < Real(kFarLevel), rate, Real(0));
}

template <class Real>
EVS_ALWAYS_INLINE Real passage_loss(Real x) {
  const Real loss = from_log(log_passage_loss(x * Real(0.125)));
  return select(x < Real(kFarLevel), loss, Real(0));
}

// Rate and loss between -8 and 8 deviations, from which single pixels read them.
struct PassageTable {
  static constexpr int kCells = 512;
  float rate[kCells + 1];
  float loss[kCells + 1];

  PassageTable() {
    for (int k = 0; k <= kCells; k++) {
      const float x = static_cast<float>(k) * (16.0f / kCells) - 8.0f;
      rate[k] = passage_rate(0.0f, x);
      loss[k] = passage_loss(x);
    }
  }

  // Linear between two entries; |x| <= 8.
  static double read(const float* entries, double x) {
    const double place = (x + 8.0) * (kCells / 16.0);
    const int cell = std::min(static_cast<int>(place), kCells - 1);
    const double low = entries[cell], high = entries[cell + 1];
    return low + (place - cell) * (high - low);
  }

  double rate_at(double shift, double x) const {
    if (!(x < kFarLevel)) return 0.0;
    const double level = x > 0.0 ? x + shift / (1.0 + 0.23 * x * shift) : x + shift;
    return level < kFarLevel ? read(rate, level) : 0.0;
  }
  double loss_at(double x) const { return x < kFarLevel ? read(loss, x) : 0.0; }

  // Deviations at which the loss has a value.
  double level_of_loss(double value) const {
    int low = 0, high = kCells;  // the loss falls
    while (high - low > 1) {
      const int half = (low + high) / 2;
      (loss[half] > value ? low : high) = half;
    }
    const double above = loss[low], below = loss[high];
    return (low + (above - value) / (above - below)) * (16.0 / kCells) - 8.0;
  }
};

inline const PassageTable kPassageTable;

// A distance from the mean in deviations, limited to the table.
template <class Real>
EVS_ALWAYS_INLINE Real in_deviations(Real distance, Real deviation) {
  const Real x = distance / (deviation + Real(1e-12));
  const Real above = select(x > Real(-8), x, Real(-8));
  return select(above < Real(8), above, Real(8));
}

template <class Real>
EVS_ALWAYS_INLINE Real unknown_share(Real memory) {
  return std::sqrt((Real(1) - memory) * (Real(1) + memory));
}

// The noise at one light.
struct NoiseBand {
  double sigma;  // log units
  double decay;  // w, 1 / us
  double slow;   // slower pole, 1 / us
  double shift;  // level_shift
};

// In: the poles of photoreceptor and follower, 1 / us; 0: there is none.
inline NoiseBand noise_band(double photoreceptor, double follower, double scale, double dn) {
  NoiseBand band;
  if (photoreceptor > 0.0 && follower > 0.0) {
    band.slow = photoreceptor < follower ? photoreceptor : follower;
    const double fast = photoreceptor < follower ? follower : photoreceptor;
    band.decay = photoreceptor * follower / (photoreceptor + follower);
    band.shift = level_shift(band.slow / fast);
  } else {
    band.slow = photoreceptor > 0.0 ? photoreceptor : follower;
    band.decay = band.slow;
    band.shift = 0.0;
  }
  band.sigma = std::sqrt(scale * band.decay / dn);
  return band;
}

// The random numbers of a pixel: four for each event, by its time and its place among the events of
// one us.
struct NoiseDraws {
  uint64_t key;
  int64_t last_us = -1;
  uint64_t repeat = 0;

  // The budget after an event at this time, and the counter of its other numbers.
  double renew(int64_t us) {
    repeat = us == last_us ? (repeat < 63 ? repeat + 1 : 63) : 0;
    last_us = us;
    const double drawn = on_budget_grid(std::min(exponential(hash(key, counter(us))), 28.0));
    return drawn > 0.0 ? drawn : 0x1p-46;
  }
  double standard_normal(int64_t us) const { return normal(key, counter(us)); }
  double polarity(int64_t us) const { return uniform(hash(key, counter(us) + 3)); }

 private:
  uint64_t counter(int64_t us) const {
    return static_cast<uint64_t>(us) << 8 | (us == last_us ? repeat << 2 : 0);
  }
};

// One pixel whose signal stands still and whose noise has no memory: its hazard from one us to
// another, in exact steps, so that it does not depend on how time is divided. The leak moves the ON
// level; the hazard is that of the middle of a cell of 2^exponent us, in which it moves little.
struct StillNoise {
  NoiseBand band;
  double signal;
  double theta_on;
  double theta_off;
  double leak;       // log units per us
  double reference;  // at from_us
  int64_t from_us;
  int exponent = 20;

  StillNoise(const NoiseBand& at_light, double s, double on, double off, double leak_us, double r,
             int64_t begin_us)
      : band(at_light),
        signal(s),
        theta_on(on),
        theta_off(off),
        leak(leak_us),
        reference(r),
        from_us(begin_us) {
    if (leak > 0.0) {
      int power;
      std::frexp(0.25 * band.sigma / leak, &power);
      exponent = std::clamp(power - 1, 0, 20);
    }
  }

  double reference_at(double us) const {
    return reference - leak * (us - static_cast<double>(from_us));
  }
  double on_level(double us) const {
    return in_deviations(reference_at(us) + theta_on - signal, band.sigma);
  }
  double off_level(double us) const {
    return in_deviations(signal - (reference_at(us) - theta_off), band.sigma);
  }
  double on_rate(double us) const {
    return band.slow * kPassageTable.rate_at(band.shift, on_level(us));
  }
  double off_rate(double us) const {
    return band.slow * kPassageTable.rate_at(band.shift, off_level(us));
  }
  double loss(int64_t us) const {
    if (leak == 0.0) return 0.0;
    return on_budget_grid(kPassageTable.loss_at(on_level(static_cast<double>(us))));
  }

  // Whether no level is near up to `to_us`.
  bool far(int64_t to_us) const {
    constexpr double kMargin = kFarLevel + 0.5;
    return on_level(static_cast<double>(to_us)) > kMargin &&
           off_level(static_cast<double>(from_us)) > kMargin;
  }

  // A bound of the hazard up to `to_us`.
  double bound(int64_t to_us) const {
    const double on = std::max(on_level(static_cast<double>(to_us)) - 0.5, -8.0);
    const double off = std::max(off_level(static_cast<double>(from_us)) - 0.5, -8.0);
    const double rate =
        kPassageTable.rate_at(band.shift, on) + kPassageTable.rate_at(band.shift, off);
    return 1.01 * (band.slow * rate * static_cast<double>(to_us - from_us)) +
           kPassageTable.loss_at(on);
  }

  struct Outcome {
    bool fired;
    bool up;
    bool leaked;  // the leak, not the noise, did it
    int64_t us;
  };

  // Use up the budget from from_us to `to_us`.
  Outcome run(int64_t to_us, double& budget, const NoiseDraws& draws) const {
    if (far(to_us)) return {false, false, false, to_us};
    double before = loss(from_us);
    for (int64_t t = from_us; t < to_us;) {
      const int64_t cell = t >> exponent;
      const int64_t end = std::min((cell + 1) << exponent, to_us);
      const double middle =
          (static_cast<double>(cell) + 0.5) * static_cast<double>(int64_t{1} << exponent);
      const double rate = on_budget_grid(std::min(on_rate(middle) + off_rate(middle), 1.0));
      auto hazard = [&](int64_t us) {
        return rate * static_cast<double>(us - t) + (loss(us) - before);
      };
      const double after = hazard(end);
      if (after < budget) {
        budget -= after;
        before = loss(end);
        t = end;
        continue;
      }
      // the first us whose hazard reaches the budget
      int64_t low = t, high = end;
      while (high - low > 1) {
        const int64_t half = low + (high - low) / 2;
        (hazard(half) < budget ? low : high) = half;
      }
      const double leaked = loss(high) - loss(high - 1);
      const double on = on_rate(middle);
      const double all = on + off_rate(middle) + leaked;
      const bool up = draws.polarity(high) * all < on + leaked;
      return {true, up, leaked > on, high};
    }
    return {false, false, false, to_us};
  }
};

}  // namespace evs
