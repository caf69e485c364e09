// The scan of a DVXplorer: at every multiple of scan_ns the whole array is held and read, row by
// row, and everything is stamped with the moment of the hold. A pixel that has seen its event waits
// for the scan and is blind: its first event counts, what else it makes until then is lost
// ("scan").
#pragma once

#include <cstdint>
#include <vector>

#include "pixel_latches.h"
#include "readout_state.h"

namespace evs {

// In: requests [0, due): first what was held, then others by their moments, all <= end_ns. Out:
// `stage.read` in order of time; `held` is what was not read.
template <class Stage>
void run_scan(int64_t scan_ns, const std::vector<Request>& requests, size_t due, int64_t end_ns,
              ReadoutClock& clock, HeldPixels& held, Stage& stage) {
  // what is held at once belongs to one scan: the first at or after its requests
  int64_t scan = 0;
  auto read_all = [&] {
    held.take_all([&](uint32_t place) { stage.read(scan, requests[place].event); });
  };
  bool any = false;
  for (size_t i = 0; i < due; i++) {
    if (!any || requests[i].ns > scan) {
      if (any) read_all();
      scan = ceil_div(requests[i].ns, scan_ns) * scan_ns;
      any = true;
    }
    const Event& event = requests[i].event;
    if (!held.hold(event.x, event.y, static_cast<uint32_t>(i))) clock[DropScan]++;
  }
  if (any && scan <= end_ns) read_all();
}

}  // namespace evs
