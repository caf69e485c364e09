// The asynchronous row arbiter of a DAVIS (word-serial address events: Boahen, IEEE TCAS-II 47(5),
// 2000; Brandli et al., JSSC 49(10), 2014).
//
// An event asks for its row. When free, the arbiter goes to the next row that asks, in turn from
// the one it served last, so that none starves (real arbiter trees are fair in the mean only). That
// takes row_ns, more or less by jitter_ns. Then everything that the row's pixels hold is latched
// and stamped with that moment: as in a DAVIS, all events of a row access share its stamp. Sending
// the columns from the left, column_ns each, keeps the arbiter busy. A pixel that waits can hold
// one event only; what else it makes until the latch is lost ("busy").
#pragma once

#include <cstdint>
#include <vector>

#include "normal.h"
#include "pixel_latches.h"
#include "readout_state.h"
#include "row_access_times.h"

namespace evs {

// In: requests [0, first) are held already, [first, due) come by their moments, all <= end_ns.
// Out: `stage.read` in order of time; `held` is what was not read.
template <class Stage>
void run_arbiter(const ArbiterTimes& times, RowTimes& rows, const std::vector<Request>& requests,
                 size_t first, size_t due, int64_t end_ns, ReadoutClock& clock, HeldPixels& held,
                 Stage& stage) {
  const uint64_t key = term_key(static_cast<uint64_t>(clock[Seed]), kTermArbiter);
  size_t next = 0;
  auto ask = [&](size_t i) {
    const Event& event = requests[i].event;
    if (!held.hold(event.x, event.y, static_cast<uint32_t>(i))) clock[DropBusy]++;
  };
  auto ask_until = [&](int64_t ns) {
    for (; next < due && requests[next].ns <= ns; next++) ask(next);
  };
  for (; next < first; next++) ask(next);

  for (;;) {
    if (clock[AccessRow] < 0) {
      int64_t now = clock[FreeNs];
      if (now > end_ns) break;
      ask_until(now);
      int row = held.row_after(clock[LastRow]);
      if (row < 0) {
        // nobody waits: the next request finds the arbiter free
        if (next == due) break;
        now = requests[next].ns;
        ask_until(now);
        row = held.row_after(clock[LastRow]);
      }
      clock[LatchNs] = now + rows.of(times, key, clock[Accesses]);
      clock[Accesses]++;
      clock[AccessRow] = row;
    }
    if (clock[LatchNs] > end_ns) break;
    ask_until(clock[LatchNs]);
    int64_t sent = 0;
    held.take_row(static_cast<size_t>(clock[AccessRow]), [&](uint32_t place) {
      stage.read(clock[LatchNs], requests[place].event);
      sent++;
    });
    clock[FreeNs] = clock[LatchNs] + sent * times.column_ns;
    clock[LastRow] = clock[AccessRow];
    clock[AccessRow] = -1;
  }
  ask_until(end_ns);
}

}  // namespace evs
