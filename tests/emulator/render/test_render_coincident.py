"""Surfaces that coincide: the last geom of the model is seen, wherever and however it is traced."""

from __future__ import annotations

import itertools
import os
import subprocess
import sys
from typing import Any

import mujoco
import numpy as np
import pytest

import evs
from evs.emulator import _core

CORNERS = " ".join(f"{x} {y} {z}" for x in (-0.3, 0.3) for y in (-0.3, 0.3) for z in (-0.1, 0.1))
FLAT = {
    "box": 'type="box" size=".3 .3 .1"',
    "mesh": 'type="mesh" mesh="m"',
    "plane": 'type="plane" size=".3 .3 .1" pos="0 0 .1"',
    "cylinder": 'type="cylinder" size=".45 .1"',
    "hfield": 'type="hfield" hfield="h" pos="0 0 .1"',
}
ROUND = {
    "sphere": 'type="sphere" size=".2"',
    "ellipsoid": 'type="ellipsoid" size=".2 .2 .2"',
    "capsule": 'type="capsule" size=".2 1e-9"',
}
COLOURS = (".8 .1 .1 1", ".1 .1 .9 1")
FILLER = "".join(f'<geom size=".01" pos="{5 + k} 0 0"/>' for k in range(140))
"""enough geoms for a hierarchy"""


def model_of(*geoms: str, more: str = "") -> mujoco.MjModel:
    """These geoms, in this order; the camera goes around them and looks down by 20 degrees."""
    return mujoco.MjModel.from_xml_string(f"""
<mujoco><asset><mesh name="m" vertex="{CORNERS}"/>
<hfield name="h" nrow="2" ncol="2" size=".3 .3 1e-9 .2" elevation="0 0 0 0"/></asset>
<visual><headlight diffuse=".6 .6 .6" specular="0 0 0"/></visual>
<worldbody>{"".join(geoms)}{more}<body><joint name="turn" axis="0 0 1"/>
<inertial pos="0 0 0" mass="1" diaginertia="1 1 1"/>
<camera name="eye" pos=".07 -2.1 .8" xyaxes="1 0 0 0 .342 .94" fovy="20"/></body>
</worldbody></mujoco>""")


def seen(model: mujoco.MjModel, turn: float, **render: Any) -> tuple[Any, Any]:
    """Ids and light."""
    sensor = evs.SensorConfig("ideal", width=48, height=32)
    config = evs.RenderConfig(**{"spp": 1, **render})
    camera = evs.EventCamera(model, "eye", sensor=sensor, render=config, threads=1)
    data = mujoco.MjData(model)
    camera.observe(data)
    data.time, data.qpos[0] = 1e-3, turn
    camera.observe(data)
    return camera.ground_truth().geom_id, camera.luminance


def geom(kinds: dict[str, str], kind: str, which: int) -> str:
    return f'<geom {kinds[kind]} rgba="{COLOURS[which]}"/>'


def inside_of(top: np.ndarray) -> np.ndarray:
    """Not where a sample of a pixel, or a part of it, may see something else."""
    inside = top.copy()
    for axis, step in itertools.product((0, 1), (1, -1)):
        inside &= np.roll(top, step, axis)
    assert inside.sum() > 100
    return inside


@pytest.mark.parametrize("more", ["", FILLER], ids=["few", "many"])
@pytest.mark.parametrize("kinds", [FLAT, ROUND], ids=["flat", "round"])
def test_the_last_of_the_model_is_seen(kinds: dict[str, str], more: str) -> None:
    turn = 0.7
    alone = {kind: seen(model_of(geom(kinds, kind, 1)), turn) for kind in kinds}
    # only the top of flat shapes, which all of them have where the plane is
    top = np.logical_and.reduce([ids == 0 for ids, _ in alone.values()])
    assert top.sum() > 150
    inside = inside_of(top)
    for first, last in itertools.product(kinds, kinds):
        model = model_of(geom(kinds, first, 0), geom(kinds, last, 1), more=more)
        ids, light = seen(model, turn)
        assert (ids[top] == 1).all(), (first, last)
        np.testing.assert_allclose(light[inside], alone[last][1][inside], rtol=1e-4)


LAMP = '<light pos=".3 .2 3" dir="-.1 0 -1" cutoff="60" diffuse=".5 .5 .5"/>'


@pytest.mark.parametrize("renderer", ["direct", "hybrid", "path"])
@pytest.mark.parametrize("kinds", [FLAT, ROUND], ids=["flat", "round"])
def test_nothing_is_shaded_by_what_it_coincides_with(renderer: str, kinds: dict[str, str]) -> None:
    """Shadow rays of a lamp and of the sky, from each kind on each other."""
    more = {"renderer": renderer, "spp": 4} | ({} if renderer == "direct" else {"bounces": 0})
    alone = {kind: seen(model_of(geom(kinds, kind, 1), more=LAMP), 0.4, **more) for kind in kinds}
    top = np.logical_and.reduce([ids == 0 for ids, _ in alone.values()])
    inside = inside_of(top)
    for first, last in itertools.product(kinds, kinds):
        model = model_of(geom(kinds, first, 0), geom(kinds, last, 1), more=LAMP)
        light = seen(model, 0.4, **more)[1]
        np.testing.assert_allclose(
            light[inside], alone[last][1][inside], rtol=1e-3, err_msg=f"{first} {last}"
        )


@pytest.mark.parametrize(
    ("renderer", "pair"),
    [
        *itertools.product(
            ["direct", "hybrid", "path"],
            [("box", "mesh"), ("mesh", "box"), ("plane", "box"), ("box", "box")],
        )
    ],
)
def test_every_renderer_sees_the_same(renderer: str, pair: tuple[str, str]) -> None:
    first, last = (geom(FLAT, kind, k) for k, kind in enumerate(pair))
    top = seen(model_of(geom(FLAT, "plane", 0)), 0.4)[0] == 0
    inside = inside_of(top)
    render = {"renderer": renderer, "spp": 4, "bounces": 0}
    expected = seen(model_of(last), 0.4, **render)[1]
    for isa, incremental in itertools.product(_core.isa_available(), (True, False)):
        _, light = seen(model_of(first, last), 0.4, **render, isa=isa, incremental=incremental)
        np.testing.assert_allclose(light[inside], expected[inside], rtol=1e-3)
        if isa == _core.isa_available()[0] and incremental:
            same = light
        assert light.tobytes() == same.tobytes()


def test_a_transparent_surface_does_not_hide_what_it_lies_on() -> None:
    floor, glass = '<geom {} rgba=".8 .8 .8 1"/>', '<geom {} rgba=".1 .1 .1 .5"/>'
    for pair in (("box", "box"), ("mesh", "box"), ("box", "mesh"), ("mesh", "plane")):
        under, over = floor.format(FLAT[pair[0]]), glass.format(FLAT[pair[1]])
        raised = over.replace("/>", ' pos="0 0 {}"/>'.format("1e-4" if pair[1] != "plane" else ""))
        if pair[1] == "plane":
            raised = over.replace('pos="0 0 .1"', 'pos="0 0 .1001"')
        top = seen(model_of(geom(FLAT, "plane", 0)), 0.4)[0] == 0
        inside = inside_of(top)
        apart = seen(model_of(under, raised), 0.4)[1][inside]
        together = seen(model_of(under, over), 0.4)[1][inside]
        np.testing.assert_allclose(np.median(together), np.median(apart), rtol=0.02)
        np.testing.assert_allclose(together, apart, rtol=0.1)


SCRIPT = """
import sys, mujoco, numpy as np
model = mujoco.MjModel.from_xml_string(sys.stdin.read())
data = mujoco.MjData(model)
mujoco.mj_forward(model, data)
renderer = mujoco.Renderer(model, 48, 64)
renderer.enable_segmentation_rendering()
renderer.update_scene(data, "eye")
print(*np.unique(renderer.render()[..., 0]))
"""


@pytest.mark.slow
@pytest.mark.parametrize("kind", [*FLAT, *ROUND])
def test_mujocos_picture_shows_the_last_of_two_alike(kind: str) -> None:
    kinds = FLAT if kind in FLAT else ROUND
    found = subprocess.run(
        [sys.executable, "-c", SCRIPT],
        input=mujoco_text(kinds[kind]),
        env={**os.environ, "MUJOCO_GL": "egl"},
        capture_output=True,
        text=True,
        check=True,
        timeout=120,
    )
    assert found.stdout.split() == ["-1", "1"]


def mujoco_text(shape: str) -> str:
    twice = "".join(f'<geom {shape} rgba="{colour}"/>' for colour in COLOURS)
    return f"""<mujoco><asset><mesh name="m" vertex="{CORNERS}"/>
<hfield name="h" nrow="2" ncol="2" size=".3 .3 1e-9 .2" elevation="0 0 0 0"/></asset><worldbody>
{twice}<camera name="eye" pos=".07 -2.1 .8" fovy="20"
xyaxes="1 0 0 0 .342 .94"/></worldbody></mujoco>"""
