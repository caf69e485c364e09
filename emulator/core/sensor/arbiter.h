// The asynchronous row arbiter of a DAVIS (word-serial address events: Boahen, IEEE TCAS-II 47(5),
// 2000; Brandli et al., JSSC 49(10), 2014).
//
// A pixel with an event requests its row. When the arbiter is free, it grants the next requesting
// row after the one it served last, so that none starves (real arbiter trees are fair on average
// only). A row access takes row_ns, with a jitter of jitter_ns. Then the events of the row are
// latched and stamped with that time: as in a DAVIS, all events of a row access share one stamp.
// They are sent column by column, from the left or the right as the access number draws, and each
// keeps the arbiter busy for column_ns. A waiting pixel holds one event; others until the latch are
// lost ("busy").
//
// The stamps of pixels are whole us. A request comes up to phase_ns before its stamp, evenly
// spread, so that events of one us do not come in the order of their rows, and rows may share one.
#pragma once

#include <cstddef>
#include <cstdint>
#include <limits>
#include <vector>

#include "sensor/pixel_latches.h"
#include "sensor/random.h"
#include "sensor/readout_state.h"
#include "sensor/row_access_times.h"

namespace evs {

// In: requests [0, first) are latched already, [first, due) follow by time, all <= end_ns. Calls
// `stage.read` in order of time. Out: `latches` with the requests that were not read.
template <class Stage>
void run_arbiter(const ArbiterTimes& times, RowAccessTimes& access_times, const Request* requests,
                 size_t first, size_t due, int64_t end_ns, ReadoutClock& clock,
                 PixelLatches& latches, Stage& stage) {
  const uint64_t key = term_key(static_cast<uint64_t>(clock[Seed]), kTermArbiter);
  const uint64_t column_key = term_key(static_cast<uint64_t>(clock[Seed]), kTermColumns);
  size_t next = 0, held = 0;
  const auto request_next = [&] {
    const Event& event = requests[next].event;
    if (latches.set(event.x, event.y, static_cast<uint32_t>(next))) {
      held++;
    } else {
      clock[DropBusy]++;
    }
    next++;
  };
  // when the next request comes; after the tick if there is none
  const auto next_ns = [&] {
    return next < due ? requests[next].ns : std::numeric_limits<int64_t>::max();
  };
  const auto request_until = [&](int64_t ns) {
    while (next_ns() <= ns) request_next();
  };
  while (next < first) request_next();

  // the state in local variables, which the compiler keeps in registers
  int64_t free_ns = clock[FreeNs], last_row = clock[LastRow], row = clock[AccessRow],
          latch_ns = clock[LatchNs], accesses = clock[Accesses];
  for (;;) {
    // grant the next requesting row
    if (row < 0) {
      int64_t now = free_ns;
      if (now > end_ns) break;
      request_until(now);
      if (held == 0) {
        // no row waits: jump to the next request
        if (next == due) break;
        now = requests[next].ns;
        const int64_t alone_ns = now + access_times.duration_ns(times, key, accesses);
        if (alone_ns <= end_ns && (next + 1 == due || requests[next + 1].ns > alone_ns)) {
          // no other comes before its latch
          const Event& event = requests[next].event;
          stage.read(alone_ns, event);
          next++;
          accesses++;
          latch_ns = alone_ns;
          free_ns = alone_ns + times.column_ns;
          last_row = event.y;
          continue;
        }
        request_until(now);
      }
      row = static_cast<int64_t>(latches.row_after(last_row));
      latch_ns = now + access_times.duration_ns(times, key, accesses);
      accesses++;
    }
    // latch the row and send its events
    if (latch_ns > end_ns) break;
    request_until(latch_ns);
    const auto from_right = [&] {
      return (hash(column_key, static_cast<uint64_t>(accesses)) & 1) != 0;
    };
    const auto sent = latches.take_row(static_cast<size_t>(row), from_right);
    for (uint32_t index : sent) stage.read(latch_ns, requests[index].event);
    held -= sent.size();
    free_ns = latch_ns + static_cast<int64_t>(sent.size()) * times.column_ns;
    last_row = row;
    row = -1;
  }
  request_until(end_ns);
  clock[FreeNs] = free_ns;
  clock[LastRow] = last_row;
  clock[AccessRow] = row;
  clock[LatchNs] = latch_ns;
  clock[Accesses] = accesses;
}

}  // namespace evs
