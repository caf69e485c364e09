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

#include <cstddef>
#include <cstdint>
#include <vector>

#include "isa.h"
#include "pixel_latches.h"
#include "random.h"
#include "readout_state.h"

namespace evs {

struct ArbiterTimes {
  int64_t row_ns = 0;
  int64_t column_ns = 0;
  double jitter_ns = 0;  // standard deviation of the row access
  int64_t phase_ns = 0;  // at most 999
};

// Durations of the row accesses of the arbiter. Each depends on the seed and the number of the
// access alone, so they are drawn in batches: one by one they would take half of the readout's
// time.
class RowAccessTimes {
 public:
  // Duration of access number `access`. In: key, from the seed and the term.
  int64_t duration_ns(const ArbiterTimes& times, uint64_t key, int64_t access) {
    if (!(times.jitter_ns > 0)) return times.row_ns;
    const uint64_t number = static_cast<uint64_t>(access);
    if (!drawn_ || key != key_ || number - first_ >= kBatch) {
      draw_(times, key, number, ns_);
      drawn_ = true;
      key_ = key;
      first_ = number;
    }
    return ns_[number - first_];
  }

 private:
  static constexpr size_t kBatch = 64;
  using Draw = void (*)(const ArbiterTimes&, uint64_t key, uint64_t first, int64_t* out);

  EVS_ALWAYS_INLINE static void draw(const ArbiterTimes& times, uint64_t key, uint64_t first,
                                     int64_t* out) {
    const double row_ns = static_cast<double>(times.row_ns);
    const double jitter_ns = times.jitter_ns;
    for (size_t i = 0; i < kBatch; i++) {
      out[i] = round_ns(row_ns + jitter_ns * normal(key, (first + i) << 1));
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
  int64_t ns_[kBatch];
};

// In: requests [0, first) are latched already, [first, due) follow by time, all <= end_ns. Calls
// `stage.read` in order of time. Out: `latches` with the requests that were not read.
template <class Stage>
void run_arbiter(const ArbiterTimes& times, RowAccessTimes& access_times,
                 const std::vector<Request>& requests, size_t first, size_t due, int64_t end_ns,
                 ReadoutClock& clock, PixelLatches& latches, Stage& stage) {
  const uint64_t key = term_key(static_cast<uint64_t>(clock[Seed]), kTermArbiter);
  const uint64_t column_key = term_key(static_cast<uint64_t>(clock[Seed]), kTermColumns);
  size_t next = 0;
  auto request = [&](size_t i) {
    const Event& event = requests[i].event;
    if (!latches.set(event.x, event.y, static_cast<uint32_t>(i))) clock[DropBusy]++;
  };
  auto request_until = [&](int64_t ns) {
    for (; next < due && requests[next].ns <= ns; next++) request(next);
  };
  for (; next < first; next++) request(next);

  for (;;) {
    // grant the next requesting row
    if (clock[AccessRow] < 0) {
      int64_t now = clock[FreeNs];
      if (now > end_ns) break;
      request_until(now);
      int row = latches.row_after(clock[LastRow]);
      if (row < 0) {
        // no row waits: jump to the next request
        if (next == due) break;
        now = requests[next].ns;
        request_until(now);
        row = latches.row_after(clock[LastRow]);
      }
      clock[LatchNs] = now + access_times.duration_ns(times, key, clock[Accesses]);
      clock[Accesses]++;
      clock[AccessRow] = row;
    }
    // latch the row and send its events
    if (clock[LatchNs] > end_ns) break;
    request_until(clock[LatchNs]);
    int64_t sent = 0;
    const auto send = [&](uint32_t index) {
      stage.read(clock[LatchNs], requests[index].event);
      sent++;
    };
    const size_t row = static_cast<size_t>(clock[AccessRow]);
    if (hash(column_key, static_cast<uint64_t>(clock[Accesses])) & 1) {
      latches.take_row_from_right(row, send);
    } else {
      latches.take_row(row, send);
    }
    clock[FreeNs] = clock[LatchNs] + sent * times.column_ns;
    clock[LastRow] = clock[AccessRow];
    clock[AccessRow] = -1;
  }
  request_until(end_ns);
}

}  // namespace evs
