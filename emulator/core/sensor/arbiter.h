// The asynchronous row arbiter of a DAVIS (word-serial address events: Boahen, IEEE TCAS-II 47(5),
// 2000; Brandli et al., JSSC 49(10), 2014).
//
// A pixel with an event requests its row. When the arbiter is free, it grants the next requesting
// row after the one it served last, so that none starves (real arbiter trees are fair on average
// only). A row access takes row_ns, with a jitter of jitter_ns. Then the events of the row are
// latched and stamped with that time: as in a DAVIS, all events of a row access share one stamp.
// They are sent column by column, from the left or the right as the access number draws, and each
// keeps the arbiter busy for column_ns. A waiting pixel holds one event; others until the latch are
// lost ("busy").
//
// The stamps of pixels are whole us. A request comes up to phase_ns before its stamp, evenly
// spread, so that events of one us do not come in the order of their rows, and rows may share one.
#pragma once

#include <bit>
#include <cmath>
#include <cstddef>
#include <cstdint>
#include <limits>
#include <vector>

#include "base/isa.h"
#include "sensor/pixel_latches.h"
#include "sensor/random.h"
#include "sensor/readout_state.h"

namespace evs {

// Durations of the row accesses of the arbiter. Each depends on the seed and the number of the
// access alone, so they are drawn in batches: one by one they would take half of the readout's
// time.

struct ArbiterTimes {
  int64_t row_ns = 0;
  int64_t column_ns = 0;
  double jitter_ns = 0;  // standard deviation of the row access
  int64_t phase_ns = 0;  // at most 999
};

// A duration is a whole number of ns, so a normal number within ERROR settles nearly all. `normal`
// draws the others.
class RowAccessTimes {
 public:
  // Duration of access number `access`. In: key, from the seed and the term.
  int64_t duration_ns(const ArbiterTimes& times, uint64_t key, int64_t access) {
    if (!(times.jitter_ns > 0)) return times.row_ns;
    const uint64_t number = static_cast<uint64_t>(access);
    if (!drawn_ || key != key_ || number - first_ >= BATCH) {
      draw_(times, key, number, ns_);
      drawn_ = true;
      key_ = key;
      first_ = number;
    }
    int64_t& ns = ns_[number - first_];
    if (ns == UNSETTLED) {
      ns = round_ns(static_cast<double>(times.row_ns) + times.jitter_ns * normal(key, number << 1));
    }
    return ns;
  }

 private:
  static constexpr size_t BATCH = 64;
  static constexpr int64_t UNSETTLED = -1;
  // The normal numbers of `draw` are within 6e-8 of those of `normal`: an error of 8e-10 of the
  // logarithm is 5.7e-8 of its root at LOG_NEAREST, beyond which it grows, and an error of 6.4e-9
  // of the cosine is 5.5e-8 of the largest number. The rounding of the
  // sum with row_ns is below 1e-14 of it.
  static constexpr double ERROR = 1e-7;
  static constexpr double LOG_NEAREST = -1e-4;
  using Draw = void (*)(const ArbiterTimes&, uint64_t key, uint64_t first, int64_t* out);

  // ln_double with 5 terms of its series for 11: error below 8e-10.
  EVS_ALWAYS_INLINE static double ln_within(double value) {
    constexpr double ROOT = 0.70710678118654757;  // sqrt(1 / 2) as a double
    const uint64_t bits = std::bit_cast<uint64_t>(value);
    const int64_t exponent = static_cast<int64_t>(bits >> 52) - 1022;
    const double mantissa =
        std::bit_cast<double>((bits & 0xfffffffffffffull) | 0x3fe0000000000000ull);
    const double z = (mantissa - ROOT) / (mantissa + ROOT);
    const double square = z * z;
    double series = 0.0;
    for (int odd = 9; odd > 0; odd -= 2) series = series * square + 1.0 / odd;
    return 2.0 * z * series + (static_cast<double>(exponent) - 0.5) * 0.6931471805599453;
  }

  // cos_turn with 6 terms of its series for 9 and without divisions: error below 6.4e-9.
  EVS_ALWAYS_INLINE static double cos_turn_within(double turn) {
    const double half = std::fabs(turn - 0.5);
    const double folded = half < 0.5 - half ? half : 0.5 - half;
    const double angle = 6.283185307179586 * folded;
    const double square = angle * angle;
    // 1 / order! with the signs of the series
    double series = 1.0 / 479001600.0;
    series = series * square - 1.0 / 3628800.0;
    series = series * square + 1.0 / 40320.0;
    series = series * square - 1.0 / 720.0;
    series = series * square + 1.0 / 24.0;
    series = series * square - 0.5;
    return (half <= 0.25 ? -1.0 : 1.0) * (series * square + 1.0);
  }

  EVS_ALWAYS_INLINE static void draw(const ArbiterTimes& times, uint64_t key, uint64_t first,
                                     int64_t* out) {
    const double row_ns = static_cast<double>(times.row_ns);
    const double jitter_ns = times.jitter_ns;
    const double margin = ERROR * jitter_ns + 1e-14 * row_ns;
    for (size_t i = 0; i < BATCH; i++) {
      const uint64_t counter = (first + i) << 1;
      const double log = ln_within(uniform(hash(key, counter + 1)) + 0x1p-53);
      const double near = log < LOG_NEAREST ? log : LOG_NEAREST;
      const double turn = uniform(hash(key, counter + 2));
      const double ns = row_ns + jitter_ns * (std::sqrt(-2.0 * near) * cos_turn_within(turn)) + 0.5;
      // round_ns, if neither the error nor the logarithm may change the result
      const double whole = std::floor(ns);
      const double positive = whole > 0.0 ? whole : 0.0;
      const double rest = ns - whole;
      const double edge = rest < 1.0 - rest ? rest : 1.0 - rest;
      const double settled = edge > margin ? positive : static_cast<double>(UNSETTLED);
      out[i] = static_cast<int64_t>(log < LOG_NEAREST ? settled : static_cast<double>(UNSETTLED));
    }
  }
  static void draw_portable(const ArbiterTimes& times, uint64_t key, uint64_t first, int64_t* out) {
    draw(times, key, first, out);
  }
#if EVS_X86
  EVS_AVX512 static void draw_avx512(const ArbiterTimes& times, uint64_t key, uint64_t first,
                                     int64_t* out) {
    draw(times, key, first, out);
  }
#endif

  static Draw choose() {
#if EVS_X86
    // AVX2 has neither 64-bit products nor their conversion, so it would be no faster
    if (isa_available().front() == "avx512") return draw_avx512;
#endif
    return draw_portable;
  }

  Draw draw_ = choose();
  bool drawn_ = false;
  uint64_t key_ = 0;
  uint64_t first_ = 0;
  int64_t ns_[BATCH];
};

// In: requests [0, first) are latched already, [first, due) follow by time, all <= end_ns. Calls
// `stage.read` in order of time. Out: `latches` with the requests that were not read.
template <class Stage>
void run_arbiter(const ArbiterTimes& times, RowAccessTimes& access_times, const Request* requests,
                 size_t first, size_t due, int64_t end_ns, ReadoutClock& clock,
                 PixelLatches& latches, Stage& stage) {
  const uint64_t key = term_key(static_cast<uint64_t>(clock[CLOCK_SEED]), TERM_ARBITER);
  const uint64_t column_key = term_key(static_cast<uint64_t>(clock[CLOCK_SEED]), TERM_COLUMNS);
  size_t next = 0, held = 0;
  const auto request_next = [&] {
    const Event& event = requests[next].event;
    if (latches.set(event.x, event.y, static_cast<uint32_t>(next))) {
      held++;
    } else {
      clock[DROP_BUSY]++;
    }
    next++;
  };
  // when the next request comes; after the tick if there is none
  const auto next_ns = [&] {
    return next < due ? requests[next].ns : std::numeric_limits<int64_t>::max();
  };
  const auto request_until = [&](int64_t ns) {
    while (next_ns() <= ns) request_next();
  };
  while (next < first) request_next();

  // the state in local variables, which the compiler keeps in registers
  int64_t free_ns = clock[FREE_NS], last_row = clock[LAST_ROW], row = clock[ACCESS_ROW],
          latch_ns = clock[LATCH_NS], accesses = clock[ACCESSES];
  for (;;) {
    // grant the next requesting row
    if (row < 0) {
      int64_t now = free_ns;
      if (now > end_ns) break;
      request_until(now);
      if (held == 0) {
        // no row waits: jump to the next request
        if (next == due) break;
        now = requests[next].ns;
        const int64_t alone_ns = now + access_times.duration_ns(times, key, accesses);
        if (alone_ns <= end_ns && (next + 1 == due || requests[next + 1].ns > alone_ns)) {
          // no other comes before its latch
          const Event& event = requests[next].event;
          stage.read(alone_ns, event);
          next++;
          accesses++;
          latch_ns = alone_ns;
          free_ns = alone_ns + times.column_ns;
          last_row = event.y;
          continue;
        }
        request_until(now);
      }
      row = static_cast<int64_t>(latches.row_after(last_row));
      latch_ns = now + access_times.duration_ns(times, key, accesses);
      accesses++;
    }
    // latch the row and send its events
    if (latch_ns > end_ns) break;
    request_until(latch_ns);
    const auto from_right = [&] {
      return (hash(column_key, static_cast<uint64_t>(accesses)) & 1) != 0;
    };
    const auto sent = latches.take_row(static_cast<size_t>(row), from_right);
    for (uint32_t index : sent) stage.read(latch_ns, requests[index].event);
    held -= sent.size();
    free_ns = latch_ns + static_cast<int64_t>(sent.size()) * times.column_ns;
    last_row = row;
    row = -1;
  }
  request_until(end_ns);
  clock[FREE_NS] = free_ns;
  clock[LAST_ROW] = last_row;
  clock[ACCESS_ROW] = row;
  clock[LATCH_NS] = latch_ns;
  clock[ACCESSES] = accesses;
}

}  // namespace evs
