"""The headline, end to end: robots that move, bus and recorder on, in real time or not.

Each run is a process, `evs emulate --record --publish`, with one subscriber in another.
Rounds go through all rows in turns, each beside a yardstick in the same round: MuJoCo's own rays
through the same pixels. What is told of a run is its report's: from the first tick to the last
packet's end.
"""

from __future__ import annotations

import json
import os
import subprocess
import sys
import time
from dataclasses import dataclass
from pathlib import Path

import mujoco
import pytest

from evs.drivers.bus.address import free_address
from evs.drivers.run.config import PRESETS
from speed.turns import Time, spread, target
from speed.view import WIDE, Rays, robot

ROUNDS = 5
LISTEN = """
import sys
from evs.drivers.bus import subscribe
print(sum(len(packet.events) for packet in subscribe(sys.argv[1])))
"""
MOVING = ("scene.camera=side",)
"""Beside the robot, at a fixed distance from its centre of mass."""
TRACK = ("scene.camera=track",)
"""The same of gymnasium's robots, in whose views more pixels fire."""
STILL = ("camera.lookat=[0,0,0.9]", "camera.distance=3")
LARGE = ("sensor.width=640", "sensor.height=360")


@dataclass(frozen=True)
class Row:
    """One configuration. The model's lamp follows the robot, unless it is fixed."""

    name: str
    preset: str
    """a pipeline that the documentation recommends"""
    settings: tuple[str, ...]
    fixed_lamp: bool = False
    bound: float | None = None
    """real-time factor that the project promises"""
    seconds: float = 1.0
    robot: str = "dm_control/humanoid"


def rows() -> list[Row]:
    """The headline's rows, also in ticks of 2 ms and at 640x360, and gymnasium's robots."""
    two = ("scene.tick_us=2000",)
    return [
        Row("fast, moving camera", "fast", MOVING, bound=1.0),
        Row("fast, still camera", "fast", STILL, bound=2.0),
        Row("fast, still camera, fixed lamp", "fast", STILL, True, bound=2.0),
        Row("default, moving camera", "default", MOVING, seconds=0.4),
        Row("default, still camera", "default", STILL, seconds=0.4),
        Row("balanced, moving camera", "balanced", MOVING, seconds=0.4),
        Row("balanced, moving camera, 2 ms", "balanced", MOVING + two, seconds=0.4),
        Row("balanced, still camera", "balanced", STILL, seconds=0.4),
        Row("balanced, still camera, fixed lamp", "balanced", STILL, True, seconds=0.4),
        Row("fast, moving camera, 2 ms", "fast", MOVING + two),
        Row("fast, still camera, fixed lamp, 2 ms", "fast", STILL + two, True),
        Row("640x360, fast, moving camera", "fast", MOVING + LARGE),
        *(
            Row(f"{robot}, {preset}, moving camera", preset, TRACK, seconds=0.4, robot=robot)
            for robot in ("gymnasium/humanoid", "gymnasium/ant")
            for preset in ("fast", "default", "balanced")
        ),
    ]


def with_fixed_lamp(path: Path, out: Path) -> Path:
    """The model with its lamp in the world, where it is above the robot that stands."""
    spec = mujoco.MjSpec.from_file(str(path))
    for light in list(spec.lights):
        if light.parent.name != "world":
            place = light.parent.pos + light.pos
            spec.delete(light)
            spec.worldbody.add_light(name="fixed", pos=place, dir=[0.0, 0.0, -1.0])
    # sites and sensors of no camera stay; a file that another process reads
    mujoco.mj_saveModel(spec.compile(), str(out), None)
    return out


def run(row: Row, scene: Path, folder: Path, isa: str) -> dict[str, float]:
    """One run in a process of its own. Out: real-time factor, seconds a second, ms a stage."""
    address = free_address()
    path = {"PYTHONPATH": os.pathsep.join(str(Path(e).absolute()) for e in sys.path if e)}
    environment = {**os.environ, **path}
    report, film = folder / "report.json", folder / "run.aedat4"
    film.unlink(missing_ok=True)
    sensor = () if LARGE[0] in row.settings else ("--sensor", "davis346")
    line = [sys.executable, "-c", LISTEN, address]
    listener = subprocess.Popen(line, env=environment, stdout=subprocess.PIPE, text=True)
    words = [
        "emulate",
        row.preset,
        *row.settings,
        "scene.control=random",
        f"scene.file={scene}",
        f"render.isa={isa}",
        *sensor,
    ]
    words += ["--duration", str(row.seconds), "--record", str(film), "--report", str(report)]
    words += ["--publish", address, "--wait-for", "1"]
    words += ["--threads", "2", "--quiet"]
    done = subprocess.run(
        [sys.executable, "-m", "evs.launch.main", *words],
        env=environment,
        capture_output=True,
        text=True,
        timeout=600,
        check=False,
    )
    heard = int(listener.communicate(timeout=60)[0])
    assert done.returncode == 0, done.stderr
    found = json.loads(report.read_text())
    assert found["events"] > 0
    assert heard == found["events"]
    assert film.stat().st_size > 0
    stages = {f"{name} ms": stage["median"] for name, stage in found["stage_ms"].items()}
    return {
        "real-time factor": found["real_time_factor"],
        "traced": found["traced_fraction"],
        "events per tick": found["events"] / found["ticks"],
        **stages,
    }


def milliseconds_of_rays(cast: object) -> float:
    """The least of some calls of the yardstick."""
    taken = []
    for _ in range(5):
        begin = time.perf_counter()
        cast()  # type: ignore[operator]
        taken.append(1e3 * (time.perf_counter() - begin))
    return min(taken)


def test_every_row_is_a_pipeline_that_the_documentation_recommends() -> None:
    for row in rows():
        assert row.preset in (*PRESETS, "default"), row.name
        # what is seen and by how many pixels, not how light becomes events
        keys = {word.partition("=")[0] for word in row.settings}
        assert keys <= {"scene.camera", "scene.tick_us", "camera.lookat", "camera.distance",
                        "sensor.width", "sensor.height"}, row.name  # fmt: skip


@pytest.mark.bench
@pytest.mark.parametrize("isa", WIDE)
def test_the_headline(
    robot_files: dict[str, Path], camera_rays: Rays, tmp_path: Path, isa: str
) -> None:
    if len(os.sched_getaffinity(0)) < 2:
        pytest.skip("needs two cores")
    humanoid = robot_files["dm_control/humanoid"]
    fixed = with_fixed_lamp(humanoid, tmp_path / "fixed.mjb")
    cast = robot(humanoid).multi_ray(camera_rays)
    factors: dict[str, list[float]] = {row.name: [] for row in rows()}
    stages: dict[str, list[dict[str, float]]] = {row.name: [] for row in rows()}
    yardstick = []
    for _ in range(ROUNDS):
        yardstick.append(milliseconds_of_rays(cast))
        for row in rows():
            scene = fixed if row.fixed_lamp else robot_files[row.robot]
            found = run(row, scene, tmp_path, isa)
            factors[row.name].append(found.pop("real-time factor"))
            stages[row.name].append(found)
    rays = spread(yardstick)
    print(f"\n{isa}; yardstick, mj_multiRay of 346x260: {rays} ms")
    print(f"rows: median (quartiles) of {ROUNDS}")
    for row in rows():
        factor = spread(factors[row.name])
        wall = Time(1e3 / factor.median, 1e3 / factor.high, 1e3 / factor.low)
        print(f"{row.name}: real-time factor {factor}; {_tick(row, wall, rays)}")
        middle = {name: spread([one[name] for one in stages[row.name]]) for name in found}
        print("    " + ", ".join(f"{name} {time.median:.3g}" for name, time in middle.items()))
        if row.bound is not None:
            print("    " + target(row.name, factor.median, row.bound, "x"))
        assert factor.median > 0


def _tick(row: Row, wall: Time, rays: Time) -> str:
    """Time of a tick, also in yardsticks."""
    ticks = 500.0 if any("tick_us=2000" in word for word in row.settings) else 1000.0
    tick_ms = wall.median / ticks
    return f"a tick {tick_ms:.3g} ms, {tick_ms / rays.median:.3g} yardsticks"
