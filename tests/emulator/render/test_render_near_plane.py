"""The near plane: what is nearer is as if it were not there, for camera rays and nothing else."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

import mujoco
import numpy as np
import pytest

import evs
from evs.emulator import LeftOutWarning, _core
from evs.msgs import EvsError

NEAR_M = 0.02
"""znear times extent"""

# a fan of three shapes spins 8 to 16 mm before the lens, and a cover 5 mm before it fills the
# picture
SCENE = """
<mujoco><statistic extent="2" center="0 0 0"/><visual><headlight active="0"/></visual>
<asset><mesh name="shard" vertex=".01 0 0 0 .01 0 -.01 0 0 0 0 .004"/></asset>
<worldbody><light pos="1 1 3" castshadow="{shadow}"/><light pos="-.5 0 1.5" castshadow="{shadow}"/>
<geom type="plane" size="3 3 .1" rgba=".2 .6 .3 1"/>
<geom size=".2" pos=".3 .2 .2" rgba=".9 .3 .2 1"/>
<body pos="0 .3 .3"><joint name="slide" type="slide" axis="1 0 0"/>
<geom type="box" size=".1 .1 .1" mass="1"/></body>
<body name="hand" pos="0 0 1"><joint name="tilt" axis="1 0 0"/>
<inertial pos="0 0 0" mass="1" diaginertia="1 1 1"/><camera name="wrist" fovy="60"/>{near}
</body></worldbody></mujoco>"""
INERTIA = '<inertial pos="0 0 0" mass="1" diaginertia="1 1 1"/>'
FAN = f"""<geom name="cover" type="box" size=".2 .2 .0005" pos="0 0 -.0055" rgba="1 0 0 1"/>
<body pos="0 0 -.012"><joint name="fan" axis="0 0 1"/>{INERTIA}
<geom type="capsule" size=".001" fromto="-.006 0 0 .006 0 0"/>
<geom type="mesh" mesh="shard"/><geom type="box" size=".001 .006 .001" rgba="1 1 1 .5"/></body>"""
NO_FAN = f'<body pos="0 0 -.012"><joint name="fan" axis="0 0 1"/>{INERTIA}</body>'

RENDERERS: dict[str, dict[str, Any]] = {
    "direct": {"spp": 4},
    "direct, adaptive": {"spp": 4, "antialiasing": "adaptive"},
    "hybrid": {"renderer": "hybrid", "spp": 1},
    "path": {"renderer": "path", "spp": 4},
    "path, adaptive": {"renderer": "path", "spp": 8, "antialiasing": "adaptive"},
    "raster": {"renderer": "raster"},
}
TRACERS = [name for name in RENDERERS if name != "raster"]
RASTER = pytest.param("raster", marks=pytest.mark.slow)


def model_of(near: str, shadow: bool = True) -> mujoco.MjModel:
    return mujoco.MjModel.from_xml_string(SCENE.format(near=near, shadow=str(shadow).lower()))


def run(model: mujoco.MjModel, **render: Any) -> list[list[Any]]:
    """Light, events and truth: of a still camera before which things move, then of a moving one."""
    sensor, config = evs.SensorConfig("ideal", width=28, height=20), evs.RenderConfig(**render)
    camera = evs.EventCamera(model, "wrist", sensor=sensor, render=config, threads=1)
    data, found = mujoco.MjData(model), []
    for k in range(5):
        data.time = 1e-3 * k
        data.joint("fan").qpos[0], data.joint("slide").qpos[0] = 0.5 * k, 0.02 * k
        data.joint("tilt").qpos[0] = 0.05 * max(0, k - 2)
        events, truth = camera.observe(data), camera.ground_truth()
        found.append(
            [camera.luminance, events, truth.geom_id, truth.depth, truth.normal, truth.flow]
        )
    return found


def check_same(one: list[list[Any]], other: list[list[Any]]) -> None:
    for a, b in zip(one, other, strict=True):
        assert [part.tobytes() for part in a] == [part.tobytes() for part in b]


@pytest.mark.parametrize("name", [*TRACERS, RASTER])
def test_what_is_nearer_is_as_if_it_were_not_there(name: str) -> None:
    render = {**RENDERERS[name], "bounces": 0}
    seen = run(model_of(FAN, shadow=False), **render)
    check_same(seen, run(model_of(NO_FAN, shadow=False), **render))
    # and the scene is there
    assert {0, 1, 2} == set(seen[0][2].ravel().tolist())
    assert seen[0][0].std() > 0.01


@pytest.mark.parametrize("name", TRACERS)
def test_what_is_nearer_casts_shadows_and_is_retraced(name: str) -> None:
    """The same bytes with and without the incremental cache, on every instruction set."""
    near, without = model_of(FAN), model_of(NO_FAN)
    part = run(near, **RENDERERS[name])
    for isa in _core.isa_available():
        check_same(part, run(near, **RENDERERS[name], incremental=False, isa=isa))
    # the lamp above shines on the cover, and not past it
    assert part[0][0].mean() < 0.96 * run(without, **RENDERERS[name])[0][0].mean()


LENSES: dict[str, tuple[dict[str, Any], Callable[[Any], Any]]] = {
    "pinhole": ({"fovy": 100.0}, lambda truth: truth.depth),
    "plumb_bob": (
        {
            "distortion_model": "plumb_bob",
            "distortion": (-0.1, 0.01, 0.0, 0.0, 0.0),
            "focal_px": (20.0, 20.0),
        },
        lambda truth: truth.depth,
    ),
    "fisheye": (
        {"distortion_model": "equidistant", "distortion": (0.0,) * 4, "focal_px": (9.0, 9.0)},
        lambda truth: truth.distance,
    ),
}
WALL = """<mujoco><statistic extent="1"/><worldbody><light pos="0 0 3"/>
<geom type="plane" size="9 9 .1" pos="0 0 -.05" zaxis="-.2 .6 .8"/>
<geom type="sphere" size="3"/><body name="eye"/>
<camera name="flat" {flat} fovy=".1"/></worldbody></mujoco>"""


@pytest.mark.parametrize("lens", [*LENSES, "orthographic"])
def test_it_lies_across_the_axis(lens: str) -> None:
    """A wall comes nearer to one side: what is not seen of it without a near plane is too near."""
    flat = 'projection="orthographic"' if lens == "orthographic" else ""
    if flat and not hasattr(mujoco.MjModel, "cam_projection"):
        pytest.skip("this MuJoCo has no orthographic cameras of a model")
    model = mujoco.MjModel.from_xml_string(WALL.format(flat=flat))
    sensor = evs.SensorConfig("ideal", width=40, height=30)
    optics, measure = LENSES.get(lens, LENSES["pinhole"])

    def truth_at(near_m: float) -> Any:
        world = evs.World(model)
        world.model.vis.map.znear = near_m
        camera = "flat" if flat else evs.CameraConfig(body="eye", **optics)
        return world.add_view(camera, sensor=sensor).ground_truth()

    everything, near_m = truth_at(0.0), 0.06
    cut = truth_at(near_m)
    far = measure(everything)
    seen = everything.geom_id == 0
    assert (seen & (far < near_m)).sum() > 50
    assert (seen & (far > near_m)).sum() > 50
    clear = np.abs(far - near_m) > 1e-5
    expected = np.where(far < near_m, -1, everything.geom_id)
    np.testing.assert_array_equal(cut.geom_id[clear], expected[clear])
    kept = clear & (expected == 0)
    np.testing.assert_array_equal(cut.depth[kept], everything.depth[kept])


def test_it_is_the_models_and_its_edits_show() -> None:
    model = model_of(FAN)
    assert model.vis.map.znear * model.stat.extent == pytest.approx(NEAR_M)
    camera = evs.EventCamera(model, "wrist", sensor=evs.SensorConfig("ideal", width=8, height=6))
    data = mujoco.MjData(model)
    camera.observe(data)
    cover = model.geom("cover").id
    assert cover not in camera.ground_truth().geom_id
    model.vis.map.znear = 1e-3
    data.time = 1e-3
    camera.observe(data)
    assert (camera.ground_truth().geom_id == cover).all()


def test_a_covered_camera_is_warned_of() -> None:
    model = model_of(FAN)
    near = evs.CameraConfig(body="hand", near_m=0.0)
    with pytest.warns(LeftOutWarning, match=r"geom 'cover', at most .* mm.*camera\.near_m, now 0"):
        evs.EventCamera(model, near, sensor="dvs128").observe(mujoco.MjData(model))
    # a wall that fills the picture from afar is no cover
    evs.EventCamera(model, "wrist", sensor="dvs128").observe(mujoco.MjData(model))


@pytest.mark.parametrize("near_m", [-1.0, 1e13])
def test_what_is_no_near_plane_is_refused(near_m: float) -> None:
    with pytest.raises(EvsError, match=r"camera.near_m is .*; give 0 m or more"):
        evs.EventCamera(model_of(FAN), evs.CameraConfig(body="hand", near_m=near_m))
