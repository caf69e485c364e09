// The readout: what happens to an event between its pixel and its packet.
//
//   pixel -> ROI, mask -> latency -> order (ideal, arbiter, scan) -> rate control -> link -> out
//
// Times are int64 ns; a stamp is the first whole us at or after its moment. Every decision at a
// moment depends on nothing later, so that any chunking of the same events into ticks gives the
// same events and the same state.
#pragma once

#include <algorithm>
#include <cstdint>
#include <stdexcept>
#include <vector>

#include "arbiter.h"
#include "array_scan.h"
#include "event_order.h"
#include "normal.h"
#include "pixel_latches.h"
#include "readout_output.h"
#include "readout_state.h"
#include "row_access_times.h"

namespace evs {

// Everything that is constant. Out of range values are refused in Python.
struct ReadoutSettings {
  int width = 0;
  int height = 0;
  double latency_us = 0;
  double latency_sigma_us = 0;
  ReadoutOrder order = ReadoutOrder::ideal;
  ArbiterTimes arbiter;
  int64_t scan_ns = 0;
  RateControl rate;
  Link link;
  // what becomes of a pixel's events: kKept or the place of a Drop in the counters; empty: all kept
  std::vector<uint8_t> pixels;
};

class Readout {
 public:
  explicit Readout(ReadoutSettings settings)
      : settings_(std::move(settings)), held_(settings_.width, settings_.height) {}

  // Events of (t_begin_us, t_end_us] by their stamps, sorted. In: events of the tick from their
  // pixels, sorted by t; |t| at most 2^52 us. The state is changed in place; `waiting` holds first
  // what is delayed, then what its pixel holds, then what waits for the link.
  // Throws std::invalid_argument for events that are unsorted, off the sensor or out of the tick.
  void step(const Event* events, size_t count, ReadoutClock& clock, std::vector<Request>& waiting,
            int64_t t_begin_us, int64_t t_end_us, std::vector<Event>& out) {
    check(events, count, t_begin_us, t_end_us);
    const int64_t end_ns = t_end_us * 1000;
    if (clock[Delayed] < 0 || clock[Held] < 0 || clock[Queued] < 0 ||
        static_cast<size_t>(clock[Delayed] + clock[Held] + clock[Queued]) != waiting.size()) {
      throw std::invalid_argument("the state's counts do not fit what waits in it");
    }
    for (const Request& request : waiting) check_place(request.event);
    if (clock[LastRow] >= settings_.height || clock[AccessRow] >= settings_.height ||
        clock[LastRow] < -1 || clock[AccessRow] < -1) {
      throw std::invalid_argument("the state is of a sensor with more rows");
    }
    const auto held = waiting.begin() + clock[Delayed];
    const auto queued = held + clock[Held];

    // what its pixel holds comes first, then what is delayed, then what is new
    requests_.assign(held, queued);
    requests_.insert(requests_.end(), waiting.begin(), held);
    queue_.assign(queued, waiting.end());
    const size_t first_new = static_cast<size_t>(clock[Held]);
    add_requests(events, count, clock);
    const size_t due = sort_requests(first_new, end_ns);

    out.clear();
    OutStage stage{settings_.rate, settings_.link, clock, end_ns, queue_, out};
    stage.release();
    if (settings_.order != ReadoutOrder::ideal) held_.clear();
    switch (settings_.order) {
      case ReadoutOrder::ideal:
        for (size_t i = 0; i < due; i++) stage.read(requests_[i].ns, requests_[i].event);
        break;
      case ReadoutOrder::arbiter:
        run_arbiter(settings_.arbiter, rows_, requests_, first_new, due, end_ns, clock, held_,
                    stage);
        break;
      case ReadoutOrder::scan:
        run_scan(settings_.scan_ns, requests_, due, end_ns, clock, held_, stage);
        break;
    }

    // what is left, in the three places
    waiting.assign(requests_.begin() + static_cast<ptrdiff_t>(due), requests_.end());
    clock[Delayed] = static_cast<int64_t>(waiting.size());
    if (settings_.order != ReadoutOrder::ideal) {
      held_.take_all([&](uint32_t place) { waiting.push_back(requests_[place]); });
    }
    clock[Held] = static_cast<int64_t>(waiting.size()) - clock[Delayed];
    waiting.insert(waiting.end(), queue_.begin(), queue_.end());
    clock[Queued] = static_cast<int64_t>(queue_.size());
    free_scratch();
  }

 private:
  void check(const Event* events, size_t count, int64_t t_begin_us, int64_t t_end_us) const {
    int64_t last = t_begin_us + 1;
    for (size_t i = 0; i < count; i++) {
      const Event& event = events[i];
      if (event.t < last) throw std::invalid_argument("events are not sorted or before the tick");
      last = event.t;
      check_place(event);
    }
    if (count > 0 && last > t_end_us) throw std::invalid_argument("events are after the tick");
  }

  void check_place(const Event& event) const {
    if (static_cast<uint16_t>(event.x) >= settings_.width ||
        static_cast<uint16_t>(event.y) >= settings_.height) {
      throw std::invalid_argument("an event is not on the sensor");
    }
  }

  // Events as requests at their pixels' moments; those of no interest are counted instead.
  void add_requests(const Event* events, size_t count, ReadoutClock& clock) {
    const bool late = settings_.latency_us > 0 || settings_.latency_sigma_us > 0;
    const bool jitter = settings_.latency_sigma_us > 0;
    const uint64_t key = term_key(static_cast<uint64_t>(clock[Seed]), kTermLatency);
    const uint8_t* pixels = settings_.pixels.empty() ? nullptr : settings_.pixels.data();
    const size_t width = static_cast<size_t>(settings_.width);
    requests_.reserve(requests_.size() + count);
    for (size_t i = 0; i < count; i++) {
      const Event& event = events[i];
      const size_t x = static_cast<size_t>(event.x), y = static_cast<size_t>(event.y);
      if (pixels) {
        const uint8_t fate = pixels[y * width + x];
        if (fate != kKept) {
          clock[fate]++;
          continue;
        }
      }
      int64_t delay_ns = 0;
      if (late) {
        double delay_us = settings_.latency_us;
        if (jitter) {
          const uint64_t pixel = hash(key, (y << 32 | x << 1) + 1);
          const uint64_t moment = static_cast<uint64_t>(event.t) << 2 | (event.p ? 2u : 0u);
          delay_us += settings_.latency_sigma_us * normal(pixel, moment);
        }
        delay_ns = whole_ns(delay_us * 1000.0);
      }
      requests_.push_back(Request{event.t * 1000 + delay_ns, event});
    }
  }

  // Requests from `first` on by their moments, ties as they came; how many of all are due.
  size_t sort_requests(size_t first, int64_t end_ns) {
    const auto earlier = [](const Request& a, const Request& b) { return a.ns < b.ns; };
    const auto begin = requests_.begin() + static_cast<ptrdiff_t>(first);
    if (!std::is_sorted(begin, requests_.end(), earlier)) {
      std::stable_sort(begin, requests_.end(), earlier);
    }
    const auto end = std::upper_bound(begin, requests_.end(), end_ns,
                                      [](int64_t ns, const Request& r) { return ns < r.ns; });
    return static_cast<size_t>(end - requests_.begin());
  }

  // a burst's memory is not kept for ever
  void free_scratch() {
    constexpr size_t kKeep = 1 << 16;
    if (requests_.capacity() > kKeep) std::vector<Request>().swap(requests_);
    if (queue_.capacity() > kKeep) std::vector<Request>().swap(queue_);
  }

  ReadoutSettings settings_;
  RowTimes rows_;                  // scratch
  HeldPixels held_;                // scratch
  std::vector<Request> requests_;  // scratch
  std::vector<Request> queue_;     // scratch
};

}  // namespace evs
