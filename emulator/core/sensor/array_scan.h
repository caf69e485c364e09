// The scanning readout of a DVXplorer: at every multiple of scan_ns the whole array is latched and
// read, row by row, and its events are stamped with the time of the latch. A pixel holds its first
// event until then and loses all others ("scan").
#pragma once

#include <cstdint>
#include <vector>

#include "pixel_latches.h"
#include "readout_state.h"

namespace evs {

// In: requests [0, due), first those that pixels hold, then the others by time, all <= end_ns.
// Calls `stage.read` in order of time. Out: `latches` with the requests that were not read.
template <class Stage>
void run_scan(int64_t scan_ns, const std::vector<Request>& requests, size_t due, int64_t end_ns,
              ReadoutClock& clock, PixelLatches& latches, Stage& stage) {
  // all latched requests belong to one scan, the first at or after them
  int64_t scan = 0;
  auto read_all = [&] {
    latches.take_all([&](uint32_t index) { stage.read(scan, requests[index].event); });
  };
  bool any = false;
  for (size_t i = 0; i < due; i++) {
    if (!any || requests[i].ns > scan) {
      if (any) read_all();
      scan = ceil_div(requests[i].ns, scan_ns) * scan_ns;
      any = true;
    }
    const Event& event = requests[i].event;
    if (!latches.set(event.x, event.y, static_cast<uint32_t>(i))) clock[DropScan]++;
  }
  if (any && scan <= end_ns) read_all();
}

}  // namespace evs
