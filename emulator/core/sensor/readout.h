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
#include <limits>
#include <memory>
#include <stdexcept>
#include <utility>
#include <vector>

#include "sensor/arbiter.h"
#include "sensor/array_scan.h"
#include "sensor/events.h"
#include "sensor/pixel_latches.h"
#include "sensor/random.h"
#include "sensor/readout_output.h"
#include "sensor/readout_state.h"
#include "sensor/request_phases.h"

namespace evs {

// Constant settings. Python refuses values that are out of range.
struct ReadoutSettings {
  int width = 0;
  int height = 0;
  double latency_us = 0;
  double latency_sigma_us = 0;
  ReadoutOrder order = ReadoutOrder::IDEAL;
  ArbiterTimes arbiter;
  ScanTimes scan;
  RateControl rate;
  Link link;
  // of each pixel: KEPT, or the entry of `clock` that counts its dropped events; empty: all are
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
  // that wait for the link. Throws std::invalid_argument for events that are unsorted, off the
  // sensor or outside the tick.
  void step(const Event* events, size_t count, ReadoutClock& clock, std::vector<Request>& waiting,
            int64_t t_begin_us, int64_t t_end_us, EventBuffer& out) {
    // check the events and the state
    check(events, count, t_begin_us, t_end_us);
    const int64_t end_ns = t_end_us * 1000;
    if (clock[DELAYED] < 0 || clock[HELD] < 0 || clock[READING] < 0 || clock[QUEUED] < 0 ||
        static_cast<size_t>(clock[DELAYED] + clock[HELD] + clock[READING] + clock[QUEUED]) !=
            waiting.size()) {
      throw std::invalid_argument("the state's counts do not fit what waits in it");
    }
    for (const Request& request : waiting) {
      if (!on_sensor(request.event)) throw std::invalid_argument("an event is not on the sensor");
    }
    if (clock[LAST_ROW] >= settings_.height || clock[ACCESS_ROW] >= settings_.height ||
        clock[LAST_ROW] < -1 || clock[ACCESS_ROW] < -1) {
      throw std::invalid_argument("the state is of a sensor with more rows");
    }
    const auto held = waiting.begin() + clock[DELAYED];
    const auto reading = held + clock[HELD];
    const auto queued = reading + clock[READING];

    // collect the requests: held by pixels first, then delayed, then new
    requests_.assign(held, reading);
    requests_.insert(requests_.end(), waiting.begin(), held);
    reading_.assign(reading, queued);
    queue_.assign(queued, waiting.end());
    const size_t first_new = static_cast<size_t>(clock[HELD]);
    add_requests(events, count, clock);
    const size_t due = sort_requests(first_new, end_ns);

    // read them in the order of this sensor
    const size_t most = queue_.size() + reading_.size() + due;
    out.count = 0;
    out.events.reset(new Event[most]);
    OutputStage stage{settings_.rate, settings_.link, clock, end_ns, queue_, out};
    stage.release();
    if (settings_.order != ReadoutOrder::IDEAL) latches_.clear(requests_.size());
    switch (settings_.order) {
      case ReadoutOrder::IDEAL:
        for (size_t i = 0; i < due; i++) stage.read(requests_[i].ns, requests_[i].event);
        break;
      case ReadoutOrder::ARBITER:
        run_arbiter(settings_.arbiter, access_times_, requests_.data(), first_new, due, end_ns,
                    clock, latches_, stage);
        break;
      case ReadoutOrder::SCAN:
        run_scan(settings_.scan, settings_.width, requests_, due, end_ns, clock, latches_, reading_,
                 stage);
        break;
    }

    // keep the others in the state
    waiting.assign(requests_.begin() + static_cast<ptrdiff_t>(due), requests_.end());
    clock[DELAYED] = static_cast<int64_t>(waiting.size());
    if (settings_.order != ReadoutOrder::IDEAL) {
      latches_.take_all([&](uint32_t index) { waiting.push_back(requests_[index]); });
    }
    clock[HELD] = static_cast<int64_t>(waiting.size()) - clock[DELAYED];
    waiting.insert(waiting.end(), reading_.begin(), reading_.end());
    clock[READING] = static_cast<int64_t>(reading_.size());
    waiting.insert(waiting.end(), queue_.begin(), queue_.end());
    clock[QUEUED] = static_cast<int64_t>(queue_.size());
    if (out.count < most / 2) {
      // hold no memory for what was dropped or waits
      std::unique_ptr<Event[]> fitting(new Event[out.count]);
      std::copy_n(out.events.get(), out.count, fitting.get());
      out.events = std::move(fitting);
    }
    free_scratch();
  }

 private:
  // Refuse events that are unsorted, off the sensor or outside the tick, without a branch on each.
  void check(const Event* events, size_t count, int64_t t_begin_us, int64_t t_end_us) const {
    int64_t last = t_begin_us + 1;
    uint64_t unsorted = 0, outside = 0;
    for (size_t i = 0; i < count; i++) {
      const Event& event = events[i];
      unsorted |= uint64_t{event.t < last};
      last = event.t;
      outside |= uint64_t{!on_sensor(event)};
    }
    if (unsorted) throw std::invalid_argument("events are not sorted or before the tick");
    if (outside) throw std::invalid_argument("an event is not on the sensor");
    if (count > 0 && last > t_end_us) throw std::invalid_argument("events are after the tick");
  }

  bool on_sensor(const Event& event) const {
    return (static_cast<uint16_t>(event.x) < settings_.width) &
           (static_cast<uint16_t>(event.y) < settings_.height);
  }

  // Append events as requests after the latency of their pixels; count those outside the ROI or
  // masked.
  void add_requests(const Event* events, size_t count, ReadoutClock& clock) {
    if (!settings_.fates.empty()) {
      count = keep_events(events, count, clock);
      events = kept_.data();
    }
    const uint64_t seed = static_cast<uint64_t>(clock[CLOCK_SEED]);
    const bool early = settings_.order == ReadoutOrder::ARBITER && settings_.arbiter.phase_ns > 0;
    const bool jitter = settings_.latency_sigma_us > 0;
    const bool late = settings_.latency_us > 0 || jitter;
    if (early) phases_.draw(term_key(seed, TERM_PHASE), settings_.arbiter.phase_ns, events, count);
    const size_t before = requests_.size();
    requests_.resize(before + count);
    Request* const requests = requests_.data() + before;
    if (early && !late) {
      add_by_phase(events, phases_.ns(), count, requests);
      return;
    }
    const uint64_t key = term_key(seed, TERM_LATENCY);
    for (size_t i = 0; i < count; i++) {
      const Event& event = events[i];
      int64_t ns = event.t * 1000;
      if (late) {
        double delay_us = settings_.latency_us;
        if (jitter) {
          const uint64_t counter = static_cast<uint64_t>(event.t) << 2 | (event.p ? 2u : 0u);
          delay_us += settings_.latency_sigma_us * normal(hash(key, pixel_counter(event)), counter);
        }
        ns += round_ns(delay_us * 1000.0);
      }
      if (early) ns -= phases_.ns()[i];
      requests[i].ns = ns;
      requests[i].event = event;
    }
  }

  // Copy the events that are read out to kept_ and count the others. Out: how many are kept.
  size_t keep_events(const Event* events, size_t count, ReadoutClock& clock) {
    kept_.clear();
    for (size_t i = 0; i < count; i++) {
      const size_t x = static_cast<size_t>(events[i].x), y = static_cast<size_t>(events[i].y);
      const uint8_t fate = settings_.fates[y * static_cast<size_t>(settings_.width) + x];
      if (fate == KEPT) {
        kept_.push_back(events[i]);
      } else {
        clock[fate]++;
      }
    }
    return kept_.size();
  }

  // Write the requests of events that are sorted by us, each earlier by its phase, in order of
  // time; equal times keep their order.
  static void add_by_phase(const Event* events, const int32_t* phases_ns, size_t count,
                           Request* requests) {
    for (size_t size; count > 0; count -= size) {
      size = 1;
      while (size < count && events[size].t == events->t) size++;
      if (size <= 4) {
        add_few<4>(events, phases_ns, size, requests);
      } else if (size <= 8) {
        add_few<8>(events, phases_ns, size, requests);
      } else if (size <= 16) {
        add_few<16>(events, phases_ns, size, requests);
      } else {
        for (size_t i = 0; i < size; i++) {
          requests[i] = Request{events[i].t * 1000 - phases_ns[i], events[i]};
        }
        std::stable_sort(requests, requests + size,
                         [](const Request& a, const Request& b) { return a.ns < b.ns; });
      }
      events += size;
      phases_ns += size;
      requests += size;
    }
  }

  // The same for up to MOST events of one us. The place of each is the number of those before it,
  // which takes no branch.
  template <size_t MOST>
  static void add_few(const Event* events, const int32_t* phases_ns, size_t count,
                      Request* requests) {
    // no two keys are equal
    int32_t keys[MOST];
    std::fill_n(keys, MOST, std::numeric_limits<int32_t>::max());
    for (size_t i = 0; i < count; i++) {
      keys[i] = static_cast<int32_t>(i) - phases_ns[i] * static_cast<int32_t>(MOST);
    }
    const int64_t stamp_ns = events->t * 1000;
    for (size_t i = 0; i < count; i++) {
      int32_t place = 0;
      for (int32_t key : keys) place += key < keys[i];
      requests[place].ns = stamp_ns - phases_ns[i];
      requests[place].event = events[i];
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
    constexpr size_t KEEP = 1 << 16;
    if (kept_.capacity() > KEEP) std::vector<Event>().swap(kept_);
    if (requests_.capacity() > KEEP) std::vector<Request>().swap(requests_);
    phases_.free_beyond(KEEP);
    if (reading_.capacity() > KEEP) std::vector<Request>().swap(reading_);
    if (queue_.capacity() > KEEP) std::vector<Request>().swap(queue_);
  }

  ReadoutSettings settings_;
  RequestPhases phases_;           // scratch
  RowAccessTimes access_times_;    // scratch
  PixelLatches latches_;           // scratch
  std::vector<Event> kept_;        // scratch
  std::vector<Request> requests_;  // scratch
  std::vector<Request> reading_;   // scratch
  std::vector<Request> queue_;     // scratch
};

}  // namespace evs
