// The asynchronous row arbiter of a DAVIS (word-serial address events: Boahen, IEEE TCAS-II 47(5),
// 2000; Brandli et al., JSSC 49(10), 2014).
//
// A pixel with an event requests its row. When the arbiter is free, it grants the next requesting
// row after the one it served last, so that none starves (real arbiter trees are fair on average
// only). A row access takes row_ns, with a jitter of jitter_ns. Then the events of the row are
// latched and stamped with that time: as in a DAVIS, all events of a row access share one stamp.
// They are sent column by column from the left, and each keeps the arbiter busy for column_ns. A
// waiting pixel holds one event; others until the latch are lost ("busy").
#pragma once

#include <cstdint>
#include <vector>

#include "normal.h"
#include "pixel_latches.h"
#include "readout_state.h"
#include "row_access_times.h"

namespace evs {

// In: requests [0, first) are latched already, [first, due) follow by time, all <= end_ns. Calls
// `stage.read` in order of time. Out: `latches` with the requests that were not read.
template <class Stage>
void run_arbiter(const ArbiterTimes& times, RowAccessTimes& access_times,
                 const std::vector<Request>& requests, size_t first, size_t due, int64_t end_ns,
                 ReadoutClock& clock, PixelLatches& latches, Stage& stage) {
  const uint64_t key = term_key(static_cast<uint64_t>(clock[Seed]), kTermArbiter);
  size_t next = 0;
  auto request = [&](size_t i) {
    const Event& event = requests[i].event;
    if (!latches.set(event.x, event.y, static_cast<uint32_t>(i))) clock[DropBusy]++;
  };
  auto request_until = [&](int64_t ns) {
    for (; next < due && requests[next].ns <= ns; next++) request(next);
  };
  for (; next < first; next++) request(next);

  for (;;) {
    // grant the next requesting row
    if (clock[AccessRow] < 0) {
      int64_t now = clock[FreeNs];
      if (now > end_ns) break;
      request_until(now);
      int row = latches.row_after(clock[LastRow]);
      if (row < 0) {
        // no row waits: jump to the next request
        if (next == due) break;
        now = requests[next].ns;
        request_until(now);
        row = latches.row_after(clock[LastRow]);
      }
      clock[LatchNs] = now + access_times.duration_ns(times, key, clock[Accesses]);
      clock[Accesses]++;
      clock[AccessRow] = row;
    }
    // latch the row and send its events
    if (clock[LatchNs] > end_ns) break;
    request_until(clock[LatchNs]);
    int64_t sent = 0;
    latches.take_row(static_cast<size_t>(clock[AccessRow]), [&](uint32_t index) {
      stage.read(clock[LatchNs], requests[index].event);
      sent++;
    });
    clock[FreeNs] = clock[LatchNs] + sent * times.column_ns;
    clock[LastRow] = clock[AccessRow];
    clock[AccessRow] = -1;
  }
  request_until(end_ns);
}

}  // namespace evs
