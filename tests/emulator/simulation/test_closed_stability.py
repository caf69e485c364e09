"""Loops at the edge of stability: the longest delay that a gain bears is known in closed form.

An integrator with proportional control over a delay of n ticks is x' = x - a x(n ticks ago), where
a = K h. It is stable for 0 < a < 2 cos(n pi / (2 n + 1)) and for no other a (Levin and May 1976),
and its growth is that of the largest root of z^(n + 1) - z^n + a.
"""

from __future__ import annotations

import math

import mujoco
import numpy as np
import pytest

from evs.emulator import ClosedLoop
from evs.emulator.config import SensorConfig
from evs.emulator.config.schema import DelayConfig

pytestmark = pytest.mark.integration

TICK_US = 1000
GEAR = 1e9
"""encoders say the joint's way times the gear"""
# a body in honey: its speed is its force over the damping, to a part in a million
HONEY = """
<mujoco>
  <option timestep=".001" gravity="0 0 0"/>
  <worldbody>
    <camera name="eye" pos="0 -1 0" xyaxes="1 0 0 0 0 1"/><light pos="0 -1 1"/>
    <body><joint name="x" type="slide" axis="1 0 0" damping="1e9"/><geom size=".1" mass="1"/></body>
  </worldbody>
  <actuator><motor joint="x" gear="1e9"/></actuator>
  <keyframe><key name="off" qpos="1e-9"/></keyframe>
</mujoco>
"""


def course(gain_hz, delays, ticks):
    """(ticks,) position under u = -K x, where x is what the newest packet that came belongs to."""
    model = mujoco.MjModel.from_xml_string(HONEY)
    loop = ClosedLoop(model, sensor=SensorConfig("ideal", width=2, height=2), delays=delays)
    seen = loop.reset(keyframe="off")
    known = {0: seen.position[0] / GEAR}
    newest_us, positions = 0, []
    for _ in range(ticks):
        # a perfect tracker: it knows where the body was when the packet's tick ended
        newest_us = max([newest_us, *(packet.time_end_us for packet in seen.packets)])
        seen = loop.step([-gain_hz * known[newest_us]])
        known[seen.t_us] = seen.position[0] / GEAR
        positions.append(known[seen.t_us])
    return np.array(positions)


def growth_of(a, n):
    """Of the largest root, a tick."""
    return max(abs(np.roots([1.0, -1.0, *[0.0] * (n - 1), a] if n else [1.0, a - 1.0])))


def measured(positions):
    """Growth a tick, from the largest values in two windows far apart."""
    window = len(positions) // 5
    early = np.abs(positions[2 * window : 3 * window]).max()
    late = np.abs(positions[4 * window : 5 * window]).max()
    return (late / early) ** (1 / (2 * window))


WAYS = {
    0: DelayConfig(),
    1: DelayConfig(control_us=1),
    2: DelayConfig(transport_us=2000),
    3: DelayConfig(transport_us=1000, control_us=1500),
    5: DelayConfig(transport_us=2001, control_us=2000),
    8: DelayConfig(control_us=8000),
    13: DelayConfig(transport_us=13_000),
}


@pytest.mark.parametrize("n", WAYS)
def test_the_loop_is_stable_up_to_the_limit_and_not_beyond(n):
    limit = 2 * math.cos(n * math.pi / (2 * n + 1))
    for share in (0.9, 0.97, 1.03, 1.1):
        a = share * limit
        # until it has grown or shrunk by e^5, and 20 delays at least
        ticks = 20 * (n + 1) + min(4000, round(5 / abs(math.log(growth_of(a, n)))))
        growth = measured(course(a * 1e6 / TICK_US, WAYS[n], ticks))
        assert (growth < 1.0) == (share < 1.0), (share, growth)
        # the roots on the unit circle are a pair, so the largest values beat a little
        assert math.log(growth) == pytest.approx(math.log(growth_of(a, n)), rel=0.06, abs=2e-5)


def test_one_tick_of_delay_more_is_one_too_many():
    # stable over 4 ticks, not over 5
    a = (math.cos(4 * math.pi / 9) + math.cos(5 * math.pi / 11)) * 1.0
    assert 2 * math.cos(5 * math.pi / 11) < a < 2 * math.cos(4 * math.pi / 9)
    gain_hz = a * 1e6 / TICK_US
    assert measured(course(gain_hz, DelayConfig(transport_us=4000), 400)) < 1.0
    # a microsecond too late for the decision at 4 ms is a whole tick
    assert measured(course(gain_hz, DelayConfig(transport_us=4001), 400)) > 1.0
