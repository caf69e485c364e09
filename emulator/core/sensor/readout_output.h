// Behind the pixel array: event rate control, and a link of limited bandwidth.
#pragma once

#include <algorithm>
#include <cstdint>
#include <vector>

#include "readout_state.h"

namespace evs {

enum class ErcDrop { time, row, column };

// Event rate control as in Prophesee's sensors (US patent 11631246; OpenEB: a reference period of
// 200 us, a target count, and dropping in time, by rows or by columns). The count of the last
// period decides which events a period drops; never more than the target pass.
struct RateControl {
  int64_t target = 0;     // events a period; 0: off
  int64_t period_us = 1;  // period k is (k - 1, k] times this
  ErcDrop drop = ErcDrop::time;
};

// The link sends at most `rate` events a second. Its FIFO holds `fifo` events, including the one
// that is being sent.
struct Link {
  int64_t rate = 0;  // 0: unlimited
  int64_t fifo = 0;
  bool stamp_sent = false;  // stamp when sent, not when read
};

// The five low bits of a line in reverse order, so that any range of results is spread evenly.
inline int64_t bit_reversed(int16_t line) {
  const uint32_t n = static_cast<uint32_t>(line) & 31u;
  return (n & 1) << 4 | (n & 2) << 2 | (n & 4) | (n & 8) >> 2 | (n & 16) >> 4;
}

// Takes events in the order in which they are read and outputs those of the tick, stamped.
class OutputStage {
 public:
  OutputStage(const RateControl& rate, const Link& link, ReadoutClock& clock, int64_t end_ns,
              std::vector<Request>& queue, std::vector<Event>& out)
      : rate_(rate), link_(link), clock_(clock), end_ns_(end_ns), queue_(queue), out_(out) {}

  // Output the waiting events that leave the link in this tick.
  void release() {
    size_t left = 0;
    for (; left < queue_.size() && queue_[left].ns <= end_ns_; left++) {
      emit(queue_[left].ns, queue_[left].event);
    }
    queue_.erase(queue_.begin(), queue_.begin() + static_cast<ptrdiff_t>(left));
  }

  // Take an event that is read at `ns`, not before the last one and not after the tick.
  void read(int64_t ns, const Event& event) {
    if (rate_.target > 0 && !passes(ceil_div(ns, 1000), event)) {
      clock_[DropErc]++;
      return;
    }
    if (link_.rate > 0) {
      int64_t leaves = ns;
      if (!enqueue(leaves)) {
        clock_[DropFifo]++;
        return;
      }
      if (link_.stamp_sent) ns = leaves;
      if (ns > end_ns_) {
        queue_.push_back(Request{ns, event});
        return;
      }
    }
    emit(ns, event);
  }

 private:
  void emit(int64_t ns, Event event) {
    event.t = ceil_div(ns, 1000);
    out_.push_back(event);
  }

  // Whether an event with this stamp passes the rate control.
  bool passes(int64_t t_us, const Event& event) {
    const int64_t period = ceil_div(t_us, rate_.period_us);
    if (period != clock_[ErcPeriod]) {
      clock_[ErcBefore] = period == clock_[ErcPeriod] + 1 ? clock_[ErcCount] : 0;
      clock_[ErcPeriod] = period;
      clock_[ErcCount] = clock_[ErcPassed] = clock_[ErcShare] = 0;
    }
    clock_[ErcCount]++;
    const int64_t before = clock_[ErcBefore];
    if (before > rate_.target) {
      if (rate_.drop == ErcDrop::time) {
        // pass `target` of every `before` events, evenly spread
        clock_[ErcShare] += rate_.target;
        if (clock_[ErcShare] < before) return false;
        clock_[ErcShare] -= before;
      } else {
        // drop so many of every 32 lines; one always stays
        const int64_t lines = std::min<int64_t>(31, ceil_div(32 * (before - rate_.target), before));
        if (bit_reversed(rate_.drop == ErcDrop::row ? event.y : event.x) < lines) return false;
      }
    }
    if (clock_[ErcPassed] >= rate_.target) return false;
    clock_[ErcPassed]++;
    return true;
  }

  // Enqueue an event for the link; false if the FIFO is full. In: ns, when it arrives. Out: when it
  // leaves.
  bool enqueue(int64_t& ns) {
    constexpr int64_t kSecond = 1'000'000'000;
    int64_t& start = clock_[LinkStartNs];
    int64_t& sent = clock_[LinkSent];
    // while the link is busy, event k since its start leaves after k / rate seconds, rounded up
    const int64_t free = sent > 0 ? start + ceil_div(sent * kSecond, link_.rate) : ns;
    if (sent == 0 || ns >= free) {
      start = ns;
      sent = 1;
      return true;
    }
    const int64_t waiting = sent - 1 - floor_div((ns - start) * link_.rate, kSecond);
    if (waiting >= link_.fifo) return false;
    ns = free;
    // move the start on by whole seconds: exact, and no product overflows 64 bits
    if (++sent > link_.rate) {
      sent -= link_.rate;
      start += kSecond;
    }
    return true;
  }

  const RateControl& rate_;
  const Link& link_;
  ReadoutClock& clock_;
  int64_t end_ns_;
  std::vector<Request>& queue_;
  std::vector<Event>& out_;
};

}  // namespace evs
