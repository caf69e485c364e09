// The state of the readout between ticks: plain numbers, and requests that wait.
#pragma once

#include <cmath>
#include <cstddef>
#include <cstdint>

#include "sensor/events.h"

namespace evs {

// An event in the readout and its next time: when its pixel requests the row, or when it leaves the
// link.
struct Request {
  int64_t ns;
  Event event;
};

// The entries of `clock` in emulator/sensor/readout.py, all int64. The first six count
// dropped events by cause.
enum ClockPlace : size_t {
  DROP_ROI,
  DROP_MASK,
  DROP_BUSY,
  DROP_SCAN,
  DROP_ERC,
  DROP_FIFO,
  CLOCK_SEED,     // modulo 2^64
  DELAYED,        // requests that wait for their latency,
  HELD,           // requests that pixels hold,
  READING,        // events of a scan whose column is still to be read,
  QUEUED,         // and events that wait for the link
  FREE_NS,        // arbiter: time from which it is free
  LAST_ROW,       // row served last; -1 before the first
  ACCESS_ROW,     // row that is being accessed; -1 for none
  LATCH_NS,       // time of its latch
  ACCESSES,       // row accesses so far
  ERC_PERIOD,     // event rate control: number of the period of the last event
  ERC_BEFORE,     // events in the period before it
  ERC_COUNT,      // events in it
  ERC_PASSED,     // events in it that passed
  ERC_SHARE,      // remainder of the even thinning
  LINK_START_NS,  // link: start of its busy time, plus a second for each `rate` events
  LINK_SENT,      // events since then; 0 if it was never busy
  NEXT_SCAN,      // scan: number of the first that may be read
  CLOCK_SIZE,
};
using ReadoutClock = int64_t[CLOCK_SIZE];

inline constexpr uint8_t KEPT = 255;

// Term in emulator/sensor/random.py
inline constexpr uint64_t TERM_LATENCY = 64;
inline constexpr uint64_t TERM_ARBITER = 65;
inline constexpr uint64_t TERM_COLUMNS = 66;
inline constexpr uint64_t TERM_PHASE = 67;

enum class ReadoutOrder { IDEAL, ARBITER, SCAN };

// The counter of a pixel in the random numbers of its requests.
inline uint64_t pixel_counter(const Event& event) {
  const uint64_t x = static_cast<uint16_t>(event.x), y = static_cast<uint16_t>(event.y);
  return (y << 32 | x << 1) + 1;
}

inline int64_t floor_div(int64_t a, int64_t b) { return a / b - (a % b < 0); }
inline int64_t ceil_div(int64_t a, int64_t b) { return a / b + (a % b > 0); }

// The stamp of a time: rounded up to whole us.
inline int64_t stamp_us(int64_t ns) { return (ns + (ns > 0 ? 999 : 0)) / 1000; }

// Round to whole ns, not below 0.
inline int64_t round_ns(double ns) {
  return ns > 0 ? static_cast<int64_t>(std::floor(ns + 0.5)) : 0;
}

}  // namespace evs
