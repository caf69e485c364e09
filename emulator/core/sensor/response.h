// The signal of a pixel inside a tick: what its poles make of light that is a line.
//
// With u the share of the tick that has passed, the signal has moved by
//   y(u) = slope u + first (1 - e^-ku) + second (1 - e^-zu),
// where k is the rate of the photoreceptor and z that of the source follower, in units of 1 / tick,
// and `slope` includes the drift of the reference. It is exact for poles; a large-signal
// photoreceptor approaches its light at the rate that it has at the start of the tick. y(1) is what
// the filters have at the end of the tick. Without poles, in v2e's Euler step, and where it bends
// by less than a quarter of a us, it is a line.
#pragma once

#include <algorithm>
#include <cmath>
#include <cstdint>

#include "sensor/lowpass.h"

namespace evs {

struct Response {
  double end = 0.0;    // y(1)
  double slope = 0.0;  // log units
  double first = 0.0;
  double second = 0.0;
  float k = 0.0f;
  float z = 0.0f;
  double settling = 0.0;  // time constants, shares of the tick
  bool bends = false;

  // A line that moves by `span`.
  static Response line(double span) { return {span, span}; }

  // What the signal has moved by, and its first two derivatives.
  struct Point {
    double y, rise, bend;
  };
  // BRANCHES: for one pixel; without them loops over pixels vectorise.
  template <bool BRANCHES>
  EVS_ALWAYS_INLINE Point at(double u) const {
    const double a = share<BRANCHES>(k * static_cast<float>(u));
    const double b = share<BRANCHES>(z * static_cast<float>(u));
    const double fast = first * (k * (1.0 - a));
    const double slow = second * (z * (1.0 - b));
    return {slope * u + (first * a + second * b), slope + (fast + slow), -(k * fast + z * slow)};
  }
  double moved(double u) const { return !bends || u >= 1.0 ? end * u : bent<true>(u); }
  // The same where it bends inside the tick. BRANCHES: as of `at`.
  template <bool BRANCHES>
  EVS_ALWAYS_INLINE double bent(double u) const {
    const double a = share<BRANCHES>(k * static_cast<float>(u));
    const double b = share<BRANCHES>(z * static_cast<float>(u));
    return slope * u + (first * a + second * b);
  }

  template <bool BRANCHES>
  EVS_ALWAYS_INLINE static float share(float rate) {
    return BRANCHES ? lowpass_share(rate) : lowpass_a(rate);
  }
};

// Give up the bends of a response if they move no stamp by more than a quarter of a us.
EVS_ALWAYS_INLINE Response straighten(Response response, double tick) {
  auto bend_of = [](double amplitude, double rate) {
    const double most = 0.125 * rate * rate;
    return std::abs(amplitude) * (most < 1.0 ? most : 1.0);
  };
  const double most = bend_of(response.first, response.k) + bend_of(response.second, response.z);
  response.bends = most * tick > 0.25 * std::abs(response.end);
  return response;
}

// Searches the share of the tick, in [from, 1], at which the signal has moved by `level` log units;
// at `from` it has moved by `begin`. It is between `from` and the end of the tick, where the signal
// has passed the level upwards or downwards (`up`). Halley's method, to an estimated tenth of a us,
// and bisection to a us where that fails.
struct ShareSearch {
  static constexpr int HALLEY = 6, MOST = 40;  // steps
  double u, low, high;
  bool found;

  // BRANCHES: for one search; without them loops over searches vectorise.
  template <bool BRANCHES>
  EVS_ALWAYS_INLINE static ShareSearch start(const Response& response, double level, bool up,
                                             double from, double begin) {
    auto choose = [](bool first, auto&& one, auto&& other) {
      if constexpr (BRANCHES) return first ? one() : other();
      return select(first, one(), other());
    };
    const double sign = up ? 1.0 : -1.0;
    const double left = sign * (level - begin);
    const double total = sign * (response.end - begin);
    const bool ahead = left > 0.0;
    const bool within = ahead & (left < total);
    auto line = [&] { return from + (1.0 - from) * (left / total); };
    // at the start of the tick the first guess has the slope there and the value at the end: a
    // hyperbola if the signal gets slower, else a parabola
    auto curve = [&] {
      const double steep =
          sign * (response.slope + (response.first * response.k + response.second * response.z));
      const double rest = total - steep;
      auto hyperbola = [&] { return left * total / (steep * (total - left) + left * total); };
      auto parabola = [&] {
        return 2.0 * left / (steep + std::sqrt(steep * steep + 4.0 * rest * left));
      };
      const double guess = choose(rest <= 0.0, hyperbola, parabola);
      // a start from rest is over soon
      const double soon = 1.5 * response.settling;
      return guess < soon ? guess : soon;
    };
    auto guess = [&] { return choose(from == 0.0, curve, line); };
    auto bound = [&] { return ahead ? 1.0 : from; };
    return {choose(within, guess, bound), from, 1.0, !within};
  }

  // One step. BRANCHES: as of `start`. `halley`: not by bisection, if that is possible.
  template <bool BRANCHES>
  EVS_ALWAYS_INLINE void step(const Response& response, double level, bool up, double tick,
                              bool halley) {
    const double sign = up ? 1.0 : -1.0;
    const Response::Point point = response.at<BRANCHES>(u);
    const double beyond = sign * (point.y - level);
    if constexpr (BRANCHES) {
      (beyond < 0.0 ? low : high) = u;
    } else {
      low = select(beyond < 0.0, u, low);
      high = select(beyond < 0.0, high, u);
    }
    const double rise = sign * point.rise;
    const double curve = beyond * (sign * point.bend);
    const double square = rise * rise;
    const double next = u - 2.0 * beyond * rise / (2.0 * square - curve);
    const bool inside = halley & (next > low) & (next < high);
    const double middle = 0.5 * (low + high);
    const double chosen = BRANCHES ? (inside ? next : middle) : select(inside, next, middle);
    const double moves = std::abs(chosen - u) * tick;
    u = chosen;
    // what is left of a step of Halley's is about the cube of its share of the bend's scale
    const double scale = curve / square;
    const bool settled = moves * (scale * scale) < 0.1;
    found = BRANCHES ? moves < 1.0 || (inside && settled) : (moves < 1.0) | (inside & settled);
  }
};

EVS_CALL_ON_DEVICE inline double share_at(const Response& response, double level, bool up,
                                          double from, double begin, double tick) {
  ShareSearch search = ShareSearch::start<true>(response, level, up, from, begin);
  for (int i = 0; i < ShareSearch::MOST && !search.found; i++)
    search.step<true>(response, level, up, tick, i < ShareSearch::HALLEY);
  return search.u;
}

// Microseconds after the start of the tick at which the signal has moved by `level`, rounded up;
// in [now, tick]. It has moved by `begin` now.
EVS_ALWAYS_INLINE uint32_t reach_time(const Response& response, double level, bool up, uint32_t now,
                                      double begin, uint32_t tick_us) {
  const double tick = tick_us;
  const double exact = share_at(response, level, up, now / tick, begin, tick) * tick;
  const double late = exact > 1.0 ? exact : 1.0;
  const double inside = late < tick ? late : tick;
  const uint32_t whole = static_cast<uint32_t>(static_cast<int32_t>(inside));
  const uint32_t stamp = whole + (static_cast<double>(whole) < inside ? 1u : 0u);
  return stamp > now ? stamp : now;
}

}  // namespace evs
