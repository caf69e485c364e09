// Shared by the bindings of the readout: a readout, and its state as Python has it.
#pragma once

#include <nanobind/nanobind.h>
#include <nanobind/ndarray.h>

#include <cstring>
#include <memory>
#include <optional>
#include <vector>

#include "bindings/gil.h"
#include "bindings/values.h"
#include "sensor/readout.h"

namespace nb = nanobind;

namespace evs {

using TimesIn = Array<const int64_t, 1>;
using ClockArray = Array<int64_t, 1>;
using Times = nb::ndarray<nb::numpy, int64_t, nb::ndim<1>>;

class BoundReadout {
 public:
  explicit BoundReadout(ReadoutSettings settings) : readout_(std::move(settings)) {}

  // What waits, as Python has it. Throws std::invalid_argument where a state has another size.
  static std::vector<Request> requests_of(const ClockArray& clock, const BytesIn& waiting,
                                          const TimesIn& due_ns) {
    if (clock.shape(0) != CLOCK_SIZE) {
      throw std::invalid_argument("the clock has another length");
    }
    if (waiting.shape(0) != due_ns.shape(0) * sizeof(Event)) {
      throw std::invalid_argument("each event waits for a moment");
    }
    std::vector<Request> requests(due_ns.shape(0));
    for (size_t i = 0; i < requests.size(); i++) {
      requests[i].ns = due_ns.data()[i];
      std::memcpy(&requests[i].event, waiting.data() + i * sizeof(Event), sizeof(Event));
    }
    return requests;
  }

  // The same for Python: events that wait, and the moment of each.
  static std::pair<Bytes, Times> arrays_of(const std::vector<Request>& requests) {
    std::unique_ptr<Event[]> left(new Event[requests.size()]);
    std::unique_ptr<int64_t[]> times(new int64_t[requests.size()]);
    for (size_t i = 0; i < requests.size(); i++) {
      left[i] = requests[i].event;
      times[i] = requests[i].ns;
    }
    return {owned<Bytes>(std::move(left), requests.size()),
            owned<Times>(std::move(times), requests.size())};
  }

  // Read out the events of a tick; needs no GIL. In/out: the clock, which stays as it is if an
  // error is thrown, and what waits. Out: the events that are handed out.
  void step(const Event* events, size_t count, int64_t* clock, std::vector<Request>& requests,
            int64_t t_begin_us, int64_t t_end_us, EventBuffer& out) {
    ReadoutClock numbers;
    std::memcpy(numbers, clock, sizeof(numbers));
    readout_.step(events, count, numbers, requests, t_begin_us, t_end_us, out);
    std::memcpy(clock, numbers, sizeof(numbers));
  }

  nb::tuple step_tick(BytesIn events, ClockArray clock, BytesIn waiting, TimesIn due_ns,
                      int64_t t_begin_us, int64_t t_end_us) {
    if (events.shape(0) % sizeof(Event) != 0) {
      throw std::invalid_argument("events are 16 bytes each");
    }
    std::vector<Request> requests = requests_of(clock, waiting, due_ns);
    EventBuffer out;
    {
      // release the GIL only for many events: a few take less time than to acquire it again
      std::optional<GilRelease> release;
      if (events.shape(0) + waiting.shape(0) > FEW * sizeof(Event)) release.emplace();
      step(reinterpret_cast<const Event*>(events.data()), events.shape(0) / sizeof(Event),
           clock.data(), requests, t_begin_us, t_end_us, out);
    }
    auto [left, times] = arrays_of(requests);
    return nb::make_tuple(owned<Bytes>(std::move(out.events), out.count), left, times);
  }

 private:
  static constexpr size_t FEW = 1000;

  Readout readout_;
};

}  // namespace evs
