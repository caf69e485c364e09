"""What is absent costs nothing: bodies that sleep or move out of sight, lights that stand still,
libraries that a command does not use."""

from __future__ import annotations

import ast
import os
import subprocess
import sys
from pathlib import Path
from typing import Any

import pytest

import evs
from evs.emulator.config import CameraConfig, RenderConfig, RunConfig, SceneConfig, SensorConfig
from evs.emulator.simulation.world import World
from reference.planned import IDEAL, PATH, SUN, Film, told

TICKS = 8
WHOLE = 12 * 9
"""packets of the films' 48 x 36 pixels"""
BEHIND = "0 -9 5"
"""where no camera looks, and no shadow of it falls into the picture"""


def traced(world: World) -> int:
    """Packets that were traced so far."""
    renderer: Any = world.cameras[0]._renderer
    return int(renderer.work["packets_traced"])


def test_bodies_that_move_out_of_sight_are_not_traced(tmp_path: Path) -> None:
    world = Film({"pos": BEHIND}).world(tmp_path)
    told(world, TICKS)
    assert traced(world) == WHOLE
    # and it did move
    assert world.data.qpos[0] > TICKS * 1.9e-3
    # where it can be seen it is traced
    seen = Film().world(tmp_path)
    told(seen, TICKS)
    assert traced(seen) > WHOLE
    # its shadow is enough
    low = SUN.replace('dir=".2 .3 -1"', 'dir="0 9 -4.6"')
    shaded = Film({"pos": BEHIND, "lights": low}).world(tmp_path)
    told(shaded, TICKS)
    assert traced(shaded) > WHOLE


def test_nor_by_paths_that_do_not_meet_them(tmp_path: Path) -> None:
    world = Film({"pos": BEHIND}, PATH).world(tmp_path)
    told(world, TICKS)
    # twice as a whole: the second time to learn where each path goes
    assert traced(world) == 2 * WHOLE
    seen = Film({}, PATH).world(tmp_path)
    told(seen, TICKS)
    assert traced(seen) > 2 * WHOLE


@pytest.mark.parametrize("active", [True, False])
def test_a_light_that_moves_is_where_it_shines_and_one_that_stands_nowhere(
    active: bool, tmp_path: Path
) -> None:
    lamp = f'<light type="point" active="{str(active).lower()}" castshadow="false"/>'
    carried = f'<body pos="0 -9 3"><freejoint/><geom size=".1" mass="1"/>{lamp}</body>'
    film = Film({"pos": BEHIND, "more": carried, "rest": " 1 0 0 0 0 0"})
    world = film.world(tmp_path)
    told(world, TICKS)
    renderer: Any = world.cameras[0]._renderer
    again = traced(world) + renderer.work["packets_relit"] - WHOLE
    # beyond the floor nothing is seen, and nothing is lit
    assert (0.5 if active else 0) * WHOLE * TICKS <= again < (WHOLE * TICKS if active else 1)
    plan = world.cameras[0].plan
    assert len(plan.mobility.lights_moving) == int(active)


ASLEEP = """<mujoco><option timestep=".001"><flag sleep="{sleep}"/></option>
  <worldbody><light dir="0 0 -1"/><geom type="plane" size="3 3 .1"/>
    <camera name="eye" pos="0 -2 1" xyaxes="1 0 0 0 .4 1"/>
    <body pos="-.4 0 .1" sleep="init"><freejoint/><geom type="box" size=".1 .1 .1"/></body>
    <body name="b" pos=".2 0 .2" sleep="init"><freejoint/><geom size=".1" pos="0 0 -.1" mass="1"/>
      <flexcomp name="cloth" type="grid" count="4 4 1" spacing=".1 .1 .1" radius=".01" dim="2"
        pos="0 0 .1" rigid="true" mass="1"><contact contype="0" conaffinity="0"/></flexcomp></body>
  </worldbody></mujoco>"""


def asleep(folder: Path, sleep: str) -> World:
    file = folder / "asleep.xml"
    file.write_text(ASLEEP.format(sleep=sleep))
    return World.from_config(
        RunConfig(
            scene=SceneConfig(file=str(file), camera="eye"),
            sensor=SensorConfig(**IDEAL),
            render=RenderConfig(spp=1),
            threads=1,
        )
    )


def test_islands_that_sleep_are_neither_traced_nor_fitted(tmp_path: Path) -> None:
    world = asleep(tmp_path, "enable")
    told(world, 20)
    renderer: Any = world.cameras[0]._renderer
    assert renderer.work["packets_traced"] == WHOLE
    assert renderer.work["trees_refitted"] == 1
    assert world.cameras[0].plan.mobility.sleeping
    # awake they fall, roll and tremble
    awake = asleep(tmp_path, "disable")
    told(awake, 20)
    renderer = awake.cameras[0]._renderer
    assert renderer.work["packets_traced"] > WHOLE
    assert renderer.work["trees_refitted"] > 1


def test_an_island_that_is_woken_is_seen_again(tmp_path: Path) -> None:
    world = asleep(tmp_path, "enable")
    told(world, 5)
    before = traced(world)
    world.data.qvel[2] = 1.0
    world.data.xfrc_applied[1, 2] = 30.0
    events = [len(x) for x, *_ in told(world, 40)]
    assert traced(world) > before
    assert sum(events) > 0


def test_a_camera_that_rests_on_a_body_keeps_its_picture(tmp_path: Path) -> None:
    """Still or moving is seen tick by tick, not said once for all."""
    file = tmp_path / "arm.xml"
    file.write_text(
        """<mujoco><option timestep=".001" gravity="0 0 0"/><worldbody>
        <light dir="0 0 -1"/><geom type="plane" size="9 9 .1"/>
        <geom type="box" size=".2 .2 .2" pos="0 .5 .2"/>
        <body pos="0 -2 1"><joint name="j" axis="0 0 1"/><geom size=".05" mass="1"/>
          <camera name="hand" xyaxes="1 0 0 0 .4 1" pos="0 .06 0"/></body></worldbody>
        <actuator><motor joint="j" ctrlrange="-1 1"/></actuator></mujoco>"""
    )
    world = World.from_config(
        RunConfig(
            scene=SceneConfig(file=str(file), camera="hand"),
            sensor=SensorConfig(**IDEAL),
            camera=CameraConfig(),
            threads=1,
        )
    )
    told(world, 4)
    assert traced(world) == WHOLE
    assert world.cameras[0].plan.mobility.camera_moves == "body '1' carries it"
    world.step([0.5])
    told(world, 3)
    assert traced(world) > 3 * WHOLE


HOUSE = Path(__file__).parents[2] / "architecture/test_architecture_layers.py"
DOORS = next(
    ast.literal_eval(node.value)
    for node in ast.parse(HOUSE.read_text()).body
    if isinstance(node, ast.Assign) and ast.unparse(node.targets[0]) == "DOORS"
)
LIBRARIES = {"scipy", *DOORS} - {"numpy", "msgpack", "msgspec", "lazy_loader", "rich"}
SCENE = Path(__file__).parents[3] / "config/scenes/pendulum.xml"
RUN = ["--scene", str(SCENE), "--duration", "0.003", "sensor.width=32", "sensor.height=24"]
COMMANDS = {
    "plan": (["plan", *RUN[:2]], {"mujoco"}),
    "emulate": (["emulate", *RUN], {"mujoco"}),
    "emulate with everything on": (["emulate", *RUN, "--model-everything"], {"mujoco"}),
    "emulate by paths": (["emulate", *RUN, "--renderer", "path"], {"mujoco"}),
    "emulate by the network": (["emulate", *RUN, "--model", "evsnet"], {"mujoco"}),
    "emulate into .npz": (["emulate", *RUN, "--record", "a.npz"], {"mujoco"}),
    "emulate into .aedat4": (
        ["emulate", *RUN, "--record", "a.aedat4"],
        {"mujoco", "flatbuffers", "lz4"},
    ),
    "emulate onto the bus": (
        ["emulate", *RUN, "--publish", "tcp://127.0.0.1:0"],
        {"mujoco", "zmq"},
    ),
    "render": (["render", *RUN, "-o", "b.npz"], {"mujoco"}),
    "sensors": (["sensors"], set()),
}
QUICK = ("emulate",)
"""each takes a second or more, most of it for Python's start"""


@pytest.mark.integration
@pytest.mark.parametrize(
    "name",
    [name if name in QUICK else pytest.param(name, marks=pytest.mark.slow) for name in COMMANDS],
)
def test_a_command_loads_the_libraries_that_it_uses_and_no_other(name: str, tmp_path: Path) -> None:
    words, needed = COMMANDS[name]
    program = (
        "import sys\nfrom evs.launch.main import main\n"
        f"assert main({words!r}) == 0\nprint(*sys.modules, file=sys.stderr)"
    )
    done = subprocess.run(
        [sys.executable, "-c", program],
        cwd=tmp_path,
        # this evs, from wherever it is started
        env={**os.environ, "PYTHONPATH": str(Path(evs.__file__).parents[1])},
        capture_output=True,
        text=True,
        check=True,
    )
    loaded = {module.split(".")[0] for module in done.stderr.split("\n")[-2].split()}
    assert loaded & LIBRARIES == needed
