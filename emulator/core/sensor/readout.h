// The readout: the path of an event from its pixel to its packet.
//
//   pixel -> ROI, mask -> latency -> order (ideal, arbiter, scan) -> rate control -> link -> out
//
// Times are int64 ns; a stamp is its time rounded up to whole us. Every decision depends only on
// what came before it, so any division of the same events into ticks gives the same events and
// state.
#pragma once

#include <algorithm>
#include <cstdint>
#include <stdexcept>
#include <vector>

#include "arbiter.h"
#include "array_scan.h"
#include "events.h"
#include "pixel_latches.h"
#include "random.h"
#include "readout_output.h"
#include "readout_state.h"

namespace evs {

// Constant settings. Python refuses values that are out of range.
struct ReadoutSettings {
  int width = 0;
  int height = 0;
  double latency_us = 0;
  double latency_sigma_us = 0;
  ReadoutOrder order = ReadoutOrder::ideal;
  ArbiterTimes arbiter;
  ScanTimes scan;
  RateControl rate;
  Link link;
  // of each pixel: kKept, or the entry of `clock` that counts its dropped events; empty: all are
  // kept
  std::vector<uint8_t> fates;
};

class Readout {
 public:
  explicit Readout(ReadoutSettings settings)
      : settings_(std::move(settings)), latches_(settings_.width, settings_.height) {}

  // One tick. In: events of the pixels, sorted by t, |t| <= 2^52 us. Out: events with stamps in
  // (t_begin_us, t_end_us], sorted. In/out: the state; `waiting` has first the delayed requests,
  // then those that pixels hold, then those of a scan whose column is still to be read, then those
  // that wait for the link. Throws std::invalid_argument
  // for events that are unsorted, off the sensor or outside the tick.
  void step(const Event* events, size_t count, ReadoutClock& clock, std::vector<Request>& waiting,
            int64_t t_begin_us, int64_t t_end_us, std::vector<Event>& out) {
    // check the events and the state
    check(events, count, t_begin_us, t_end_us);
    const int64_t end_ns = t_end_us * 1000;
    if (clock[Delayed] < 0 || clock[Held] < 0 || clock[Reading] < 0 || clock[Queued] < 0 ||
        static_cast<size_t>(clock[Delayed] + clock[Held] + clock[Reading] + clock[Queued]) !=
            waiting.size()) {
      throw std::invalid_argument("the state's counts do not fit what waits in it");
    }
    for (const Request& request : waiting) check_pixel(request.event);
    if (clock[LastRow] >= settings_.height || clock[AccessRow] >= settings_.height ||
        clock[LastRow] < -1 || clock[AccessRow] < -1) {
      throw std::invalid_argument("the state is of a sensor with more rows");
    }
    const auto held = waiting.begin() + clock[Delayed];
    const auto reading = held + clock[Held];
    const auto queued = reading + clock[Reading];

    // collect the requests: held by pixels first, then delayed, then new
    requests_.assign(held, reading);
    requests_.insert(requests_.end(), waiting.begin(), held);
    reading_.assign(reading, queued);
    queue_.assign(queued, waiting.end());
    const size_t first_new = static_cast<size_t>(clock[Held]);
    add_requests(events, count, clock);
    const size_t due = sort_requests(first_new, end_ns);

    // read them in the order of this sensor
    out.clear();
    OutputStage stage{settings_.rate, settings_.link, clock, end_ns, queue_, out};
    stage.release();
    if (settings_.order != ReadoutOrder::ideal) latches_.clear();
    switch (settings_.order) {
      case ReadoutOrder::ideal:
        for (size_t i = 0; i < due; i++) stage.read(requests_[i].ns, requests_[i].event);
        break;
      case ReadoutOrder::arbiter:
        run_arbiter(settings_.arbiter, access_times_, requests_, first_new, due, end_ns, clock,
                    latches_, stage);
        break;
      case ReadoutOrder::scan:
        run_scan(settings_.scan, settings_.width, requests_, due, end_ns, clock, latches_, reading_,
                 stage);
        break;
    }

    // keep the others in the state
    waiting.assign(requests_.begin() + static_cast<ptrdiff_t>(due), requests_.end());
    clock[Delayed] = static_cast<int64_t>(waiting.size());
    if (settings_.order != ReadoutOrder::ideal) {
      latches_.take_all([&](uint32_t index) { waiting.push_back(requests_[index]); });
    }
    clock[Held] = static_cast<int64_t>(waiting.size()) - clock[Delayed];
    waiting.insert(waiting.end(), reading_.begin(), reading_.end());
    clock[Reading] = static_cast<int64_t>(reading_.size());
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
      check_pixel(event);
    }
    if (count > 0 && last > t_end_us) throw std::invalid_argument("events are after the tick");
  }

  void check_pixel(const Event& event) const {
    if (static_cast<uint16_t>(event.x) >= settings_.width ||
        static_cast<uint16_t>(event.y) >= settings_.height) {
      throw std::invalid_argument("an event is not on the sensor");
    }
  }

  // Append events as requests after the latency of their pixels; count those outside the ROI or
  // masked.
  void add_requests(const Event* events, size_t count, ReadoutClock& clock) {
    const bool late = settings_.latency_us > 0 || settings_.latency_sigma_us > 0;
    const bool jitter = settings_.latency_sigma_us > 0;
    const uint64_t key = term_key(static_cast<uint64_t>(clock[Seed]), kTermLatency);
    const uint64_t phases =
        settings_.order == ReadoutOrder::arbiter && settings_.arbiter.phase_ns > 0
            ? static_cast<uint64_t>(settings_.arbiter.phase_ns) + 1
            : 0;
    const uint64_t phase_key = term_key(static_cast<uint64_t>(clock[Seed]), kTermPhase);
    const uint8_t* fates = settings_.fates.empty() ? nullptr : settings_.fates.data();
    const size_t width = static_cast<size_t>(settings_.width);
    const size_t before = requests_.size();
    requests_.reserve(before + count);
    for (size_t i = 0; i < count; i++) {
      const Event& event = events[i];
      const size_t x = static_cast<size_t>(event.x), y = static_cast<size_t>(event.y);
      if (fates) {
        const uint8_t fate = fates[y * width + x];
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
          const uint64_t counter = static_cast<uint64_t>(event.t) << 2 | (event.p ? 2u : 0u);
          delay_us += settings_.latency_sigma_us * normal(pixel, counter);
        }
        delay_ns = round_ns(delay_us * 1000.0);
      }
      if (phases != 0) {
        // a multiplication and shift: evenly spread over [0, phase_ns]
        const uint64_t pixel = hash(phase_key, (y << 32 | x << 1) + 1);
        const uint64_t bits =
            hash(pixel, static_cast<uint64_t>(event.t) << 1 | (event.p ? 1u : 0u));
        delay_ns -= static_cast<int64_t>((bits >> 32) * phases >> 32);
      }
      requests_.push_back(Request{event.t * 1000 + delay_ns, event});
    }
    if (phases != 0 && !late) sort_within_us(before);
  }

  // Sort the requests from `first` on, which are sorted by the us of their events, by time.
  void sort_within_us(size_t first) {
    constexpr size_t kFew = 24;
    const auto earlier = [](const Request& a, const Request& b) { return a.ns < b.ns; };
    while (first < requests_.size()) {
      size_t end = first + 1;
      while (end < requests_.size() && requests_[end].event.t == requests_[first].event.t) end++;
      const auto begin = requests_.begin();
      if (end - first > kFew) {
        std::stable_sort(begin + static_cast<ptrdiff_t>(first), begin + static_cast<ptrdiff_t>(end),
                         earlier);
      } else {
        // by insertion, which keeps the order of equal times
        for (size_t i = first + 1; i < end; i++) {
          const Request request = requests_[i];
          size_t at = i;
          for (; at > first && request.ns < requests_[at - 1].ns; at--) {
            requests_[at] = requests_[at - 1];
          }
          requests_[at] = request;
        }
      }
      first = end;
    }
  }

  // Sort requests from `first` on by time, stable. Out: how many of all requests are due.
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

  // free the memory of a burst
  void free_scratch() {
    constexpr size_t kKeep = 1 << 16;
    if (requests_.capacity() > kKeep) std::vector<Request>().swap(requests_);
    if (reading_.capacity() > kKeep) std::vector<Request>().swap(reading_);
    if (queue_.capacity() > kKeep) std::vector<Request>().swap(queue_);
  }

  ReadoutSettings settings_;
  RowAccessTimes access_times_;    // scratch
  PixelLatches latches_;           // scratch
  std::vector<Request> requests_;  // scratch
  std::vector<Request> reading_;   // scratch
  std::vector<Request> queue_;     // scratch
};

}  // namespace evs
