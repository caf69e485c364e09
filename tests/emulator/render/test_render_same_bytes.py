"""The same light, byte for byte: any instruction set, any number of threads, traced anew or
kept."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path
from typing import Any

import mujoco
import numpy as np
import pytest

from evs.emulator import _core
from evs.emulator.base.scene import CameraPose, LightKind, Shape
from evs.emulator.config import CameraConfig
from evs.emulator.render import make_renderer
from reference.instants import Film
from reference.path_stages import metal_bulb
from reference.stage import Builder, matt
from reference.tessellation import ball, soup

WIDTH, HEIGHT = 117, 83  # no multiple of a packet

SCENE = """
<mujoco>
  <option timestep=".001"/>
  <visual><headlight diffuse=".3 .3 .3" ambient=".1 .1 .1"/></visual>
  <asset>
    <texture name="sky" type="skybox" builtin="gradient" rgb1=".3 .5 .7" rgb2="0 0 0" width="32"
            height="192"/>
    <texture name="tiles" type="2d" builtin="checker" rgb1=".1 .2 .3" rgb2=".7 .8 .6" width="64"
            height="64"/>
    <texture name="skin" type="cube" builtin="gradient" rgb1=".8 .6 .4" rgb2=".2 .3 .4" width="32"
            height="192"/>
    <material name="floor" texture="tiles" texrepeat="4 4" texuniform="true" reflectance=".3"
            specular=".8"/>
    <material name="skin" texture="skin" specular=".5" shininess=".4"/>
    <mesh name="wedge" vertex="0 0 0  .5 0 0  0 .5 0  0 0 .5"/>
  </asset>
  <worldbody>
    <light type="directional" dir=".3 .2 -1" diffuse="{tint}"/>
    <light type="spot" pos="1 -1 2" dir="-1 1 -2" cutoff="30" exponent="4" diffuse=".6 .6 .6"/>
    <light type="point" pos="-1 -1 1.5" diffuse=".2 .2 .2" castshadow="true"/>
    <geom type="plane" size="3 3 .1" material="floor"/>
    <geom type="box" size=".2 .2 .2" pos="-.6 .5 .2" material="skin"/>
    <geom type="mesh" mesh="wedge" pos=".6 .5 .1"/>
    <body pos="0 0 .8"><freejoint/>
      <geom type="capsule" size=".1 .25" euler="30 40 0" material="skin"/>
      <geom type="sphere" size=".12" pos=".25 0 .1"/>
      <geom type="ellipsoid" size=".1 .2 .1" pos="-.2 .2 0"/>
      <geom type="cylinder" size=".08 .1" pos="0 -.2 .1"/>
    </body>
  </worldbody>
</mujoco>
"""
VIEW = CameraConfig(lookat=(0, 0, 0.3), distance=2.6, azimuth=70, elevation=-25)


class Tumbling(Film):
    """A body that falls, tumbling, and renderers with two samples a pixel."""

    def __init__(self, tint: str = ".5 .5 .5") -> None:
        super().__init__(SCENE.format(tint=tint), (WIDTH, HEIGHT), VIEW)
        self.data.qvel[3:] = (3, 5, 2)

    def renderer(self, threads: int = 1, **how: Any) -> Any:
        return super().renderer(threads, **{"spp": 2, **how})


@pytest.mark.parametrize("tint", [".5 .5 .5", ".5 .3 .2"], ids=["grey", "coloured"])
def test_every_instruction_set_and_thread_count_gives_the_same_bytes(tint: str) -> None:
    film = Tumbling(tint)
    frames = film.snapshots(30)[::10]
    reference = film.renderer(isa="portable", incremental=False)
    others = [
        film.renderer(threads=threads, isa=isa, incremental=False)
        for isa in _core.isa_available()
        for threads in (1, 2, 3)
    ]
    for frame in frames:
        light = reference.render(frame, frame.cameras[0]).tobytes()
        assert all(o.render(frame, frame.cameras[0]).tobytes() == light for o in others)


def test_every_instruction_set_hits_the_same() -> None:
    film = Tumbling()
    frame = film.snapshots(1)[0]
    hits = [film.renderer(isa=isa).hits(frame, frame.cameras[0]) for isa in _core.isa_available()]
    for geom, distance in hits:
        np.testing.assert_array_equal(geom, hits[0][0])
        np.testing.assert_array_equal(distance, hits[0][1])


def test_grey_lights_carry_one_channel_and_the_same_light() -> None:
    # a light that is grey but for a rounding error has to be traced in colour
    one, three = Tumbling(".5 .5 .5"), Tumbling(".5 .5 .5000001")
    frame = one.snapshots(1)[0]
    a, b = one.renderer(), three.renderer()
    assert (a._caster.channels, b._caster.channels) == (1, 3)
    pose = frame.cameras[0]
    np.testing.assert_allclose(a.render(frame, pose), b.render(frame, pose), rtol=2e-5, atol=1e-6)


def test_incremental_equals_full_tracing() -> None:
    film = Tumbling()
    kept, full = film.renderer(incremental=True), film.renderer(incremental=False)
    fractions = []
    for frame in film.snapshots(200):
        a, b = (r.render(frame, frame.cameras[0]) for r in (kept, full))
        np.testing.assert_array_equal(a, b)
        fractions.append(kept.traced_fraction)
    # the first frame is traced whole; later ones only around the body, its shadows and mirror image
    assert fractions[0] == 1
    assert 0 < np.mean(fractions[1:]) < 0.6


def test_incremental_with_nothing_moving_traces_nothing() -> None:
    film = Tumbling()
    frame = film.snapshots(1)[0]
    renderer = film.renderer()
    first = renderer.render(frame, frame.cameras[0]).copy()
    again = renderer.render(frame, frame.cameras[0])
    assert renderer.traced_fraction == 0
    np.testing.assert_array_equal(first, again)


def test_incremental_with_a_camera_that_moves_and_rests() -> None:
    film = Tumbling()
    kept, full = film.renderer(incremental=True), film.renderer(incremental=False)
    for k, frame in enumerate(film.snapshots(40)):
        rest = frame.cameras[0]
        # moves for ten ticks, rests for ten
        shift = min(k % 20, 10) + 10 * (k // 20)
        pose = CameraPose(rest.pos + np.array([0.003 * shift, 0, 0]), rest.mat)
        np.testing.assert_array_equal(kept.render(frame, pose), full.render(frame, pose))


@pytest.mark.slow
@pytest.mark.parametrize(
    "name", ["gymnasium/humanoid", "gymnasium/ant", "gymnasium/reacher", "dm_control/humanoid",
             "dm_control/cheetah", "dm_control/quadruped", "dm_control/finger"],
)  # fmt: skip
def test_incremental_equals_full_tracing_on_robots(name: str, robot_files: dict[str, Path]) -> None:
    model = mujoco.MjModel.from_xml_path(str(robot_files[name]))
    model.opt.timestep = 1e-3
    film = Film(model, (WIDTH, HEIGHT), CameraConfig(azimuth=70, elevation=-20))
    kept, full = film.renderer(2), film.renderer(2, incremental=False)
    rng = np.random.default_rng(1)
    for _ in range(200):
        film.data.ctrl[:] = rng.uniform(-0.4, 0.4, model.nu)
        mujoco.mj_step(model, film.data)
        frame = film.taker.snapshot(film.data, 0)
        np.testing.assert_array_equal(
            kept.render(frame, frame.cameras[0]), full.render(frame, frame.cameras[0])
        )


@pytest.mark.parametrize("renderer", ["direct", "hybrid"])
@pytest.mark.parametrize("distance", [1.0, 4.0, 40.0], ids=["within", "near", "far"])
def test_edges_of_meshes_on_any_instruction_set(renderer: str, distance: float) -> None:
    # far away, a pixel shows more triangles than are listed
    made = Builder()
    made.add(Shape.MESH, (1, 1, 1), (0, 0, 0), matt(0.7), mesh=soup(0))
    made.add(Shape.MESH, (1, 1, 1), (0.3, 0.2, 0.1), matt(0.4), mesh=ball(40, (0.9, 0.7, 0.8)))
    made.shine(LightKind.POINT, (1.5, -2.0, 3.0), diffuse=(9, 9, 9))
    stage = made.look((0, -distance, 0.3 * distance), (0, 0, 0), size=(43, 33))
    pictures: dict[str, set[bytes]] = {}
    for isa in _core.isa_available():
        for kind in ("adaptive", "fixed"):
            config = replace(stage.render, renderer=renderer, spp=16, antialiasing=kind, isa=isa)
            seen = make_renderer(stage.scene, stage.camera, config, 2)
            pictures.setdefault(kind, set()).add(seen.render(stage.shot, stage.pose).tobytes())
    assert len(pictures["adaptive"]) == len(pictures["fixed"]) == 1
    assert pictures["adaptive"] != pictures["fixed"]


def test_bulbs_wider_than_a_lobe_on_any_instruction_set() -> None:
    stage = metal_bulb()
    pictures = set()
    for isa in _core.isa_available():
        config = replace(stage.render, renderer="path", spp=4, bounces=2, isa=isa)
        renderer = make_renderer(stage.scene, stage.camera, config, 2)
        pictures.add(np.asarray(renderer.render(stage.shot, stage.pose)).tobytes())
    assert len(pictures) == 1
