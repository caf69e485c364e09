"""The scenes of the data set do what they claim; their textures are what the generator makes."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from PIL import Image

from evs.emulator import World
from evs.emulator.config import RenderConfig, RunConfig
from evs.emulator.sensor import resolve_sensor
from evs.msgs import EvsError
from evs.tools.dataset import named, names, of_file
from evs.tools.dataset.scenes import FOLDER
from evs.tools.dataset.sequence_spec import make_sequence_spec
from evs.tools.dataset.textures import TEXTURES, texture

SIX = ("kitchen", "park", "playroom", "street", "tunnel", "workshop")
SMALL = [("sensor.width", "86"), ("sensor.height", "65"), ("frames.spp", "8")]


def test_there_are_six_of_ninety_seconds_three_of_them_indoors() -> None:
    assert names() == SIX
    scenes = [named(name) for name in names()]
    assert sum(scene.duration_s for scene in scenes) == pytest.approx(90.0)
    places = [scene.place for scene in scenes]
    assert places.count("indoor") == 3
    assert set(places) == {"indoor", "outdoor", "night"}
    for scene in scenes:
        assert (scene.render.renderer, scene.model.labels) == ("path", True)
        assert scene.sensor.imu.enabled
        assert (scene.frames.fps, scene.frames.spp) == (60.0, 256)
    assert named("park", [("render.renderer", "direct")]).frames.spp == 64


@pytest.mark.slow
@pytest.mark.parametrize("name", SIX)
def test_a_scene_moves_and_is_as_bright_as_it_says(name: str) -> None:
    """The camera and at least three bodies move; its middle grey is what an exposure gives."""
    scene = named(name, SMALL)
    sequence = make_sequence_spec(name, scene)
    with sequence.with_model_file() as config:
        world, view = sequence.view_at(config, 0)
        control = sequence.control(world)
        eyes, bodies = [view.pose.position], [world.data.xpos.copy()]
        for _ in range(1500):
            world.step(control())
        eyes.append(view.pose.position)
        bodies.append(world.data.xpos.copy())
        exposed = view.render()[0] * float(resolve_sensor(scene.sensor).exposure_dn)
        truth = view.ground_truth()
    assert np.linalg.norm(np.subtract(*eyes)) > 0.05
    moved = np.linalg.norm(bodies[1] - bodies[0], axis=1)
    assert np.count_nonzero(moved > 0.02) >= 3
    # what is exposed rightly: neither black nor blown out; a night's middle is darker than a day's
    middle = float(np.median(exposed))
    low, high = {"night": (2.0, 30.0), "indoor": (8.0, 200.0), "outdoor": (2.0, 200.0)}[scene.place]
    assert low < middle < high
    assert len(np.unique(truth.geom_id)) > 12
    # a roof over the head: indoors, and deep in the tunnel, a ray meets something everywhere
    assert np.isfinite(truth.distance).all() == (scene.place == "indoor" or name == "tunnel")


@pytest.mark.slow
def test_the_tunnel_ends_in_daylight() -> None:
    """Which dazzles: ten times as bright as the tunnel for the same exposure, with a sky."""
    sequence = make_sequence_spec("tunnel", named("tunnel", SMALL))
    with sequence.with_model_file() as config:
        inside = float(np.median(sequence.view_at(config, 0)[1].render()[0]))
        _, view = sequence.view_at(config, 13_000)
        assert float(np.median(view.render()[0])) > 10 * inside
        assert not np.isfinite(view.ground_truth().distance).all()


@pytest.mark.slow
def test_light_as_such_is_of_another_order_by_night() -> None:
    """Before exposure: the night's median is far below any day's, as lux are."""

    def median(name: str) -> float:
        sequence = make_sequence_spec(name, named(name, SMALL))
        with sequence.with_model_file() as config:
            return float(np.median(sequence.view_at(config, 0)[1].render()[0]))

    night, room, day = median("street"), median("workshop"), median("park")
    assert 5 * night < room < day


@pytest.mark.parametrize("name", TEXTURES)
def test_the_textures_that_ship_are_what_the_generator_makes(name: str) -> None:
    """But for libm: a last bit of a sine may tip a rounding, in fewer than one pixel of 10,000."""
    with Image.open(FOLDER / "textures" / f"{name}.png") as image:
        there = np.asarray(image.convert("RGB"))
    assert there.shape == texture(name).shape
    assert np.count_nonzero((there != texture(name)).any(-1)) <= there.shape[0] ** 2 / 10_000


def test_every_texture_and_track_of_the_scenes_is_used() -> None:
    described = "".join((FOLDER / f"{name}.xml").read_text() for name in names())
    assert [name for name in TEXTURES if f'file="{name}.png"' not in described] == []


def test_the_shipped_scenes_are_small(tmp_path: Path) -> None:
    size = sum(path.stat().st_size for path in FOLDER.rglob("*") if path.is_file())
    assert size < 400_000


def test_any_file_is_a_scene_and_one_beside_it_tells_how_it_moves(tmp_path: Path) -> None:
    body = '<body><joint name="a"/><geom size="1"/></body>'
    motor = '<actuator><motor name="a" joint="a"/></actuator>'
    text = f"<mujoco><worldbody>{body}</worldbody>{motor}</mujoco>"
    (tmp_path / "own.xml").write_text(text)
    scene = of_file(str(tmp_path / "own.xml"), "own")
    assert (scene.scene.control, scene.model.labels) == ("random", True)
    (tmp_path / "own.toml").write_text('about = "mine"\n[[motion]]\nactuator = "a"\nshake = 0.5\n')
    scene = of_file(str(tmp_path / "own.xml"), "own")
    assert (scene.about, scene.scene.control) == ("mine", "auto")
    assert scene.motion[0].actuator == "a"
    (tmp_path / "own.toml").write_text('place = "moon"\n')
    with pytest.raises(EvsError, match="at place: 'moon' is none of indoor, outdoor, night"):
        of_file(str(tmp_path / "own.xml"), "own")


def test_flow_of_a_still_scene_is_the_motion_of_the_pose(tmp_path: Path) -> None:
    """Where only the camera moves, a point's flow follows from its depth and both poses."""
    (tmp_path / "still.xml").write_text(
        """<mujoco><visual><headlight ambient="0.4 0.4 0.4"/></visual><worldbody>
        <geom type="plane" size="3 3 1"/><geom type="box" size=".4 .3 .5" pos=".3 .5 .5"/>
        <body pos="0 -3 1.2" gravcomp="1"><joint name="x" type="slide" axis="1 0 0"/>
        <joint name="yaw" axis="0 0 1"/><geom size=".001" mass="1" rgba="0 0 0 0"/>
        <inertial pos="0 0 0" mass="1" diaginertia="1 1 1"/>
        <camera name="eye" xyaxes="1 0 0 0 .3 1" fovy="50"/></body></worldbody>
        <actuator><velocity name="x" joint="x" kv="100"/><velocity name="yaw" joint="yaw" kv="100"/>
        </actuator></mujoco>"""
    )
    (tmp_path / "still.toml").write_text(
        '[[motion]]\nactuator = "x"\nat = [[0, 0.7]]\n'
        '[[motion]]\nactuator = "yaw"\nat = [[0, 0.4]]\n'
    )
    scene = of_file(str(tmp_path / "still.xml"), "still", [*SMALL, ("scene.camera", "eye")])
    scene = replace(scene, render=RenderConfig())
    sequence = make_sequence_spec("still", scene)
    with sequence.with_model_file() as config:
        world, view = World.with_view(config)
        control = sequence.control(world)
        poses = []
        for _ in range(60):
            world.step(control())
            poses.append(view.pose)
    truth = view.ground_truth()
    k = np.array(view.camera_info["k"], float).reshape(3, 3)
    points = truth.position.astype(np.float64)
    shown = [_projected(points, pose, k) for pose in poses[-2:]]
    expected = (shown[1] - shown[0]) / (sequence.tick_us * 1e-6)
    there = np.isfinite(truth.depth)
    error = np.abs(truth.flow - expected)[there]
    speed = np.linalg.norm(expected[there], axis=-1)
    assert np.median(speed) > 10
    # float32 positions: 1e-6 m of 3 m in 1 ms, 70 px/rad: 0.02 px/s, and as much again
    assert error.max() < 0.1


def _projected(points: np.ndarray, pose: object, k: np.ndarray) -> np.ndarray:
    """(h, w, 2) px of world points. The quaternion (x, y, z, w) turns optical axes into world's."""
    x, y, z, w = pose.orientation  # type: ignore[attr-defined]
    turn = np.array(
        [
            [1 - 2 * (y * y + z * z), 2 * (x * y - z * w), 2 * (x * z + y * w)],
            [2 * (x * y + z * w), 1 - 2 * (x * x + z * z), 2 * (y * z - x * w)],
            [2 * (x * z - y * w), 2 * (y * z + x * w), 1 - 2 * (x * x + y * y)],
        ]
    )
    seen = (points - np.array(pose.position)) @ turn  # type: ignore[attr-defined]
    image = seen @ k.T
    return image[..., :2] / image[..., 2:]


def test_run_is_the_part_that_shapes_the_events() -> None:
    run = named("park").run()
    assert type(run) is RunConfig
    assert run.name == "park"
