// The scanning readout of a DVXplorer. A scan begins at a multiple of scan_ns: the whole array is
// held, and its columns are read one after another, each column_ns after the one before. An event
// is stamped when its column is read. A pixel holds its first event until the array is held, and
// loses all others ("scan").
//
// Not every scan is read: only those whose number is a multiple of `every`, and a scan with more
// than `events` events takes as many further scans as it needs to read them.
#pragma once

#include <algorithm>
#include <cstdint>
#include <vector>

#include "sensor/pixel_latches.h"
#include "sensor/readout_state.h"

namespace evs {

struct ScanTimes {
  int64_t scan_ns = 0;
  int64_t column_ns = 0;  // 0: the whole array at once, row by row; times the width <= scan_ns
  bool from_right = false;
  int64_t every = 1;
  int64_t events = 0;  // 0: any number
};

// Sort the requests from `first` on by time, which rises from column to column; rows stay in order.
inline void sort_by_column(std::vector<Request>& reading, size_t first, int width, bool from_right,
                           std::vector<Request>& sorted, std::vector<size_t>& ends) {
  const auto begin = reading.begin() + static_cast<ptrdiff_t>(first);
  const size_t count = reading.size() - first;
  const size_t columns = static_cast<size_t>(width);
  if (count < columns / 8) {
    std::stable_sort(begin, reading.end(),
                     [](const Request& a, const Request& b) { return a.ns < b.ns; });
    return;
  }
  // count the events of each column, in the order in which columns are read
  const auto place = [&](const Request& request) {
    const size_t x = static_cast<size_t>(request.event.x);
    return from_right ? columns - 1 - x : x;
  };
  ends.assign(columns + 1, 0);
  for (size_t i = 0; i < count; i++) ends[place(begin[static_cast<ptrdiff_t>(i)]) + 1]++;
  for (size_t x = 0; x < columns; x++) ends[x + 1] += ends[x];
  sorted.resize(count);
  for (size_t i = 0; i < count; i++) {
    const Request& request = begin[static_cast<ptrdiff_t>(i)];
    sorted[ends[place(request)]++] = request;
  }
  std::copy(sorted.begin(), sorted.end(), begin);
}

// In: requests [0, due), first those that pixels hold, then the others by time, all <= end_ns.
// In/out: `reading`, events of a scan whose column is still to be read. Calls `stage.read` in order
// of time. Out: `latches` with the requests that wait for a scan.
template <class Stage>
void run_scan(const ScanTimes& times, int width, const std::vector<Request>& requests, size_t due,
              int64_t end_ns, ReadoutClock& clock, PixelLatches& latches,
              std::vector<Request>& reading, Stage& stage) {
  const auto read_columns = [&] {
    size_t read = 0;
    for (; read < reading.size() && reading[read].ns <= end_ns; read++) {
      stage.read(reading[read].ns, reading[read].event);
    }
    reading.erase(reading.begin(), reading.begin() + static_cast<ptrdiff_t>(read));
  };
  std::vector<Request> sorted;
  std::vector<size_t> ends;
  // all latched requests belong to one scan, the first at or after them that is read
  int64_t scan = 0;
  const auto hold_array = [&] {
    const size_t before = reading.size();
    latches.take_all([&](uint32_t index) {
      const Event& event = requests[index].event;
      const int64_t columns = (times.from_right ? width - 1 - event.x : event.x) + 1;
      reading.push_back(Request{scan * times.scan_ns + columns * times.column_ns, event});
    });
    if (times.column_ns > 0) sort_by_column(reading, before, width, times.from_right, sorted, ends);
    const int64_t count = static_cast<int64_t>(reading.size() - before);
    clock[NEXT_SCAN] = scan + (times.events > 0 ? ceil_div(count, times.events) : 1);
    read_columns();
  };
  read_columns();
  bool any = false;
  for (size_t i = 0; i < due; i++) {
    const int64_t ns = requests[i].ns;
    if (!any || ns > scan * times.scan_ns) {
      if (any) hold_array();
      scan = std::max(ceil_div(ns, times.scan_ns), clock[NEXT_SCAN]);
      scan = ceil_div(scan, times.every) * times.every;
      any = true;
    }
    const Event& event = requests[i].event;
    if (!latches.set(event.x, event.y, static_cast<uint32_t>(i))) clock[DROP_SCAN]++;
  }
  if (any && scan * times.scan_ns <= end_ns) hold_array();
}

}  // namespace evs
