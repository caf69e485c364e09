"""The same loop again: in this process and another, and from its recorded controls."""

from __future__ import annotations

import hashlib
import json
import subprocess
import sys

import mujoco
import numpy as np
import pytest

from evs.emulator import ClosedLoop
from evs.emulator.config import SensorConfig
from evs.emulator.config.schema import DelayConfig

pytestmark = pytest.mark.integration

POLE = """
<mujoco>
  <option timestep=".001"/>
  <worldbody>
    <light pos="0 -1 3"/>
    <geom type="plane" size="3 3 1" rgba=".3 .3 .3 1"/>
    <camera name="front" pos="0 -2.2 .5" xyaxes="1 0 0 0 .1 1" fovy="40"/>
    <body pos="0 0 .2"><joint name="slide" type="slide" axis="1 0 0" damping=".5" range="-1 1"
        limited="true"/>
      <geom type="box" size=".12 .1 .04" rgba=".2 .2 .2 1" mass=".5"/>
      <body pos="0 0 .04"><joint name="tilt" axis="0 1 0" damping=".002"/>
        <geom type="capsule" fromto="0 0 0 0 0 .6" size=".025" rgba="1 1 1 1" mass=".1"/>
      </body></body>
  </worldbody>
  <actuator><motor joint="slide" gear="1" ctrlrange="-20 20"/></actuator>
  <sensor><jointpos name="tilt" joint="tilt"/></sensor>
</mujoco>
"""
SENSOR = SensorConfig("dvs128", width=32, height=24, shot_noise_rate_hz=3.0)
DELAYS = DelayConfig(transport_us=1000, transport_jitter_us=300.0, drop_share=0.01, control_us=500)


class Follower:
    """Pushes the cart to where events are, and back to its place: it need not be good at it."""

    def __init__(self):
        self.column = 15.5

    def __call__(self, seen):
        for packet in seen.packets:
            if len(packet):
                self.column += 0.05 * (float(packet.events["x"].mean()) - self.column)
        push = 0.4 * (self.column - 15.5) - 6.0 * seen.position[0] - 2.0 * seen.velocity[0]
        return [float(np.clip(push, -20.0, 20.0))]


def make():
    model = mujoco.MjModel.from_xml_string(POLE)
    return ClosedLoop(model, "front", sensor=SENSOR, delays=DELAYS, threads=1)


def run(loop, seconds, decide, seed=21):
    """Digest of everything that was seen and of all controls; the controls; events."""
    digest, controls, events = hashlib.sha256(), [], 0
    seen = loop.reset(seed=seed)
    while seen.t_us < seconds * 1e6:
        ctrl = decide(seen)
        controls.append(ctrl)
        seen = loop.step(ctrl)
        digest.update(np.array([*ctrl, *seen.position, *seen.velocity, seen.t_us]).tobytes())
        for packet in seen.packets:
            digest.update(packet.seq.to_bytes(8, "little") + packet.events.tobytes())
            events += len(packet)
    return digest.hexdigest(), np.array(controls), events


ELSEWHERE = """
import importlib.util, json, sys
import numpy as np
spec = importlib.util.spec_from_file_location("replay", sys.argv[1])
replay = importlib.util.module_from_spec(spec)
spec.loader.exec_module(replay)
seconds = float(sys.argv[2])
digest, controls, events = replay.run(replay.make(), seconds, replay.Follower())
recorded = iter(controls)
again = replay.run(replay.make(), seconds, lambda seen: next(recorded))[0] if seconds < 5 else None
print(json.dumps([digest, controls.tolist(), events, again]))
"""


def elsewhere(seconds):
    command = [sys.executable, "-c", ELSEWHERE, __file__, str(seconds)]
    return json.loads(subprocess.run(command, check=True, capture_output=True, text=True).stdout)


def test_recorded_controls_give_the_recorded_events_here_and_elsewhere():
    loop = make()
    digest, controls, events = run(loop, 2.0, Follower())
    assert events > 2000
    assert np.ptp(controls) > 1.0
    recorded = iter(controls)
    assert run(loop, 2.0, lambda _: next(recorded)) == (digest, pytest.approx(controls), events)
    there = elsewhere(2.0)
    assert (there[0], there[2], there[3]) == (digest, events, digest)
    np.testing.assert_array_equal(there[1], controls)
    # and it would show: one control changed in its last bit
    changed = controls.copy()
    changed[1000] = np.nextafter(changed[1000], np.inf)
    altered = iter(changed)
    assert run(loop, 2.0, lambda _: next(altered))[0] != digest


@pytest.mark.campaign
def test_thirty_seconds_of_a_closed_loop_are_the_same_in_another_process():
    digest, controls, events = run(make(), 30.0, Follower())
    assert len(controls) == 30_000
    assert events > 20_000
    there = elsewhere(30.0)
    assert (there[0], there[2]) == (digest, events)
    np.testing.assert_array_equal(there[1], controls)
