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
  DropRoi,
  DropMask,
  DropBusy,
  DropScan,
  DropErc,
  DropFifo,
  Seed,         // modulo 2^64
  Delayed,      // requests that wait for their latency,
  Held,         // requests that pixels hold,
  Reading,      // events of a scan whose column is still to be read,
  Queued,       // and events that wait for the link
  FreeNs,       // arbiter: time from which it is free
  LastRow,      // row served last; -1 before the first
  AccessRow,    // row that is being accessed; -1 for none
  LatchNs,      // time of its latch
  Accesses,     // row accesses so far
  ErcPeriod,    // event rate control: number of the period of the last event
  ErcBefore,    // events in the period before it
  ErcCount,     // events in it
  ErcPassed,    // events in it that passed
  ErcShare,     // remainder of the even thinning
  LinkStartNs,  // link: start of its busy time, plus a second for each `rate` events
  LinkSent,     // events since then; 0 if it was never busy
  NextScan,     // scan: number of the first that may be read
  ClockSize,
};
using ReadoutClock = int64_t[ClockSize];

inline constexpr uint8_t kKept = 255;

// Term in emulator/sensor/random.py
inline constexpr uint64_t kTermLatency = 64;
inline constexpr uint64_t kTermArbiter = 65;
inline constexpr uint64_t kTermColumns = 66;
inline constexpr uint64_t kTermPhase = 67;

enum class ReadoutOrder { ideal, arbiter, scan };

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
