"""Delays of a loop: when a flash is first seen, when a control first acts, what gets lost."""

from __future__ import annotations

import mujoco
import numpy as np
import pytest

import evs
from evs.emulator import ClosedLoop
from evs.emulator.config import SensorConfig
from evs.emulator.config.schema import DelayConfig, LimitConfig, LoopConfig
from evs.emulator.simulation.delayed_links import Link
from evs.msgs import EvsError

# a slider that can be pushed, and a lid in front of a bright wall
SLIDER = """
<mujoco>
  <option timestep=".001" gravity="0 0 0"/>
  <visual><headlight ambient="1 1 1" diffuse="0 0 0" specular="0 0 0"/></visual>
  <worldbody>
    <camera name="eye" pos="0 0 0" xyaxes="1 0 0 0 0 1"/>
    <geom name="wall" type="box" pos="0 5 0" size="9 .1 9" rgba="1 1 1 1"/>
    <body name="lid" mocap="true" pos="0 2 0">
      <geom type="box" size="2 .1 2" rgba=".1 .1 .1 1"/></body>
    <body pos="0 -3 0"><joint name="x" type="slide" axis="1 0 0"/><geom size=".1" mass="1"/></body>
  </worldbody>
  <actuator><motor joint="x"/></actuator>
</mujoco>
"""
PIXEL = SensorConfig(preset="ideal", width=8, height=8)


@pytest.fixture(scope="module")
def slider():
    return mujoco.MjModel.from_xml_string(SLIDER)


def first_seen_us(loop, tick, ticks=1, most=60):
    """The decision at which the events of a flash in tick number `tick` (from 1) first arrive."""
    seen = loop.reset()
    for _ in range(most):
        # decision by decision, so that the lid opens between two ticks: in the second of them
        if loop.t_us == (tick - 1) * loop.tick_us:
            loop.world.data.mocap_pos[0, 2] = 100.0
        seen = loop.step([0.0], ticks=ticks)
        stamps = [packet.events["t"] for packet in seen.packets if len(packet)]
        if stamps:
            assert all(t.max() <= seen.t_us for t in stamps)
            return seen.t_us, int(min(t.min() for t in stamps))
    raise AssertionError("the flash was never seen")


@pytest.mark.parametrize("transport_us", [0, 1, 999, 1000, 1001, 2500, 7000])
@pytest.mark.parametrize("latency_us", [0.0, 300.0, 1000.0, 2200.0])
def test_a_flash_is_first_seen_at_the_declared_latency(slider, latency_us, transport_us):
    pixel = SensorConfig(preset="ideal", width=8, height=8, latency_us=latency_us)
    loop = ClosedLoop(slider, sensor=pixel, delays=DelayConfig(transport_us=transport_us))
    decision_us, stamp_us = first_seen_us(loop, tick=5)
    # the light changes during tick 5, (4000, 5000] us: the first crossing is in it
    assert 4000 + latency_us < stamp_us <= 5000 + latency_us
    # its packet is that of the tick its stamp lies in
    packet_end_us = -(-stamp_us // 1000) * 1000
    assert decision_us == -(-(packet_end_us + transport_us) // 1000) * 1000


def test_decisions_that_are_rare_see_it_at_the_first_one_after(slider):
    loop = ClosedLoop(slider, sensor=PIXEL, delays=DelayConfig(transport_us=2500))
    # of tick 5, arrives at 7500 us; decisions are at 4000, 8000, ...
    assert first_seen_us(loop, tick=5, ticks=4)[0] == 8000


def test_frames_and_imu_samples_take_the_same_way(slider):
    sensor = SensorConfig(
        "davis346", width=8, height=8,
        aps=evs.ApsConfig(enabled=True, rate_hz=200.0, exposure_us=1000, row_us=0.0),
        imu=evs.ImuConfig(enabled=True),
    )  # fmt: skip

    def arrivals(transport_us):
        loop = ClosedLoop(slider, sensor=sensor, delays=DelayConfig(transport_us=transport_us))
        loop.reset()
        found = {"frames": {}, "imu": {}}
        for _ in range(30):
            seen = loop.step()
            for stream, first in found.items():
                first.update({one.seq: seen.t_us for one in getattr(seen, stream)})
            assert all(frame.end_us <= seen.t_us for frame in seen.frames)
            assert all(packet.samples["t"].max() <= seen.t_us for packet in seen.imu)
        return found

    at_once, late = arrivals(0), arrivals(3000)
    for stream in at_once:
        assert len(late[stream]) > 3
        assert late[stream] == {seq: at_once[stream][seq] + 3000 for seq in late[stream]}


@pytest.mark.parametrize("control_us", [0, 1, 999, 1000, 1001, 4000, 5500])
def test_a_control_acts_in_the_first_tick_that_begins_when_it_has_come(slider, control_us):
    loop = ClosedLoop(slider, sensor=PIXEL, delays=DelayConfig(control_us=control_us))
    loop.reset(state=True)
    for _ in range(3):
        loop.step([0.0])
    moved = {}
    for _ in range(10):
        seen = loop.step([1.0] if loop.t_us == 3000 else None)
        moved[seen.t_us] = seen.velocity[0] != 0.0
    acts_us = -(-(3000 + control_us) // 1000) * 1000
    assert moved == {t_us: t_us > acts_us for t_us in moved}
    # semi-implicit Euler on a double integrator, so the whole course is known
    steps = (loop.t_us - acts_us) // 1000
    assert seen.velocity[0] == pytest.approx(1e-3 * steps, rel=1e-9)
    assert seen.position[0] == pytest.approx(1e-6 * steps * (steps + 1) / 2, rel=1e-9)


def test_of_controls_that_come_together_the_last_decision_acts(slider):
    # all of 5 ticks wait for the same beginning, since a decision is every 5 ticks only
    loop = ClosedLoop(slider, sensor=PIXEL, delays=DelayConfig(control_us=10_000))
    loop.reset()
    for force in (1.0, 2.0, 3.0):
        loop.step([force], ticks=5)
    assert loop.t_us == 15_000
    # the first acted from 10 ms on
    assert loop.world.data.ctrl[0] == 1.0
    loop.step(ticks=1)
    assert loop.world.data.ctrl[0] == 2.0


@pytest.mark.slow
def test_what_is_lost_is_counted_and_leaves_a_gap(slider):
    noisy = SensorConfig("dvs128", width=32, height=32, shot_noise_rate_hz=500.0)
    loop = ClosedLoop(slider, sensor=noisy, delays=DelayConfig(drop_share=0.25))
    whole = ClosedLoop(slider, sensor=noisy)
    for one in (loop, whole):
        one.reset(seed=8)
    ticks = 2000
    came = loop.step(ticks=ticks).packets
    every = whole.step(ticks=ticks).packets
    seqs = [packet.seq for packet in came]
    assert loop.dropped == {"eye": ticks - len(came)}
    assert loop.events_dropped == sum(len(p) for p in every if p.seq not in set(seqs)) > 0
    # five standard deviations of the binomial
    assert abs(loop.dropped["eye"] - 0.25 * ticks) < 5 * (ticks * 0.25 * 0.75) ** 0.5
    for packet in came:
        np.testing.assert_array_equal(packet.events, every[packet.seq].events)
    assert whole.dropped == {"eye": 0}
    loop.reset()
    assert loop.dropped == {"eye": 0}
    assert loop.events_dropped == 0


def test_everything_may_get_lost(slider):
    loop = ClosedLoop(slider, sensor=PIXEL, delays=DelayConfig(drop_share=1.0))
    loop.reset()
    assert loop.step(ticks=50).packets == ()
    assert loop.dropped == {"eye": 50}


DELAYS = DelayConfig(
    transport_us=3000, transport_jitter_us=900.0, drop_share=0.1, control_us=2000,
    control_jitter_us=1500.0,
)  # fmt: skip


def course(loop, seed, ticks=120):
    seen = [loop.reset(seed=seed, state=True)]
    for tick in range(ticks):
        loop.world.data.mocap_pos[0, 2] = 100.0 * (tick % 9 < 4)
        seen.append(loop.step([np.sin(tick / 5)]))
    return seen


def test_delays_follow_from_the_seed_and_from_nothing_else(slider):
    loop = ClosedLoop(slider, sensor=PIXEL, delays=DELAYS)
    first = course(loop, 5)
    other = course(loop, 6)
    assert course(loop, 5) == first
    assert course(ClosedLoop(slider, sensor=PIXEL, delays=DELAYS, seed=5), None) == first

    def times(seen):
        return [(one.t_us, packet.seq) for one in seen for packet in one.packets]

    assert times(other) != times(first)
    assert not np.array_equal(first[-1].state, other[-1].state)


def test_nothing_overtakes_and_nothing_comes_before_it_was_sent(slider):
    for seed in range(5):
        last = -1
        for one in course(ClosedLoop(slider, sensor=PIXEL, delays=DELAYS), seed):
            for packet in one.packets:
                assert packet.seq > last
                last = packet.seq
                assert packet.time_end_us <= one.t_us


def test_each_link_of_a_camera_has_delays_of_its_own(slider):
    xml = SLIDER.replace(
        "<camera", '<camera name="other" pos="0 0 0" xyaxes="1 0 0 0 0 1"/><camera'
    )
    loop = ClosedLoop(mujoco.MjModel.from_xml_string(xml), ("eye", "other"), sensor=PIXEL,
                delays=DelayConfig(transport_us=20_000, transport_jitter_us=5000.0))  # fmt: skip
    loop.reset()
    at = {"eye": {}, "other": {}}
    for _ in range(200):
        seen = loop.step()
        for packet in seen.packets:
            at[packet.camera][packet.seq] = seen.t_us
        ends = [packet.time_end_us for packet in seen.packets]
        assert ends == sorted(ends)
    assert at["eye"].keys() >= set(range(150))
    assert at["eye"] != at["other"]


@pytest.mark.parametrize(
    ("delays", "says"),
    [
        (DelayConfig(transport_us=-1), "loop.delays.transport_us is -1; give 0 ... 1000000000 us"),
        (DelayConfig(transport_us=0.5), "loop.delays.transport_us is 0.5; give a whole number"),
        (DelayConfig(drop_share=1.5), r"loop.delays.drop_share is 1.5; give 0 ... 1$"),
        (DelayConfig(control_jitter_us=float("nan")), "loop.delays.control_jitter_us is nan"),
        (1000, "delays= takes a DelayConfig, not 1000"),
    ],
)
def test_delays_without_sense_are_refused(slider, delays, says):
    with pytest.raises(EvsError, match=says):
        ClosedLoop(slider, sensor=PIXEL, delays=delays)


def test_a_pipelines_table_says_the_same():
    config = LoopConfig(max_s=3.0, limits=(LimitConfig("tilt", -1.0, 1.0),), delays=DELAYS)
    assert config.options() == {"limits": {"tilt": (-1.0, 1.0)}, "max_s": 3.0, "delays": DELAYS}
    twice = LoopConfig(limits=(LimitConfig("tilt"), LimitConfig("tilt")))
    with pytest.raises(EvsError, match=r"at loop.limits.1.sensor: 'tilt' has two limits"):
        twice.options()
    with pytest.raises(EvsError, match=r"at loop.limits.0: no bound; give low, high or both"):
        LoopConfig(limits=(LimitConfig("tilt"),)).options()


def test_a_link_holds_back_what_would_overtake():
    link = Link(delay_us=100, jitter_us=1.0, jitter=lambda number: [0, 500, -500, -90][number])
    for number, t_us in enumerate((1000, 1010, 1020, 1030)):
        assert link.send(number, t_us)
    assert [one.arrives_us for one in link.waiting] == [1100, 1610, 1610, 1610]
    assert [one.message for one in link.take(1100)] == [0]
    assert link.take(1609) == []
    assert [one.message for one in link.take(1610)] == [1, 2, 3]
    # nothing arrives before it was sent
    early = Link(delay_us=10, jitter_us=1.0, jitter=lambda _: -50)
    early.send("now", 77)
    assert early.waiting[0].arrives_us == 77
