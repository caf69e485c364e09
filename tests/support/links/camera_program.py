"""A camera for the far end to listen to: a sink, a thousand packets a second, until it is told.

    python camera_program.py bus|dv|ros2 EVENTS '{"address": ..., options of the sink}'

Says in one line of JSON where it is, then to each line on its standard input how it goes; ends
with its report after the line `stop`, or with its input.
"""

from __future__ import annotations

import json
import select
import sys
from pathlib import Path
from typing import Any

import numpy as np

from evs.drivers.bus import Publisher
from evs.drivers.clock import Pacer, monotonic_s
from evs.drivers.dv import DvServer
from evs.drivers.ros2 import Ros2Publisher
from evs.msgs import EventPacket, StreamInfo, make_events

WIDTH, HEIGHT = 346, 260
SINKS = {"bus": Publisher, "dv": DvServer, "ros2": Ros2Publisher}


def body(count: int) -> Any:
    """Events of one packet: the first is at its beginning, so that files tell packets apart."""
    stamps = np.sort(np.random.default_rng(0).integers(1, 1001, count))
    stamps[:1] = 1
    return make_events(stamps, stamps % WIDTH, stamps % HEIGHT, stamps % 2)


def memory_kb() -> int:
    """What this process holds in memory now."""
    return int(Path("/proc/self/statm").read_text().split()[1]) * 4


def main() -> None:
    kind, count, options = sys.argv[1], int(sys.argv[2]), json.loads(sys.argv[3])
    sink: Any = SINKS[kind](**options)
    sink.open([StreamInfo(WIDTH, HEIGHT, "cam")])
    if kind == "bus":
        where = {"events": sink.address, "control": sink.control_address}
        where["latest"] = sink.latest_address
    else:
        where = sink.ports if kind == "dv" else {}
    print(json.dumps(where), flush=True)
    events, pacer = body(count), Pacer(1.0)
    seq, slowest_s = 0, 0.0
    while True:
        if select.select([sys.stdin], [], [], 0)[0]:
            if sys.stdin.readline() in ("stop\n", ""):
                break
            told = {"seq": seq, "late_s": pacer.late_s, "slowest_s": slowest_s}
            listening = {
                "bus": lambda: sink.subscribers,
                "dv": lambda: listeners(sink),
                "ros2": lambda: sink.readers,
            }[kind]()
            print(json.dumps({**told, "memory_kb": memory_kb(), "here": listening}), flush=True)
        pacer.wait_until(1000 * seq)
        now = events.copy()
        now["t"] += 1000 * seq
        begin_s = monotonic_s()
        sink.write(EventPacket(seq, 1000 * seq, 1000 * seq + 1000, WIDTH, HEIGHT, now, "cam"))
        slowest_s = max(slowest_s, monotonic_s() - begin_s)
        seq += 1
    closing_s = monotonic_s()
    report = sink.close()
    closing_s = monotonic_s() - closing_s
    print(json.dumps({"seq": seq, "slowest_s": slowest_s, "closing_s": closing_s, **report}))


def listeners(sink: DvServer) -> int:
    """Clients whom the server believes to be there."""
    return sum(len(port.clients) for port in sink._ports.values())


if __name__ == "__main__":
    main()
