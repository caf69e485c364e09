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

#include "sensor/lowpass.h"
#include "sensor/random.h"

namespace evs {

inline constexpr uint64_t TERM_PHOTON_NOISE = 10;

inline constexpr float FAR_LEVEL = 6.0f;       // deviations; a level beyond is not reached
inline constexpr double PASSED = -7.0;         // a level beyond was passed for certain
inline constexpr double NEAREST = -3.0;        // the fits of rate and slope begin here
inline constexpr double CERTAIN = 30.0;        // no budget is larger
inline constexpr float FORGOTTEN = 0x1p-10f;   // a smaller memory counts as none
inline constexpr double KNOWN = 0.1;           // a smaller memory moves levels little
inline constexpr double SHORT_STEP = 0.25;     // of the time in which memory is lost
inline constexpr double LONG_STEP = 20.0;      // of the same; longer steps are cut
inline constexpr double FORGETS = 7.0;         // of the same, in which all memory is lost
inline constexpr double STRAIGHT_PART = 0.1;   // of the noise; a line that sags by less is straight
inline constexpr float COARSE_PARTS = 50.0f;   // of the budget; steps with more than one are short
inline constexpr float BEYOND_BUDGETS = 1e6f;  // hazard
inline constexpr double LEAST_BUDGET = 0x1p-46;

struct PhotonNoise {
  uint64_t key = 0;
  double scale = 0.0;  // sigma^2 DN / w, us; 0: no noise
};

// Round to a multiple of 2^-46, |value| < 32.
EVS_ALWAYS_INLINE double on_budget_grid(double value) { return (value + 96.0) - 96.0; }

// What is left of a budget that lasts for a hazard; never nothing.
EVS_ALWAYS_INLINE double budget_left(double budget, double hazard) {
  const double left = budget - on_budget_grid(hazard);
  return select(left > 0.0, left, LEAST_BUDGET);
}

// 2^log, relative error 4e-6, for -62 < log < 63.
template <class Real>
EVS_ALWAYS_INLINE Real exp2_of_fit(Real log) {
  const float above = static_cast<float>(log) + 64.0f;
  const int32_t whole = static_cast<int32_t>(above);
  const float f = (above - static_cast<float>(whole)) - 0.5f;
  float p = 0x1.c0d85ep-7f;
  p = p * f + 0x1.43ef6ap-4f;
  p = p * f + 0x1.5bdfb0p-2f;
  p = p * f + 0x1.f5df8cp-1f;
  p = p * f + 0x1.6a09eap+0f;
  return static_cast<Real>(std::bit_cast<float>((whole + (127 - 64)) << 23) * p);
}

// Rate of first passages of a process with one pole at a level x, -3 <= x <= 7, in units of the
// pole: the lowest eigenvalue of f'' - x f' = -rate f below the level, where f = 0. The fit has an
// error of 0.6 %.
template <class Real>
EVS_ALWAYS_INLINE Real one_pole_rate(Real x) {
  Real p = Real(-0x1.d0e916p-16);
  p = p * x + Real(0x1.7393aap-12);
  p = p * x + Real(-0x1.1074b2p-14);
  p = p * x + Real(-0x1.4b5c98p-7);
  p = p * x + Real(-0x1.1341bep-5);
  p = p * x + Real(-0x1.484658p-3);
  p = p * x + Real(-0x1.25b848p+0);
  return exp2_of_fit(p * x + Real(-0x1.1ba916p-7));
}

// By how much the loss falls with x, phi / Phi, -3 <= x <= 7. The fit has an error of 0.9 %.
template <class Real>
EVS_ALWAYS_INLINE Real loss_slope(Real x) {
  Real p = Real(-0x1.302b28p-14);
  p = p * x + Real(0x1.36e814p-10);
  p = p * x + Real(-0x1.204538p-9);
  p = p * x + Real(-0x1.f1d488p-5);
  p = p * x + Real(-0x1.1d8b7cp-2);
  p = p * x + Real(-0x1.22aef2p+0);
  return exp2_of_fit(p * x + Real(-0x1.43b014p-2));
}

// loss = -ln Phi at x deviations, |x| <= 8. The fit has an error of 0.8 % above -3.
inline float passage_loss(float x) {
  const float t = 0.125f * x;
  float p = -0x1.3bd722p+1f;
  p = p * t + -0x1.0ffc32p+2f;
  p = p * t + 0x1.6cd316p+2f;
  p = p * t + 0x1.4ae1dp+3f;
  p = p * t + -0x1.4366ap+2f;
  p = p * t + -0x1.03d2a6p+4f;
  p = p * t + -0x1.b3b8aep+3f;
  p = p * t + -0x1.27535ep+3f;
  p = p * t + -0x1.6f5184p-2f;
  // e^p
  const float below = 4.0f - p;
  const float loss = 0x1.b4c902p+5f * exp_minus(exp_parts(below < SETTLED ? below : SETTLED));
  return x < FAR_LEVEL ? loss : 0.0f;
}

// By how much the faster pole moves a level away, deviations. A fit to simulated first passages;
// the rates agree within 5 %.
template <class Real>
EVS_ALWAYS_INLINE Real level_shift(Real slower, Real faster) {
  return Real(1.43) * std::sqrt(slower / (faster + Real(0.39) * slower));
}

// x as seen by a process with one pole.
template <class Real>
EVS_ALWAYS_INLINE Real shifted_level(Real shift, Real x) {
  const Real positive = select(x > Real(0), x, Real(0));
  return x + shift / (Real(1) + Real(0.23) * positive * shift);
}

// Mean over a straight way of a hazard that is 1 at its end nearest to the mean of the noise, x,
// where loss_slope is `slope`, `length` deviations long. Its logarithm falls by x + slope, the
// more the farther; error below 4 % of that of loss_slope above 0, and 11 % of the rate.
template <class Real>
EVS_ALWAYS_INLINE Real mean_over_way(Real x, Real slope, Real length) {
  const Real fall = x + slope;
  const Real straight = fall * length;
  const Real bent = (Real(1) - slope * fall) * length * length;
  // q = n / d, and (1 - e^-q) / q within 2.4 %
  const Real d = Real(3) + straight;
  const Real n = straight * d + bent;
  const Real square = n * n;
  const Real part = d * (Real(12) * d + Real(3) * n) + Real(0.5) * square;
  return d * part / ((d + Real(0.5) * n) * part + square * (d + Real(0.25) * n));
}

// Rate, slope and loss between -8 and 8 deviations, from which single pixels read them.
struct PassageTable {
  static constexpr int CELLS = 512;
  static constexpr int STARTS = 1024;
  float rate[CELLS + 1];
  float slope[CELLS + 1];
  float loss[CELLS + 1];
  uint16_t starts[STARTS];  // cell of a loss, by its leading bits, or one before

  PassageTable() { fill(); }

  void fill() {
    for (int k = 0; k <= CELLS; k++) {
      const float x = static_cast<float>(k) * (16.0f / CELLS) - 8.0f;
      const float within = std::clamp(x, -3.0f, 7.0f);
      rate[k] = one_pole_rate(within);
      slope[k] = loss_slope(within);
      loss[k] = passage_loss(x);
    }
    int cell = 0;
    for (int k = STARTS - 1; k >= 0; k--) {
      const float largest =
          std::bit_cast<float>((static_cast<uint32_t>(k) + 1 + FIRST_START) << START_BITS);
      while (cell + 1 < CELLS && loss[cell + 1] > largest) cell++;
      starts[k] = static_cast<uint16_t>(cell);
    }
  }

  // Linear between two entries; |x| <= 8.
  EVS_ALWAYS_INLINE static double read(const float* entries, double x) {
    const double place = (x + 8.0) * (CELLS / 16.0);
    const int found = static_cast<int>(place);
    const int cell = found < CELLS - 1 ? found : CELLS - 1;
    const double low = entries[cell], high = entries[cell + 1];
    return low + (place - cell) * (high - low);
  }

  // Without branches, so that loops over them vectorise; x < FAR_LEVEL.
  EVS_ALWAYS_INLINE double rate_near(double shift, double x) const {
    const double level = shifted_level(shift, x);
    const bool near = level < FAR_LEVEL;
    return select(near, read(rate, select(near, level, double{FAR_LEVEL})), 0.0);
  }
  double rate_at(double shift, double x) const { return x < FAR_LEVEL ? rate_near(shift, x) : 0.0; }
  EVS_ALWAYS_INLINE double slope_at(double x) const { return read(slope, x); }
  EVS_ALWAYS_INLINE double loss_at(double x) const {
    const bool near = x < FAR_LEVEL;
    return select(near, read(loss, select(near, x, double{FAR_LEVEL})), 0.0);
  }

  // Deviations at which the loss has a value.
  double level_of_loss(double value) const {
    const uint32_t bits = std::bit_cast<uint32_t>(static_cast<float>(value)) >> START_BITS;
    const uint32_t start = bits > FIRST_START ? bits - FIRST_START : 0;
    int low = starts[start < STARTS ? start : STARTS - 1];
    while (low + 1 < CELLS && loss[low + 1] > value) low++;  // the loss falls
    const double above = loss[low], below = loss[low + 1];
    return (low + (above - value) / (above - below)) * (16.0 / CELLS) - 8.0;
  }

 private:
  static constexpr int START_BITS = 19;                       // 16 starts an octave
  static constexpr uint32_t FIRST_START = (127u - 58u) << 4;  // of 2^-58
};

#ifdef EVS_ON_DEVICE
// a device runs no constructors: its kernel `prepare` fills the table
alignas(PassageTable) __device__ char PASSAGE_TABLE_MEMORY[sizeof(PassageTable)];
#define PASSAGE_TABLE (*reinterpret_cast<const PassageTable*>(PASSAGE_TABLE_MEMORY))
#else
inline const PassageTable PASSAGE_TABLE;
#endif

// Deviations, limited on both sides. A NaN, of a pixel without a threshold, counts as the farthest.
template <class Real>
EVS_ALWAYS_INLINE Real in_deviations(Real x, Real farthest) {
  const Real below = select(x < farthest, x, farthest);
  return select(below > Real(-8), below, Real(-8));
}

// Where a level comes from, at most, deviations. One of noise that is known comes from beyond any
// bound, in no time.
template <class Real>
EVS_ALWAYS_INLINE Real farthest_level(Real memory) {
  return select(memory > Real(0), Real(8), Real(1e4));
}

template <class Real>
EVS_ALWAYS_INLINE Real unknown_share(Real memory) {
  return std::sqrt((Real(1) - memory) * (Real(1) + memory));
}

// What is known of the noise.
struct NoiseMemory {
  double memory;
  double mean;  // log units
};

// The same so many us later.
EVS_ALWAYS_INLINE NoiseMemory forget(NoiseMemory known, double decay, double us) {
  const double kept = 1.0 - static_cast<double>(lowpass_a(static_cast<float>(decay * us)));
  const double memory = known.memory * kept;
  const bool forgotten = memory < FORGOTTEN;
  return {select(forgotten, 0.0, memory), select(forgotten, 0.0, known.mean * kept)};
}

// The noise at one light.
struct NoiseBand {
  double sigma;  // log units
  double decay;  // w, 1 / us
  double slow;   // slower pole, 1 / us
  double shift;  // level_shift
};

// A level in a step of time, and the hazard that it is reached.
struct NoiseLevel {
  double x0, x1;  // deviations from the mean of the noise
  double random = 0.0;
  double moving = 0.0;  // because the level moves
  double hazard() const { return random + moving; }
};

struct NoiseStep {
  double memory1, mean1, signal1;  // at the end
  double passages;                 // of a rate of 1
  NoiseLevel on, off;
};

// In: the poles of photoreceptor and follower, 1 / us; 0: there is none.
EVS_ALWAYS_INLINE NoiseBand noise_band(double photoreceptor, double follower, double scale,
                                       double dn) {
  const bool both = (photoreceptor > 0.0) & (follower > 0.0);
  const double slower = select(photoreceptor < follower, photoreceptor, follower);
  const double faster = select(photoreceptor < follower, follower, photoreceptor);
  const double slow = select(both, slower, faster);
  const double decay = photoreceptor * follower / (photoreceptor + follower);
  NoiseBand band;
  band.slow = slow;
  band.decay = select(both, decay, slow);
  band.shift = select(both, level_shift(slower, faster), 0.0);
  band.sigma = std::sqrt(scale * band.decay / dn);
  return band;
}

// The random numbers of a pixel: three for each event, by its time and its place among the events
// of one us. Single precision suffices: 2^-24 of the budgets are below 6e-8 or beyond 16.6, and as
// few normal numbers beyond 5.8 deviations.
struct NoiseDraws {
  uint64_t key;
  int64_t last_us = -1;
  uint64_t repeat = 0;

  // The budget after an event at this time.
  double renew(int64_t us) { return budget_of(hash(key, next_budget(us))); }
  double standard_normal(int64_t us) const { return normal_of(hash(key, normal_at(us))); }
  double polarity(int64_t us) const { return uniform(hash(key, counter(us) + 2)); }

  // The counter of the budget after an event at this time, which those of its other numbers follow.
  uint64_t next_budget(int64_t us) {
    repeat = us == last_us ? (repeat < 63 ? repeat + 1 : 63) : 0;
    last_us = us;
    return counter(us);
  }
  uint64_t normal_at(int64_t us) const { return counter(us) + 1; }

  EVS_ALWAYS_INLINE static double budget_of(uint64_t bits) {
    const double drawn = on_budget_grid(static_cast<double>(minus_ln(bits)));
    return select(drawn > 0.0, drawn, LEAST_BUDGET);
  }
  // By Box and Muller (1958), from the two halves of one random number.
  EVS_ALWAYS_INLINE static double normal_of(uint64_t bits) {
    const float turn = static_cast<float>(static_cast<int32_t>(bits & 0xffffffffu)) * 0x1p-32f;
    const float up = 0.25f - std::abs(turn);  // cos of the turn is the sine of this
    const float square = up * up;
    float p = -0x1.1e752p+6f;
    p = p * square + 0x1.45a272p+6f;
    p = p * square + -0x1.4ab6cep+5f;
    p = p * square + 0x1.921fa2p+2f;
    return static_cast<double>(std::sqrt(2.0f * minus_ln(bits)) * (p * up));
  }

 private:
  EVS_ALWAYS_INLINE static float minus_ln(uint64_t bits) {
    const uint32_t high = static_cast<uint32_t>(bits >> 40);
    const float drawn = ln(static_cast<float>(static_cast<int32_t>(high + 1)) * 0x1p-24f);
    return select(drawn < 0.0f, -drawn, 0.0f);
  }
  uint64_t counter(int64_t us) const {
    return static_cast<uint64_t>(us) << 8 | (us == last_us ? repeat << 2 : 0);
  }
};

// The rate of first passages of a still pixel, and the loss of an ON level that its leak moves, as
// its budget counts them. In: the levels, deviations.
inline double still_rate(double slow, double shift, double on, double off) {
  const double both =
      slow * PASSAGE_TABLE.rate_at(shift, on) + slow * PASSAGE_TABLE.rate_at(shift, off);
  return on_budget_grid(std::min(both, 1.0));
}
inline double still_loss(double leak, double on) {
  return leak == 0.0 ? 0.0 : on_budget_grid(PASSAGE_TABLE.loss_at(on));
}

// One pixel whose signal stands still and whose noise has no memory: its hazard from one us to
// another, in exact steps, so that it does not depend on how time is divided. The leak moves the ON
// level; the hazard is that of the middle of a cell of time, in which it moves little.
struct StillNoise {
  NoiseBand band;
  double signal;
  double theta_on;
  double theta_off;
  double leak;       // log units per us
  double reference;  // at from_us
  double from_us;
  double cell_us;  // a power of 2

  EVS_ALWAYS_INLINE StillNoise(const NoiseBand& at_light, double s, double on, double off,
                               double leak_us, double r, int64_t begin_us)
      : band(at_light),
        signal(s),
        theta_on(on),
        theta_off(off),
        leak(leak_us),
        reference(r),
        from_us(static_cast<double>(begin_us)) {
    constexpr double LONGEST_CELL = 0x1p20;
    constexpr uint64_t INFINITE = 0x7ffull << 52;
    // the mantissa is cut off
    const double moves = 0.25 * band.sigma / leak;
    const double power = std::bit_cast<double>(std::bit_cast<uint64_t>(moves) & INFINITE);
    const double limited = select(power < LONGEST_CELL, power, LONGEST_CELL);
    const bool is_short = (power < 1.0) | (power == std::bit_cast<double>(INFINITE));
    cell_us = select(leak > 0.0, select(is_short, 1.0, limited), LONGEST_CELL);
  }

  EVS_ALWAYS_INLINE double reference_at(double us) const {
    return reference - leak * (us - from_us);
  }
  EVS_ALWAYS_INLINE double deviations(double distance) const {
    return in_deviations(distance / (band.sigma + 1e-12), 8.0);
  }
  EVS_ALWAYS_INLINE double on_level(double us) const {
    return deviations(reference_at(us) + theta_on - signal);
  }
  EVS_ALWAYS_INLINE double off_level(double us) const {
    return deviations(signal - (reference_at(us) - theta_off));
  }
  // Where the cell begins in which a time is.
  EVS_ALWAYS_INLINE double cell_at(double us) const {
    const double cells = us / cell_us;
    const double near = (cells + 0x1p52) - 0x1p52;
    return select(near > cells, near - 1.0, near) * cell_us;
  }

  double rate_at(double level) const {
    return band.slow * PASSAGE_TABLE.rate_at(band.shift, level);
  }

  // Whether no level is near up to `to_us`.
  bool far(double to_us) const {
    constexpr double MARGIN = FAR_LEVEL + 0.5;
    return on_level(to_us) > MARGIN && off_level(from_us) > MARGIN;
  }

  // A bound of the hazard up to `to_us`.
  double bound(double to_us) const {
    const double on = std::max(on_level(to_us) - 0.5, -8.0);
    const double off = std::max(off_level(from_us) - 0.5, -8.0);
    const double rate =
        PASSAGE_TABLE.rate_at(band.shift, on) + PASSAGE_TABLE.rate_at(band.shift, off);
    return 1.01 * (band.slow * rate * (to_us - from_us)) + PASSAGE_TABLE.loss_at(on);
  }

  struct Outcome {
    bool fired;
    bool up;
    bool leaked;  // the leak, not the noise, did it
    int64_t us;
  };

  // Use up the budget from from_us to `to_us`.
  Outcome run(int64_t to_us, double& budget, const NoiseDraws& draws) const {
    if (far(static_cast<double>(to_us))) return {false, false, false, to_us};
    const int64_t length = static_cast<int64_t>(cell_us);
    const int64_t begin_us = static_cast<int64_t>(from_us);
    auto loss = [&](int64_t us) { return still_loss(leak, on_level(static_cast<double>(us))); };
    double before = loss(begin_us);
    for (int64_t t = begin_us; t < to_us;) {
      const int64_t cell = t & -length;
      const int64_t end = std::min(cell + length, to_us);
      const double middle = static_cast<double>(cell) + 0.5 * cell_us;
      const double rate = still_rate(band.slow, band.shift, on_level(middle), off_level(middle));
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
      const double on = rate_at(on_level(middle));
      const double all = on + rate_at(off_level(middle)) + leaked;
      const bool up = draws.polarity(high) * all < on + leaked;
      return {true, up, leaked > on, high};
    }
    return {false, false, false, to_us};
  }
};

}  // namespace evs
