// What the readout remembers from tick to tick: plain numbers, and what waits.
#pragma once

#include <cmath>
#include <cstddef>
#include <cstdint>

#include "event_order.h"

namespace evs {

// An event on its way, and its next moment: when it asks to be read, or when it leaves the link.
struct Request {
  int64_t ns;
  Event event;
};

// The places of emulator/sensor/readout/state.py's `clock`, all int64. Those named after a cause
// count dropped events.
enum ClockPlace : size_t {
  DropRoi,
  DropMask,
  DropBusy,
  DropScan,
  DropErc,
  DropFifo,
  Seed,         // modulo 2^64
  Delayed,      // how many wait for their latency,
  Held,         // in their pixels
  Queued,       // and for the link
  FreeNs,       // arbiter: when it is, or was, free
  LastRow,      // the row that it served last; -1 before the first
  AccessRow,    // the row that it is about to latch; -1: none
  LatchNs,      // when it does
  Accesses,     // row accesses so far
  ErcPeriod,    // rate control: number of the period of the last event,
  ErcBefore,    // events that came in the period before,
  ErcCount,     // that came in this one
  ErcPassed,    // and that passed in this one
  ErcShare,     // remainder of the even thinning
  LinkStartNs,  // link: when its busy time began, moved on by a second for each `rate` events,
  LinkSent,     // and events since then; 0: it was never busy
  ClockSize,
};
using ReadoutClock = int64_t[ClockSize];

inline constexpr uint8_t kKept = 255;

// emulator/sensor/random.py's Term
inline constexpr uint64_t kTermLatency = 64;
inline constexpr uint64_t kTermArbiter = 65;

enum class ReadoutOrder { ideal, arbiter, scan };

inline int64_t floor_div(int64_t a, int64_t b) { return a / b - (a % b < 0); }
inline int64_t ceil_div(int64_t a, int64_t b) { return a / b + (a % b > 0); }

// The nearest whole number of ns, no less than 0.
inline int64_t whole_ns(double ns) {
  return ns > 0 ? static_cast<int64_t>(std::floor(ns + 0.5)) : 0;
}

}  // namespace evs
