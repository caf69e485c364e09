"""Renderers, pixels and EvSNet on a GPU beside the CPU: the bytes, the time of a frame, of a tick
of the network, and of a whole tick. Each film is rendered by both."""

from __future__ import annotations

from dataclasses import replace
from itertools import product
from pathlib import Path
from time import perf_counter

import mujoco
import numpy as np
import pytest

import evs
from evs.drivers.clock import StopWatch
from evs.emulator import _core
from evs.emulator.base.gpu.arrays import DeviceLight
from evs.emulator.base.gpu.driver import the_gpu, why_no_gpu
from evs.emulator.base.memory_limits import cores
from evs.emulator.camera.pixel_pipeline import make_event_model
from evs.emulator.config import ModelConfig, RenderConfig
from evs.emulator.render import make_renderer
from evs.emulator.sensor import SensorParameters
from evs.emulator.simulation.pipelined import PipelinedWorld
from reference.film import ROOM, VIEWS, Film, model_of

SIZES = ((346, 260), (1280, 720))
SAMPLES = {"1 sample": (1, "fixed"), "4 at edges": (4, "adaptive"), "4 samples": (4, "fixed")}
TICKS, TICKS_OF_ONE = 40, 8
TICKS_OF_LOOP, SETTLED, TENTH = 600, 99, 50
TICKS_OF_CLOSED, TICKS_OF_MANY, TICKS_OF_SWEEP = 200, 40, 70
SCENES = Path(__file__).parents[3] / "config/scenes"

pytestmark = pytest.mark.bench
needs_gpu = pytest.mark.skipif(bool(why_no_gpu()), reason=why_no_gpu() or "there is one")


def spread(ms: list[float]) -> str:
    """Median and range, ms."""
    return f"{np.median(ms):.3g} ({min(ms):.3g} ... {max(ms):.3g})"


def processor() -> str:
    lines = Path("/proc/cpuinfo").read_text().splitlines()
    return next((line.split(":")[1].strip() for line in lines if "model name" in line), "?")


def frames(
    film: Film, config: RenderConfig, threads: int, ticks: int = TICKS
) -> tuple[list[bytes], list[float]]:
    """The bytes of each frame of a film, and ms of each; the first of them does not count."""
    renderer = make_renderer(film.scene, film.camera, config, threads)
    light, ms = [], []
    for snapshot, pose in film.taken[:ticks]:
        begin = perf_counter()
        frame = renderer.render(snapshot, pose)
        ms.append(1e3 * (perf_counter() - begin))
        light.append(frame.tobytes())
    return light, ms[1:]


def test_instruction_sets(robot_files: dict[str, Path]) -> None:
    """Of the CPU, on one thread and before a camera that turns; no GPU is needed."""
    print(f"\n{cores()} cores, {processor()}\n")
    robot = model_of("gymnasium/humanoid", robot_files, soft=False)
    films = {
        "direct, 1 sample": (robot, "gymnasium/humanoid", RenderConfig(spp=1)),
        "hybrid": (
            model_of("room", robot_files),
            "room",
            RenderConfig(renderer="hybrid", antialiasing="fixed"),
        ),
        "path, 4 samples": (model_of("room", robot_files), "room", RenderConfig("path", 4)),
    }
    for name, (model, view, config) in films.items():
        film = Film(model, "pan", *SIZES[0], TICKS_OF_ONE, VIEWS.get(view))
        for isa in _core.isa_available():
            light, ms = frames(film, replace(config, isa=isa), 1)
            assert len(light) == TICKS_OF_ONE
            print(f"| {view} | {name} | {isa} | {spread(ms)} |", flush=True)


@needs_gpu
def test_a_frame(robot_files: dict[str, Path]) -> None:
    print(f"\n{the_gpu().name}; {cores()} cores, {processor()}\n")
    print("| scene | image | camera | samples | GPU | CPU, 1 thread | CPU, all threads | bytes |")
    print("|---|---|---|---|---:|---:|---:|---|")
    differ = 0
    for name, (width, height), motion in product(
        ("gymnasium/humanoid", "room"), SIZES, ("still", "pan")
    ):
        model = model_of(name, robot_files, soft=False)
        film = Film(model, motion, width, height, TICKS, VIEWS.get(name))
        for samples, (spp, antialiasing) in SAMPLES.items():
            config = RenderConfig(spp=spp, antialiasing=antialiasing)
            here, all_ms = frames(film, config, 0)
            _, one_ms = frames(film, config, 1, TICKS_OF_ONE)
            there, gpu_ms = frames(film, replace(config, device="cuda"), 1)
            same = "equal" if here == there else "DIFFER"
            differ += here != there
            print(
                f"| {name} | {width} x {height} | {motion} | {samples} | {spread(gpu_ms)} "
                f"| {spread(one_ms)} | {spread(all_ms)} | {same} |",
                flush=True,
            )
    assert differ == 0


@needs_gpu
def test_a_frame_of_paths(robot_files: dict[str, Path]) -> None:
    """64 samples at 640 x 360 are what the paper counts in."""
    print(f"\n{the_gpu().name}; {cores()} cores, {processor()}\n")
    print("| scene | image | camera | samples | GPU | CPU, all threads | bytes |")
    print("|---|---|---|---|---:|---:|---|")
    differ = 0
    for name, (size, spp) in product(
        ("gymnasium/humanoid", "room"), (((346, 260), 4), ((346, 260), 64), ((640, 360), 64))
    ):
        film = Film(model_of(name, robot_files), "pan", *size, TICKS_OF_ONE, VIEWS.get(name))
        config = RenderConfig(renderer="path", spp=spp)
        here, cpu_ms = frames(film, config, 0)
        there, gpu_ms = frames(film, replace(config, device="cuda"), 1)
        same = "equal" if here == there else "DIFFER"
        differ += here != there
        print(
            f"| {name} | {size[0]} x {size[1]} | pan | {spp} | {spread(gpu_ms)} "
            f"| {spread(cpu_ms)} | {same} |",
            flush=True,
        )
    assert differ == 0


@needs_gpu
def test_a_frame_of_soft_light(robot_files: dict[str, Path]) -> None:
    """With `hybrid`, over a tick in which its cache is swept: the longest one."""
    print(f"\n{the_gpu().name}; {cores()} cores, {processor()}\n")
    print("| scene | image | camera | GPU | CPU, all threads | bytes |")
    print("|---|---|---|---:|---:|---|")
    differ = 0
    for name, size, motion in product(("gymnasium/humanoid", "room"), SIZES, ("still", "pan")):
        model = model_of(name, robot_files)
        film = Film(model, motion, *size, TICKS_OF_SWEEP, VIEWS.get(name))
        config = RenderConfig(renderer="hybrid", antialiasing="fixed")
        here, cpu_ms = frames(film, config, 0, TICKS_OF_SWEEP)
        there, gpu_ms = frames(film, replace(config, device="cuda"), 0, TICKS_OF_SWEEP)
        same = "equal" if here == there else "DIFFER"
        differ += here != there
        print(
            f"| {name} | {size[0]} x {size[1]} | {motion} | {spread(gpu_ms)} | {spread(cpu_ms)} "
            f"| {same} |",
            flush=True,
        )
    assert differ == 0


def ticks_of_network(
    light: list[np.ndarray], device: str, threads: int = 0, here: bool = True
) -> tuple[list[bytes], list[float]]:
    """The events of each tick of `evsnet_c8`, and ms of each but the first TICKS.

    Light lies on the device already, unless it is `here`.
    """
    height, width = light[0].shape
    sensor = SensorParameters("bench", width, height, 0.2, 0.2)
    config = ModelConfig(name="evsnet", network="evsnet_c8", device=device)
    model = make_event_model(sensor, config, threads)
    state = model.init(1)
    there = None if here else DeviceLight(the_gpu(), (height, width))
    events, ms = [], []
    for tick, frame in enumerate(light):
        if there is not None:
            the_gpu().upload(there.memory, frame)
            the_gpu().wait()
            there.changed()
        begin = perf_counter()
        found, state = model.step(
            frame if there is None else there, state, 1000 * tick, 1000 * tick + 1000
        )
        ms.append(1e3 * (perf_counter() - begin))
        events.append(found.tobytes())
    return events, ms[TICKS:]


@needs_gpu
def test_a_tick_of_evsnet(robot_files: dict[str, Path]) -> None:
    """Of 8 channels. `still` sees a robot that moves, `pan` makes every pixel move."""
    print(f"\n{the_gpu().name}; {cores()} cores, {processor()}\n")
    print(
        "| image | camera | GPU, light on it | GPU, light uploaded | CPU, 1 thread | CPU, all "
        "| bytes |"
    )
    print("|---|---|---:|---:|---:|---:|---|")
    differ = 0
    for (width, height), motion in product(SIZES, ("still", "pan")):
        model = model_of("gymnasium/humanoid", robot_files, soft=False)
        film = Film(model, motion, width, height, 2 * TICKS, VIEWS["gymnasium/humanoid"])
        renderer = make_renderer(film.scene, film.camera, RenderConfig(antialiasing="fixed"), 0)
        light = [renderer.render(*taken).copy() for taken in film.taken]
        expected, all_ms = ticks_of_network(light, "cpu")
        _, one_ms = ticks_of_network(light, "cpu", 1)
        there, there_ms = ticks_of_network(light, "cuda", here=False)
        here, here_ms = ticks_of_network(light, "cuda")
        same = "equal" if there == here == expected else "DIFFER"
        differ += same == "DIFFER"
        print(
            f"| {width} x {height} | {motion} | {spread(there_ms)} | {spread(here_ms)} "
            f"| {spread(one_ms)} | {spread(all_ms)} | {same} |",
            flush=True,
        )
    assert differ == 0


def room(size: tuple[int, int], turning: bool, render: RenderConfig, pixels: str) -> evs.World:
    """The room, seen by a camera without photon noise that stands or turns by 170 px/s."""
    width, height = size
    eye = """<body pos="0 -3 1.2"><joint name="eye" axis="0 0 1"/><inertial pos="0 0 0" mass="1"
      diaginertia="1 1 1"/><camera name="eye" xyaxes="1 0 0 0 0 1" fovy="60"/></body></worldbody>"""
    model = mujoco.MjModel.from_xml_string(ROOM.replace("</worldbody>", eye))
    world = evs.World(model, seed=1)
    sensor = evs.SensorConfig(preset="davis346", width=width, height=height, photocurrent_pa=0.0)
    world.add_camera(
        "eye",
        sensor=sensor,
        render=render,
        model=ModelConfig(device=pixels),
    )
    if turning:
        world.data.qvel[world.model.joint("eye").dofadr] = 170.0 * np.tan(np.pi / 6) * 2 / height
    return world


@needs_gpu
def test_a_tick_in_an_open_loop() -> None:
    """Physics, light and pixels; light is made ahead of the pixels."""
    print(f"\n{the_gpu().name}; {cores()} cores, {processor()}\n")
    print("| image | camera | light | pixels | ms per tick | events per tick | bytes |")
    print("|---|---|---|---|---:|---:|---|")
    differ = 0
    for size, turning in product(SIZES, (False, True)):
        expected = b""
        for light, pixels in (("cpu", "cpu"), ("cuda", "cpu"), ("cuda", "cuda")):
            world = room(size, turning, RenderConfig(spp=1, device=light), pixels)
            ahead = PipelinedWorld(world, TICKS_OF_LOOP, StopWatch(), 8)
            found, ends = [], []
            for _ in range(TICKS_OF_LOOP):
                (packet,) = ahead.step()
                ends.append(perf_counter())
                found.append(packet.events.tobytes())
            ahead.close()
            seen = b"".join(found)
            same = "" if not expected else "equal" if seen == expected else "DIFFER"
            expected = expected or seen
            differ += same == "DIFFER"
            events = len(seen) / packet.events.dtype.itemsize / TICKS_OF_LOOP
            # the mean of tenths: single ticks wait for each other
            tenths = 1e3 * np.diff(ends[SETTLED::TENTH]) / TENTH
            print(
                f"| {size[0]} x {size[1]} | {'pan' if turning else 'still'} | {light} "
                f"| {pixels} | {spread(tenths.tolist())} | {events:.0f} | {same} |",
                flush=True,
            )
    assert differ == 0


@needs_gpu
def test_a_tick_of_soft_light_in_a_closed_loop() -> None:
    """Physics, soft light and pixels, one after the other; all that a controller waits for."""
    print(f"\n{the_gpu().name}; {cores()} cores, {processor()}\n")
    print("| camera | light | pixels | ms per tick | events per tick | bytes |")
    print("|---|---|---|---:|---:|---|")
    differ = 0
    soft = {"hybrid": {"renderer": "hybrid"}, "path, 4 samples": {"renderer": "path", "spp": 4}}
    places = (("cpu", "cpu"), ("cpu", "cuda"), ("cuda", "cuda"))
    for turning, (name, render) in product((False, True), soft.items()):
        expected = b""
        for light, pixels in places:
            world = room(
                SIZES[0],
                turning,
                RenderConfig(device=light, antialiasing="fixed", **render),
                pixels,
            )
            found, ms = [], []
            for _ in range(TICKS_OF_CLOSED):
                begin = perf_counter()
                (packet,) = world.step()
                ms.append(1e3 * (perf_counter() - begin))
                found.append(packet.events.tobytes())
            seen = b"".join(found)
            same = "" if not expected else "equal" if seen == expected else "DIFFER"
            expected = expected or seen
            differ += same == "DIFFER"
            events = len(seen) / packet.events.dtype.itemsize / TICKS_OF_CLOSED
            print(
                f"| {'pan' if turning else 'still'} | {name}, {light} | {pixels} "
                f"| {spread(ms[SETTLED:])} | {events:.0f} | {same} |",
                flush=True,
            )
    assert differ == 0


@needs_gpu
@pytest.mark.parametrize("count", [64, 1024])
def test_a_tick_of_many_worlds(count: int) -> None:
    """Physics, light and pixels of humanoids at 64 x 64; those on a GPU in one launch."""
    print(f"\n{the_gpu().name}; {cores()} cores, {processor()}\n")
    print("| worlds | on | ms per tick | world steps per second | events per tick | bytes |")
    print("|---:|---|---:|---:|---:|---|")
    expected: list[bytes] = []
    sensor = evs.SensorConfig(preset="davis346", width=64, height=64, photocurrent_pa=0.0)
    for device in ("cpu", "cuda"):
        worlds = evs.Worlds(SCENES / "humanoid.xml", count, seed=1)
        render, model = RenderConfig(spp=1, device=device), ModelConfig(device=device)
        worlds.add_camera("side", sensor=sensor, render=render, model=model)
        assert worlds.one_by_one == ""
        found, ms = [], []
        for _ in range(TICKS_OF_MANY):
            begin = perf_counter()
            (seen,) = worlds.step()
            ms.append(1e3 * (perf_counter() - begin))
            found.append(seen.events.tobytes())
        same = "" if not expected else "equal" if found == expected else "DIFFER"
        expected = expected or found
        events = sum(map(len, found)) / seen.events.dtype.itemsize / TICKS_OF_MANY
        settled = ms[TICKS_OF_MANY // 4 :]
        print(
            f"| {count} | {device} | {spread(settled)} | {1e3 * count / np.median(settled):.0f} "
            f"| {events:.0f} | {same} |",
            flush=True,
        )
    assert same == "equal"
