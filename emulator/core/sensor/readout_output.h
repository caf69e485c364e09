// Behind the pixel array: event rate control, and a link of limited bandwidth.
#pragma once

#include <algorithm>
#include <cstdint>
#include <limits>
#include <vector>

#include "sensor/readout_state.h"

namespace evs {

enum class ErcDrop { TIME, ROW, COLUMN };

// Event rate control as in Prophesee's sensors (US patent 11631246; OpenEB: a reference period of
// 200 us, a target count, and dropping in time, by rows or by columns). The count of the last
// period decides which events a period drops; never more than the target pass.
struct RateControl {
  int64_t target = 0;     // events a period; 0: off
  int64_t period_us = 1;  // period k is (k - 1, k] times this
  ErcDrop drop = ErcDrop::TIME;
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

// Takes events in the order in which they are read and outputs those of the tick, stamped. `out`
// has room for all of them.
class OutputStage {
 public:
  OutputStage(const RateControl& rate, const Link& link, ReadoutClock& clock, int64_t end_ns,
              std::vector<Request>& queue, EventBuffer& out)
      : rate_(rate), link_(link), clock_(clock), end_ns_(end_ns), queue_(queue), out_(out) {
    if (link.rate > 0) {
      sent_ns_ = busy_ns(clock[LINK_SENT]);
      each_ns_ = busy_ns(1);
    }
  }

  // Output the waiting events that leave the link in this tick.
  void release() {
    size_t left = 0;
    for (; left < queue_.size() && queue_[left].ns <= end_ns_; left++) {
      emit(queue_[left].ns, queue_[left].event);
    }
    queue_.erase(queue_.begin(), queue_.begin() + static_cast<ptrdiff_t>(left));
  }

  // Take an event that is read at `ns`, not before the last one and not after the tick.
  EVS_ALWAYS_INLINE void read(int64_t ns, const Event& event) {
    if (rate_.target > 0 && !passes(stamp_us(ns), event)) {
      clock_[DROP_ERC]++;
      return;
    }
    if (link_.rate > 0) {
      int64_t leaves = ns;
      if (!enqueue(leaves)) {
        clock_[DROP_FIFO]++;
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
  void emit(int64_t ns, const Event& event) {
    Event& stamped = out_.events[out_.count++];
    stamped = event;
    stamped.t = stamp_us(ns);
  }

  // Whether an event with this stamp passes the rate control.
  bool passes(int64_t t_us, const Event& event) {
    if (t_us > period_end_us_) {
      const int64_t period = ceil_div(t_us, rate_.period_us);
      if (period != clock_[ERC_PERIOD]) {
        clock_[ERC_BEFORE] = period == clock_[ERC_PERIOD] + 1 ? clock_[ERC_COUNT] : 0;
        clock_[ERC_PERIOD] = period;
        clock_[ERC_COUNT] = clock_[ERC_PASSED] = clock_[ERC_SHARE] = 0;
      }
      period_end_us_ = period * rate_.period_us;
    }
    clock_[ERC_COUNT]++;
    const int64_t before = clock_[ERC_BEFORE];
    if (before > rate_.target) {
      if (rate_.drop == ErcDrop::TIME) {
        // pass `target` of every `before` events, evenly spread
        clock_[ERC_SHARE] += rate_.target;
        if (clock_[ERC_SHARE] < before) return false;
        clock_[ERC_SHARE] -= before;
      } else {
        // drop so many of every 32 lines; one always stays
        const int64_t lines = std::min<int64_t>(31, ceil_div(32 * (before - rate_.target), before));
        if (bit_reversed(rate_.drop == ErcDrop::ROW ? event.y : event.x) < lines) return false;
      }
    }
    if (clock_[ERC_PASSED] >= rate_.target) return false;
    clock_[ERC_PASSED]++;
    return true;
  }

  // A time of k / rate seconds: whole ns, and what is left of one in 1 / rate ns.
  struct Busy {
    int64_t ns;
    int64_t left;
  };

  Busy busy_ns(int64_t events) const {
    return Busy{events * SECOND / link_.rate, events * SECOND % link_.rate};
  }

  // Enqueue an event for the link; false if the FIFO is full. In: ns, when it arrives. Out: when it
  // leaves.
  bool enqueue(int64_t& ns) {
    int64_t& start = clock_[LINK_START_NS];
    int64_t& sent = clock_[LINK_SENT];
    // while the link is busy, event k since its start leaves after k / rate seconds, rounded up
    const int64_t free = start + sent_ns_.ns + (sent_ns_.left > 0);
    if (sent <= 0 || ns >= free) {
      start = ns;
      sent = 1;
      sent_ns_ = each_ns_;
      return true;
    }
    // those sent since the start are the most that can wait: without a division, if they fit
    if (sent > link_.fifo || ns < start) {
      const int64_t waiting = sent - 1 - floor_div((ns - start) * link_.rate, SECOND);
      if (waiting >= link_.fifo) return false;
    }
    ns = free;
    sent++;
    sent_ns_.ns += each_ns_.ns;
    sent_ns_.left += each_ns_.left;
    if (sent_ns_.left >= link_.rate) {
      sent_ns_.left -= link_.rate;
      sent_ns_.ns++;
    }
    // move the start on by whole seconds: exact, and no product overflows 64 bits
    if (sent > link_.rate) {
      sent -= link_.rate;
      start += SECOND;
      sent_ns_.ns -= SECOND;
    }
    return true;
  }

  static constexpr int64_t SECOND = 1'000'000'000;

  const RateControl& rate_;
  const Link& link_;
  ReadoutClock& clock_;
  int64_t end_ns_;
  std::vector<Request>& queue_;
  EventBuffer& out_;
  // of this tick: the last stamp of the period of the rate control, and how long the link is busy
  // from its start on, and with one event
  int64_t period_end_us_ = std::numeric_limits<int64_t>::min();
  Busy sent_ns_ = {0, 0};
  Busy each_ns_ = {0, 0};
};

}  // namespace evs
