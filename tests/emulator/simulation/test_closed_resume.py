"""A loop that is saved at any place and restored elsewhere goes on with the same bytes."""

from __future__ import annotations

import hashlib
import subprocess
import sys
from dataclasses import replace

import mujoco
import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from evs.emulator import ClosedLoop, World
from evs.emulator.config import (
    ApsConfig,
    FlickerConfig,
    ImuConfig,
    ModelConfig,
    ReadoutConfig,
    RenderConfig,
    SensorConfig,
)
from evs.emulator.config.schema import DelayConfig
from evs.msgs import Observation

pytestmark = pytest.mark.property

SKIN = """
<mujoco>
  <option timestep=".001"/>
  <asset><texture name="t" type="2d" builtin="checker" width="32" height="32" rgb1=".2 .2 .2"
    rgb2=".9 .9 .9"/><material name="t" texture="t" texrepeat="6 6"/></asset>
  <worldbody>
    <light name="lamp" pos="0 -1 3"/>
    <geom type="plane" size="3 3 1" material="t"/>
    <camera name="left" pos="0 -2 .6" xyaxes="1 0 0 0 .3 1"/>
    <body name="arm" pos="0 0 .5"><joint name="swing" axis="0 1 0"/>
      <geom type="capsule" fromto="0 0 0 .4 0 .1" size=".06" rgba=".8 .4 .2 1"/>
      <camera name="wrist" pos=".4 0 .3" xyaxes="0 -1 0 .7 0 .7"/>
      <body name="hand" pos=".4 0 .1"><joint name="turn" axis="0 1 0" damping=".1"/>
        <geom type="box" size=".1 .05 .05" pos=".1 0 0"/></body></body>
    <body name="ball" pos=".5 .2 .8"><freejoint/><geom size=".08" rgba=".2 .7 .3 1"/></body>
    <body name="flag" mocap="true" pos="-.5 0 1"><geom type="box" size=".1 .02 .1"/></body>
  </worldbody>
  <deformable><skin name="sleeve" rgba=".3 .3 .9 1" face="0 1 2 0 2 3"
    vertex="0 -.1 .4  .3 -.1 .5  .3 -.1 .9  0 -.1 .8">
    <bone body="arm" bindpos="0 0 .5" bindquat="1 0 0 0" vertid="0 1" vertweight="1 1"/>
    <bone body="hand" bindpos=".4 0 .6" bindquat="1 0 0 0" vertid="2 3" vertweight="1 1"/>
  </skin></deformable>
  <actuator><motor joint="swing" gear="4"/>
    <position joint="turn" kp="3" timeconst=".05"/></actuator>
  <sensor><jointpos name="angle" joint="swing"/></sensor>
</mujoco>
"""


def model_of():
    return mujoco.MjModel.from_xml_string(SKIN)


READOUTS = st.builds(
    ReadoutConfig,
    order=st.sampled_from(["ideal", "arbiter", "scan"]),
    row_ns=st.integers(0, 400),
    column_ns=st.integers(100, 3000),
    jitter_ns=st.sampled_from([0.0, 50.0]),
    scan_us=st.integers(50, 1500),
    erc_rate_mevs=st.sampled_from([0.0, 0.05]),
    bandwidth_mevs=st.sampled_from([0.0, 0.1]),
    fifo=st.sampled_from([8, 65536]),
)
SENSORS = st.builds(
    SensorConfig,
    preset=st.sampled_from(["ideal", "dvs128", "davis346"]),
    width=st.integers(9, 24),
    height=st.integers(7, 18),
    shot_noise_rate_hz=st.sampled_from([0.0, 40.0]),
    refractory_period_s=st.sampled_from([0.0, 0.002]),
    latency_us=st.sampled_from([0.0, 700.0, 2500.0]),
    latency_sigma_us=st.sampled_from([0.0, 300.0]),
    readout=READOUTS,
    aps=st.builds(ApsConfig, enabled=st.booleans(), rate_hz=st.just(170.0),
                  exposure_us=st.integers(300, 5000), row_us=st.just(20.0),
                  shutter=st.sampled_from(["global", "rolling"]), full_well_e=st.just(2000.0)),
    imu=st.builds(ImuConfig, enabled=st.booleans(), rate_hz=st.sampled_from([400.0, 2700.0]),
                  gyroscope_noise_density=st.just(0.01), accelerometer_random_walk=st.just(0.1)),
)  # fmt: skip
RENDERS = st.builds(
    RenderConfig,
    renderer=st.sampled_from(["direct", "path"]),
    spp=st.sampled_from([1, 3]),
    antialiasing=st.sampled_from(["fixed", "adaptive"]),
    flicker=st.sampled_from([(), (FlickerConfig(hz=60.0),)]),
    seeds=st.sampled_from(["fixed", "fresh", "cycle"]),
    cycle_ticks=st.sampled_from([2, 3, 4]),
).map(lambda render: render if render.renderer == "path" else replace(render, seeds="fixed"))
MODELS = st.sampled_from([
    ModelConfig(), ModelConfig(labels=True), ModelConfig(name="adaptive"),
    ModelConfig(name="evsnet"), ModelConfig(name="evsnet", initial_state="zero"),
    ModelConfig(name="evsnet", events_per_tick="many"),
])  # fmt: skip
DELAYS = st.builds(
    DelayConfig,
    transport_us=st.integers(0, 6000),
    transport_jitter_us=st.sampled_from([0.0, 1500.0]),
    drop_share=st.sampled_from([0.0, 0.2]),
    control_us=st.integers(0, 4000),
    control_jitter_us=st.sampled_from([0.0, 800.0]),
)


def a_loop(cameras, delays, seed=0, threads=1):
    world = World(model_of(), seed=seed, threads=threads)
    for name, sensor, render, model in cameras:
        world.add_camera(name, sensor=sensor, render=render, model=model)
    return ClosedLoop.around(world, limits={"angle": (-9.0, 9.0)}, max_s=9.0, delays=delays)


def drive(loop, begin, ticks):
    """Observations of some decisions; what moves depends on the time alone."""
    seen = []
    for tick in range(begin, begin + ticks):
        loop.world.data.mocap_pos[0, 0] = 0.3 * np.sin(tick / 3)
        ctrl = None if tick % 4 == 1 else (np.sin(tick / 5), np.cos(tick / 4))
        seen.append(loop.step(ctrl, ticks=1 + tick % 2))
    return seen


@pytest.mark.slow
@settings(max_examples=60)
@given(
    cameras=st.lists(st.tuples(st.sampled_from(["left", "wrist"]), SENSORS, RENDERS, MODELS),
                     min_size=1, max_size=2, unique_by=lambda one: one[0]),
    delays=DELAYS, cut=st.integers(0, 14), seed=st.integers(-3, 2**40), compress=st.booleans(),
)  # fmt: skip
def test_a_loop_goes_on_where_it_was_saved(cameras, delays, cut, seed, compress):
    loop = a_loop(cameras, delays)
    loop.reset(seed=seed, state=True)
    first = drive(loop, 0, cut)
    blob = loop.save(compress)
    # saving again gives the same, and changes nothing
    assert loop.save(compress) == blob
    seen = [(one.luminance, one.ground_truth().flow) for one in loop.world.cameras if cut]
    rest = drive(loop, cut, 14 - cut)

    # another loop, of another seed, that has been elsewhere, with other threads
    other = a_loop(cameras, delays, seed=77, threads=2)
    other.reset()
    drive(other, 3, 5)
    here = other.restore(blob)
    assert here.packets == ()
    assert other.save(compress) == blob
    for one, (light, flow) in zip(other.world.cameras, seen, strict=cut > 0):
        np.testing.assert_array_equal(one.luminance, light)
        np.testing.assert_array_equal(one.ground_truth().flow, flow)
    assert drive(other, cut, 14 - cut) == rest
    assert (other.dropped, other.events_dropped) == (loop.dropped, loop.events_dropped)
    for one, again in zip(loop.world.cameras, other.world.cameras, strict=True):
        assert (one.events, one.clamps, one.events_dropped, one.info.seed) == (
            again.events, again.clamps, again.events_dropped, again.info.seed,
        )  # fmt: skip
        if cut < 14:
            np.testing.assert_array_equal(one.luminance, again.luminance)
            flow, same = one.ground_truth().flow, again.ground_truth().flow
            np.testing.assert_array_equal(flow, same)
    # and back in the loop that went on
    loop.restore(blob)
    assert drive(loop, cut, 14 - cut) == rest
    # two ways to the same place end in the same bytes
    assert loop.save() == other.save()
    # and a reset is a beginning, whatever the seed was before
    other.reset(seed=seed - 1)
    drive(other, 2, 3)
    other.reset(seed=seed, state=True)
    assert drive(other, 0, cut) == first
    assert other.save(compress) == blob


@given(model=MODELS, cut=st.integers(0, 9))
@settings(max_examples=8)
def test_a_chunk_that_fills_is_saved_too(model, cut):
    chunked = replace(model, name="evsnet", labels=False, chunk=4)

    def world():
        made = World(model_of(), control="random", seed=6)
        made.add_camera("left", sensor=SensorConfig("ideal", width=20, height=12), model=chunked)
        return made

    def packets(one, ticks):
        return [packet.events.tobytes() for _ in range(ticks) for packet in one.step()]

    one, other = world(), world()
    packets(one, cut)
    blob = one.save()
    other.restore(blob)
    rest = packets(one, 11 - cut) + [p.events.tobytes() for p in one.finish()]
    assert packets(other, 11 - cut) + [p.events.tobytes() for p in other.finish()] == rest
    assert one.t_us == other.t_us == 11_000


ELSEWHERE = """
import hashlib, importlib.util, sys
spec = importlib.util.spec_from_file_location("resume", sys.argv[1])
resume = importlib.util.module_from_spec(spec)
spec.loader.exec_module(resume)
loop = resume.standard()
loop.restore(open(sys.argv[2], "rb").read())
print(resume.digest_of(resume.drive(loop, 20, 40)))
"""


def standard():
    """Two cameras with everything on."""
    sensor = SensorConfig(
        "davis346", width=40, height=30, shot_noise_rate_hz=50.0, latency_us=900.0,
        latency_sigma_us=200.0, aps=ApsConfig(enabled=True, rate_hz=100.0, exposure_us=7000),
        imu=ImuConfig(enabled=True, gyroscope_random_walk=0.1),
        readout=ReadoutConfig(order="arbiter", column_ns=900, jitter_ns=30.0, erc_rate_mevs=0.2),
    )  # fmt: skip
    plain, path = RenderConfig(), RenderConfig(renderer="path", spp=2)
    cameras = [("left", sensor, plain, ModelConfig()),
               ("wrist", sensor, path, ModelConfig(name="evsnet"))]  # fmt: skip
    delays = DelayConfig(4000, 1200.0, 0.1, 2500, 700.0)
    return a_loop(cameras, delays)


def digest_of(seen: list[Observation]) -> str:
    """Of everything in some observations."""
    digest = hashlib.sha256()
    for one in seen:
        digest.update(repr((one.t_us, one.done)).encode())
        for array in (one.position, one.velocity, one.state):
            digest.update(b"" if array is None else array.tobytes())
        for packet in one.packets:
            digest.update(repr((packet.seq, packet.time_end_us, packet.camera)).encode())
            digest.update(packet.events.tobytes())
        for frame in one.frames:
            digest.update(frame.pixels.tobytes())
        for packet in one.imu:
            digest.update(packet.samples.tobytes())
    return digest.hexdigest()


@pytest.mark.integration
def test_it_goes_on_in_another_process(tmp_path):
    loop = standard()
    loop.reset(seed=11, state=True)
    drive(loop, 0, 20)
    (tmp_path / "saved").write_bytes(loop.save())
    rest = drive(loop, 20, 40)
    assert sum(len(packet) for seen in rest for packet in seen.packets) > 500
    assert sum(len(seen.frames) for seen in rest) > 2
    assert sum(len(seen.imu) for seen in rest) > 20
    command = [sys.executable, "-c", ELSEWHERE, __file__, str(tmp_path / "saved")]
    said = subprocess.run(command, check=True, capture_output=True, text=True)
    assert said.stdout.split() == [digest_of(rest)]


SLEEPER = """
<mujoco><option timestep=".001"><flag sleep="enable"/></option>
  <worldbody><light pos="0 0 3"/><camera name="c" pos="0 -3 1" xyaxes="1 0 0 0 .3 1"/>
    <geom type="plane" size="3 3 1"/>
    <body pos="0 0 .2"><freejoint/><geom size=".1"/></body>
    <body pos="1 0 .099"><freejoint/><geom type="box" size=".1 .1 .1"/></body>
    <body pos="-1 0 .1"><joint name="x" type="slide" axis="1 0 0"/><geom size=".1"/></body>
  </worldbody>
  <actuator><motor joint="x"/></actuator>
</mujoco>
"""


@pytest.mark.parametrize("cut", [3, 1500])
def test_bodies_that_sleep_go_on_sleeping(cut):
    def world():
        return World(mujoco.MjModel.from_xml_string(SLEEPER), control=lambda t, _: [np.sin(9 * t)])

    one, other = world(), world()
    for _ in range(cut):
        one.step()
    assert bool((one.data.tree_asleep >= 0).any()) == (cut == 1500)
    other.restore(one.save())
    for _ in range(300):
        one.step()
        other.step()
    np.testing.assert_array_equal(one.state, other.state)


LATE = """
<mujoco><option timestep=".001"/>
  <worldbody><light pos="0 0 3"/><camera name="c" pos="0 -2 0" xyaxes="1 0 0 0 0 1"/>
    <body><joint name="x" type="slide" axis="1 0 0"/><geom size=".1"/></body></worldbody>
  <actuator><motor joint="x" delay=".02" nsample="21"/></actuator>
  <sensor><jointpos name="p" joint="x" delay=".01" nsample="11"/></sensor>
</mujoco>
"""


def test_mujocos_own_delays_go_on_and_looking_does_not_disturb_them():
    def make():
        model = mujoco.MjModel.from_xml_string(LATE)
        sensor = SensorConfig("ideal", width=4, height=4)
        return ClosedLoop(model, sensor=sensor, limits={"p": (-9.0, 9.0)})

    one, other = make(), make()
    one.reset(state=True)
    for tick in range(37):
        one.step([np.sin(tick)])
    other.restore(one.save())
    for tick in range(37, 90):
        assert one.step([np.sin(tick)]) == other.step([np.sin(tick)])
    world = World(mujoco.MjModel.from_xml_string(LATE), control=lambda t, _: [np.sin(t * 1000)])
    for _ in range(90):
        world.step()
    # the clock's seconds are rounded, so that the controls differ in their last bits
    np.testing.assert_allclose(world.data.qpos, one.world.data.qpos, rtol=1e-9)
