"""Light made ahead: the packets of a world that goes one tick after the other."""

from __future__ import annotations

import dataclasses
import hashlib
import os
import threading
import time

import numpy as np
import pytest

from evs.drivers.clock import StopWatch
from evs.drivers.run.config import PipelineConfig, load
from evs.drivers.run.run import depth_of
from evs.emulator import UnstableError, World
from evs.emulator.config import ModelConfig, RenderConfig, SceneConfig, SensorConfig
from evs.emulator.simulation.pipelined import MOST_BYTES, PipelinedWorld, pipelined
from evs.launch.main import main
from evs.msgs import EvsError
from reference.mjcf import ARM

SMALL = SensorConfig(preset="davis346", width=64, height=48)
NOISY = RenderConfig(renderer="path", spp=2, seeds="fresh")
TICKS = 21


@pytest.fixture
def arm(tmp_path):
    path = tmp_path / "arm.xml"
    path.write_text(ARM)
    return path


def watched(arm, *, model=None, render=None, cameras=("side", "top"), control=None):
    """(world, the watch that it laps)"""
    watch = StopWatch()
    scene = SceneConfig(file=str(arm), start_us=7_000_000_000)
    world = World(
        scene, control=control or (lambda t_s, _: [np.sin(40 * t_s)]), meter=watch, seed=4
    )
    for name in cameras:
        world.add_camera(name, sensor=SMALL, model=model, render=render)
    return world, watch


def told(running, camera):
    """All that a run loop asks after a tick."""
    truth = camera.ground_truth()
    return (
        running.t_us,
        camera.luminance.tobytes(),
        camera.traced_fraction,
        camera.pose,
        truth.geom_id.tobytes(),
        truth.flow.tobytes(),
        camera.clamps,
        camera.imu.tobytes(),
    )


def run(arm, depth, **options):
    """Every packet of TICKS ticks, and what is told after each."""
    world, watch = watched(arm, **options)
    packets, said = [], []
    with pipelined(world, TICKS, watch, depth) as running:
        assert isinstance(running, PipelinedWorld) == (depth > 0)
        for _ in range(TICKS):
            packets += running.step()
            said.append([told(running, camera) for camera in running.cameras])
        packets += running.finish()
        if depth:
            with pytest.raises(EvsError, match=f"all {TICKS} ticks are done"):
                running.step()
    assert world.tick == TICKS
    assert set(watch.stage_ms()) == ({"world", "render"} if depth else set())
    return [(p.seq, p.camera, p.time_base_us, p.events.tobytes()) for p in packets], said


@pytest.mark.parametrize("depth", [1, 2, 7])
def test_packets_light_and_truth_are_those_of_one_tick_after_the_other(arm, depth):
    packets, said = run(arm, depth)
    assert len(packets) == 2 * TICKS
    assert sum(len(events) for *_, events in packets) > 1000
    assert (packets, said) == run(arm, 0)


@pytest.mark.parametrize(
    "options",
    [
        {"model": ModelConfig(name="evsnet", chunk=8), "render": NOISY},
        {"model": ModelConfig(labels=True)},
        {"render": RenderConfig(incremental=False, spp=1), "cameras": ("top",)},
        {"render": RenderConfig(renderer="path", spp=1, seeds="cycle")},
    ],
    ids=["chunks", "labels", "one camera", "cycle"],
)
def test_so_they_are_with_chunks_and_labels(arm, options):
    assert run(arm, 2, **options) == run(arm, 0, **options)


def test_an_explosion_is_told_after_every_packet_before_it(arm):
    def kick(t_s, data):
        if t_s > 0.0115:
            data.qvel[0] = np.nan
        return [0.0]

    def until_it_breaks(depth):
        world, watch = watched(arm, control=kick)
        packets = []

        def go_on():
            while True:
                packets.extend(packet.events.tobytes() for packet in running.step())

        with pipelined(world, TICKS, watch, depth) as running:
            with pytest.raises(UnstableError) as error:
                go_on()
            return packets, running.t_us, str(error.value)

    assert until_it_breaks(3) == until_it_breaks(0)
    assert len(until_it_breaks(3)[0]) == 2 * 12


def test_a_run_that_ends_early_leaves_no_thread(arm):
    before = threading.active_count()
    world, watch = watched(arm)
    with pipelined(world, 10**6, watch, 2) as running:
        for _ in range(3):
            running.step()
        # it does not run away: light waits until somebody takes it, physics is one tick further
        time.sleep(0.2)
        assert world.tick <= 3 + 2 + 1 + 1
    assert threading.active_count() == before


def test_after_an_error_and_after_the_end_nobody_waits_for_ever(arm):
    def kick(t_s, data):
        if t_s > 0.0015:
            data.qvel[0] = np.nan
        return [0.0]

    world, watch = watched(arm, control=kick)
    with pipelined(world, TICKS, watch, 2) as running:
        for _ in range(2):
            running.step()
        for _ in range(2):
            with pytest.raises(UnstableError):
                running.step()
    world, watch = watched(arm)
    with pipelined(world, TICKS, watch, 2) as running:
        running.step()
    with pytest.raises(EvsError, match="it was closed"):
        running.step()


def test_waiting_for_light_is_no_stages_time(arm):
    world, watch = watched(arm, control=lambda _t, _d: time.sleep(0.02) or [0.0], cameras=("top",))
    with pipelined(world, 5, watch, 1) as running:
        for _ in range(5):
            watch.begin_tick()
            running.step()
            watch.end_tick()
    taken = watch.stage_ms()
    assert taken["world"].median > 20
    assert taken["sensor"].median < 10


def test_light_that_waits_has_bounded_memory(arm, monkeypatch):
    big = SensorConfig(preset="davis346", width=1280, height=720)
    world, watch = watched(arm, cameras=())
    world.add_camera("top", sensor=big, model=ModelConfig(name="evsnet", chunk=256))
    running = PipelinedWorld(world, 300, watch, 2)
    # one of them is being made
    waiting = running._free.qsize() - 1
    assert 1 < waiting < 256
    assert 4 * 1280 * 720 * waiting <= MOST_BYTES
    # as little as one tick at a time: the same packets
    options = {"model": ModelConfig(name="evsnet", chunk=8), "cameras": ("top",)}
    expected = run(arm, 2, **options)
    monkeypatch.setattr("evs.emulator.simulation.pipelined.MOST_BYTES", 1)
    assert run(arm, 2, **options) == expected


def test_it_is_for_more_than_one_thread_and_core(monkeypatch):
    config = PipelineConfig()
    monkeypatch.setattr(os, "sched_getaffinity", lambda _: {0, 1})
    assert depth_of(config) == 2
    assert depth_of(dataclasses.replace(config, ahead=5)) == 5
    assert depth_of(dataclasses.replace(config, threads=1)) == 0
    monkeypatch.setattr(os, "sched_getaffinity", lambda _: {3})
    assert depth_of(config) == 0


@pytest.mark.parametrize("depth", ["-1", "65"])
def test_an_impossible_depth_is_refused(arm, depth):
    with pytest.raises(EvsError, match=f"at ahead: {depth} ticks; give 0"):
        load(None, [("scene.file", str(arm)), ("ahead", depth)])


def test_a_pipeline_gives_the_same_world_either_way(arm, monkeypatch):
    monkeypatch.setattr(os, "sched_getaffinity", lambda _: {0, 1})
    config = load(None, [("scene.file", str(arm)), ("duration_s", "0.01")])
    for ahead, kind in ((2, PipelinedWorld), (0, World)):
        depth = depth_of(dataclasses.replace(config, ahead=ahead))
        with pipelined(World.from_config(config), 10, StopWatch(), depth) as world:
            assert isinstance(world, kind)


def test_recordings_are_the_same_bytes(arm, tmp_path, monkeypatch):
    monkeypatch.setattr(os, "sched_getaffinity", lambda _: {0, 1})

    def digest(depth):
        file = tmp_path / f"{depth}.aedat4"
        words = ["emulate", "--scene", str(arm), "--camera", "side", "scene.control=random"]
        beside = ["sensor.width=64", "sensor.height=48", "sensor.imu.enabled=true", "--quiet"]
        assert (
            main([*words, *beside, f"ahead={depth}", "--duration", "0.05", "--record", str(file)])
            == 0
        )
        return hashlib.sha256(file.read_bytes()).hexdigest()

    assert digest(2) == digest(0)


def test_a_stopwatch_has_a_hand_for_each_thread():
    now = [0.0]
    watch = StopWatch(lambda: now[0])
    watch.begin_tick()

    def other():
        watch.begin_tick()
        now[0] += 0.002
        watch.lap("render")
        watch.end_tick()

    thread = threading.Thread(target=other)
    thread.start()
    thread.join()
    now[0] += 0.001
    watch.lap("sensor")
    watch.end_tick()
    found = watch.stage_ms()
    assert found["render"].median == pytest.approx(2.0, rel=0.006)
    # it laps from its own begin
    assert found["sensor"].median == pytest.approx(3.0, rel=0.006)
