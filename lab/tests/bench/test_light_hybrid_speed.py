"""`hybrid` beside `direct` and `path`: time of frames and films, filling its cache, events."""

from __future__ import annotations

import time
from dataclasses import replace
from importlib.util import find_spec
from pathlib import Path

import mujoco
import numpy as np
import pytest

from evs.drivers.pictures import write_png
from evs.emulator.config import CameraConfig, RenderConfig
from evs.emulator.render import make_renderer
from evs.msgs import Events
from reference.film import VIEWS, model_of
from reference.judged_film import JudgedFilm
from speed.many import many_geoms
from speed.turns import Table, milliseconds, target
from speed.view import FRAME, HEIGHT, WIDE, WIDTH, View, robot, view_of

CORNELL = """
<mujoco><visual><headlight active="0"/></visual><asset>
<material name="white" rgba=".88 .88 .88 1" specular="0"/>
<material name="red" rgba=".8 .25 .25 1" specular="0"/>
<material name="green" rgba=".35 .75 .35 1" specular="0"/></asset><worldbody>
<camera name="eye" pos="0 -1.9 1.02" xyaxes="1 0 0 0 .052 1" fovy="45"/>
<light type="spot" cutoff="75" exponent="0" pos="0 .3 1.95" dir="0 0 -1" attenuation="0 0 1"
       diffuse="1.5 1.5 1.4" bulbradius=".12"/>
<geom type="plane" size="1 1.5 1" material="white"/>
<geom type="plane" size="1 1.5 1" pos="0 0 2" euler="180 0 0" material="white"/>
<geom type="plane" size="1 1 1" pos="0 1.5 1" euler="90 0 0" material="white"/>
<geom type="plane" size="1 1.5 1" pos="-1 0 1" euler="0 90 0" material="red"/>
<geom type="plane" size="1 1.5 1" pos="1 0 1" euler="0 -90 0" material="green"/>
<geom type="box" size=".25 .25 .3" pos=".5 .7 .3" euler="0 0 18" material="white"/>
<body pos="-.1 .4 1.6"><joint axis="0 1 0" ref="-40"/><joint axis="1 0 0"/>
<geom type="capsule" fromto="0 0 0 .5 0 -.6" size=".05"/>
<geom type="sphere" pos=".5 0 -.6" size=".2"/></body></worldbody></mujoco>"""
"""A room with a bulb in its ceiling."""
ROBOTS = ("gymnasium/humanoid", "dm_control/humanoid", "dm_control/quadruped")
KITCHEN = "envs/assets/kitchen_franka/kitchen_assets/kitchen_env_model.xml"
TICKS = 40


def views(files: dict[str, Path]) -> dict[str, View]:
    room = mujoco.MjModel.from_xml_string(CORNELL)
    return {
        **{name: robot(files[name]) for name in ROBOTS},
        "Cornell box": view_of(room, mujoco.MjData(room), "eye"),
        "1000 geoms": many_geoms(1000),
    }


@pytest.mark.bench
def test_a_full_frame(robot_files: dict[str, Path]) -> None:
    columns = {}
    for name, view in views(robot_files).items():
        rows = {}
        for isa in WIDE:
            rows[f"direct, {isa}"] = view.light(2, isa=isa)
            rows[f"direct, 4 samples, {isa}"] = view.light(2, 4, isa=isa)
            rows[f"hybrid, {isa}"] = view.light(2, renderer="hybrid", isa=isa)
            more = {"renderer": "hybrid", "isa": isa}
            rows[f"hybrid, 4 samples, {isa}"] = view.light(2, 4, **more)
            rows[f"hybrid, 16 samples, {isa}"] = view.light(2, 16, **more)
            rows[f"hybrid, 4 at edges, {isa}"] = view.light(2, 4, antialiasing="adaptive", **more)
            rows[f"path, 4 samples, {isa}"] = view.light(2, 4, renderer="path", isa=isa)
            rows[f"path, 16 samples, {isa}"] = view.light(2, 16, renderer="path", isa=isa)
        columns[name] = milliseconds(rows, rounds=5)
    base = {row: "direct, " + row.rsplit(", ", 1)[1] for row in rows}
    print(Table(f"hybrid, {FRAME}; 2 threads", columns, base))
    for name, column in columns.items():
        for isa in WIDE:
            pan = column[f"hybrid, {isa}"].median
            print(target(f"{name}: a tick with 1 sample, {isa}", pan, 2.5, "ms"))


@pytest.mark.bench
def test_filling_the_cache(robot_files: dict[str, Path]) -> None:
    for name, view in views(robot_files).items():
        config = RenderConfig(renderer="hybrid", spp=1)
        fills = []
        for _ in range(5):
            renderer = make_renderer(view.content, view.camera, config, 2)
            begin = time.perf_counter()
            renderer.render(view.shot, view.pose)
            fills.append(1e3 * (time.perf_counter() - begin))
        work = renderer.work  # type: ignore[attr-defined]
        nodes, size = work["cache_nodes"], work["cache_bytes"] / 1e6
        print(f"{name}: {nodes} nodes, {size:.1f} MB, filled in {np.median(fills):.0f} ms")


def print_ticks(name: str, film: JudgedFilm, renders: dict[str, RenderConfig]) -> None:
    """Print the median ms a tick of a film, on two threads."""
    for label, render in renders.items():
        medians = []
        for isa in WIDE:
            renderer = make_renderer(film.scene, film.camera, replace(render, isa=isa), 2)
            times = []
            for instant in film.taken:
                begin = time.perf_counter()
                renderer.render(*instant)
                times.append(1e3 * (time.perf_counter() - begin))
            medians.append(f"{isa} {np.median(times[5:]):.2f} ms")
        print(f"{name}: {label}: {', '.join(medians)}")


@pytest.mark.bench
@pytest.mark.parametrize("motion", ["still", "pan"])
def test_ticks_of_a_film(motion: str, robot_files: dict[str, Path]) -> None:
    """Robots that move, filmed by a camera that stands or pans."""
    renders = {
        "direct": RenderConfig(spp=1),
        "hybrid": RenderConfig(renderer="hybrid", spp=1),
        "hybrid, 4 samples": RenderConfig(renderer="hybrid", spp=4, antialiasing="fixed"),
        "hybrid, 4 at edges": RenderConfig(renderer="hybrid", antialiasing="adaptive"),
        "path, 4 samples": RenderConfig(renderer="path", spp=4),
    }
    for name in ROBOTS:
        model = model_of(name, robot_files, soft=False)
        film = JudgedFilm(model, motion, WIDTH, HEIGHT, TICKS, VIEWS.get(name))
        print_ticks(f"{name}, {motion} camera", film, renders)


@pytest.mark.bench
@pytest.mark.parametrize("motion", ["still", "pan"])
def test_ticks_of_a_kitchen(motion: str) -> None:
    """Gymnasium-Robotics' kitchen: 141,622 triangles, 240 geoms, one of them a window."""
    found = find_spec("gymnasium_robotics")
    if found is None or found.origin is None:
        pytest.skip("pip install --no-deps gymnasium-robotics")
    model = mujoco.MjModel.from_xml_path(str(Path(found.origin).parent / KITCHEN))
    view = CameraConfig(lookat=(-0.2, 0.5, 2), distance=2.2, azimuth=70, elevation=-35)
    renders = {
        "direct": RenderConfig(spp=1),
        "hybrid": RenderConfig(renderer="hybrid", spp=1),
        "path, 4 samples": RenderConfig(renderer="path", spp=4),
    }
    film = JudgedFilm(model, motion, WIDTH, HEIGHT, TICKS, view)
    print_ticks(f"kitchen, {motion} camera", film, renders)


@pytest.mark.bench
@pytest.mark.parametrize("motion", ["still", "pan"])
def test_events(motion: str, robot_files: dict[str, Path]) -> None:
    """Small films of the room and of a matt robot, against the events of 256 samples."""
    robot = model_of("gymnasium/humanoid", robot_files)
    robot.mat_specular[:] = robot.mat_reflectance[:] = 0
    room = mujoco.MjModel.from_xml_string(CORNELL)
    inside = CameraConfig(lookat=(0, 0.3, 0.9), distance=2.2, azimuth=90, elevation=-3)
    near = VIEWS["gymnasium/humanoid"]
    for name, model, view in (("room", room, inside), ("matt humanoid", robot, near)):
        film = JudgedFilm(model, motion, 56, 42, 61, view)

        def events(seed: int = 1, film: JudgedFilm = film, **render: object) -> Events:
            config = RenderConfig(**render)  # type: ignore[arg-type]
            made = make_renderer(film.scene, film.camera, config, 2, seed=seed)
            return film.events_by(made)[0]

        truth = events(renderer="path", spp=256)
        rows = {
            "the reference, another seed": events(2, renderer="path", spp=256),
            "no event": truth[:0],
            **{f"path, {spp} fixed": events(3, renderer="path", spp=spp) for spp in (4, 16)},
            **{f"hybrid, {spp}": events(3, renderer="hybrid", spp=spp) for spp in (4, 16)},
            "direct, 4": events(renderer="direct", spp=4),
        }
        found = {row: film.compare(of_row, truth, 20_000) for row, of_row in rows.items()}
        for row, score in found.items():
            rates = f"{score.recall:.2f} / {score.precision:.2f}"
            print(f"{name}, {motion} camera: {row}: EMD {score.emd:.3f}, {rates}")
        assert found["hybrid, 16"].emd < found["path, 16 fixed"].emd


@pytest.mark.bench
def test_pictures(robot_files: dict[str, Path]) -> None:
    """Converged paths, `hybrid`, and ten times their difference: out/hybrid.png."""
    rows = []
    for name, view in views(robot_files).items():
        if name not in ("Cornell box", "dm_control/humanoid"):
            continue
        exact = view.light(2, 1024, renderer="path")().astype(float)
        ours = view.light(2, 4, renderer="hybrid", antialiasing="adaptive")().astype(float)
        white = np.quantile(exact, 0.99)
        parts = [exact / white, ours / white, 10 * np.abs(ours - exact) / exact.mean()]
        rows.append(np.concatenate([np.clip(part, 0, 1) ** (1 / 2.2) for part in parts], 1))
        block = (ours - exact)[:256, :344].reshape(32, 8, 43, 8).mean((1, 3)) / exact.mean()
        error, worst = (ours - exact).mean() / exact.mean(), np.abs(block).max()
        print(
            f"{name}: mean error {error:+.2%}, worst block of 8 x 8 pixels {worst:.1%} of the mean"
        )
    Path("out").mkdir(exist_ok=True)
    write_png(Path("out/hybrid.png"), (255 * np.concatenate(rows)).astype(np.uint8))
