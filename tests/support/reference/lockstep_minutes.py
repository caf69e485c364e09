"""Minutes of simulated time in lock-step, in a program of its own, and what must be true of it."""

from __future__ import annotations

import json
import subprocess
import sys

from reference.memory import PEAK

PROGRAM = (
    PEAK
    + """
import json
import mujoco, numpy as np
from evs.emulator import ClosedLoop
from evs.emulator.config import SensorConfig
from evs.emulator.config.schema import DelayConfig

XML = '''<mujoco><option timestep=".001"/><worldbody><light pos="0 -1 3"/>
<geom type="plane" size="3 3 1" rgba=".3 .3 .3 1"/>
<camera name="front" pos="0 -2 .6" xyaxes="1 0 0 0 .2 1"/>
<body pos="0 0 .8"><joint name="swing" axis="0 1 0" damping=".02"/>
<geom type="capsule" fromto="0 0 0 .4 0 0" size=".04" rgba=".9 .9 .9 1"/></body></worldbody>
<actuator><motor joint="swing" gear=".1"/></actuator>
<sensor><jointpos name="angle" joint="swing"/></sensor></mujoco>'''
side, ticks = (int(word) for word in sys.argv[1:])
delays = DelayConfig(transport_us=2500, transport_jitter_us=700.0, drop_share=0.01, control_us=1500)
loop = ClosedLoop(mujoco.MjModel.from_xml_string(XML), sensor=SensorConfig("dvs128", width=side,
            height=side), threads=1, delays=delays, limits={"angle": (-1e9, 1e9)}, max_s=3600.0)
seen = loop.reset(seed=2)
packets = events = 0
peaks, at = [], max(1, ticks // 10)
push = np.zeros(1)
for tick in range(1, ticks + 1):
    push[0] = 1.0 if seen.velocity[0] > 0 else -0.9
    seen = loop.step(push)
    assert seen.t_us == 1000 * tick and not seen.done
    packets += len(seen.packets)
    events += sum(map(len, seen.packets))
    if tick % at == 0:
        peaks.append(peak_kib())
waiting = len(loop._links.links["packets", 0].waiting)
print(json.dumps({"peaks": peaks, "packets": packets, "events": events, "waiting": waiting,
    "dropped": loop.dropped["front"], "dropped_events": loop.events_dropped,
    "camera": [loop.world.cameras[0].events, loop.world.tick], "t_us": seen.t_us}))
"""
)


def run(side: int, ticks: int) -> dict[str, object]:
    """What the program says of so many ticks of a square sensor."""
    command = [sys.executable, "-c", PROGRAM, str(side), str(ticks)]
    ended = subprocess.run(command, check=True, capture_output=True, text=True, timeout=1800)
    said: dict[str, object] = json.loads(ended.stdout)
    return said


def check(said: dict[str, object], ticks: int) -> None:
    """Every tick gave its packet, and the tenths after the first took no memory more."""
    assert said["t_us"] == 1000 * ticks
    events, done = said["camera"]  # type: ignore[misc]
    assert done == ticks
    # each is here, lost and counted, or on its way
    assert said["packets"] + said["dropped"] + said["waiting"] == ticks  # type: ignore[operator]
    assert said["waiting"] < 12  # type: ignore[operator]
    assert 0 <= events - said["events"] - said["dropped_events"] < 2000  # type: ignore[operator]
    peaks = said["peaks"]
    # KiB; a quarter of what an object of 16 bytes kept in each tick would be, and some pages
    assert peaks[-1] - peaks[0] < 16 * 0.9 * ticks / 1024 / 4 + 256  # type: ignore[index]
