"""Resets and restores that fail: every world goes on with the bytes it has without the call."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace
from typing import Any

import mujoco
import numpy as np
import pytest

from evs.emulator import ClosedLoop, World, Worlds
from evs.emulator.config import RenderConfig, SensorConfig
from evs.emulator.state import pack, unpack
from evs.emulator.world import SceneValues
from evs.msgs import EvsError
from reference.worlds_alone import SWING, raw

NOISY = SensorConfig("dvs128", width=40, height=32)

GOOD = {"body.arm.mass": 2.5, "geom.rod.rgb.r": 0.3, "camera.left.fovy": 50.0}
OTHER = {"body.arm.mass": 0.7, "geom.rod.rgb.g": 0.4, "light.lamp.pos.x": 0.5}
FAR = """<light name="far" pos="0 -1 9" dir="0 0 1" cutoff="5" diffuse="1e35 1e35 1e35"
  specular="0 0 0"/>"""
BAD = {"body.arm.mass": 1.5, "light.far.brightness": 1e9}
"""a model that MuJoCo takes, with a light that is infinite in single precision"""
HEAVY = {"body.arm.mass": 7.0}
"""what MuJoCo gives up on in `gives_up`"""
SAYS = "no model|over where it begins|diffuse of light 'far' is inf; give a number in"

RENDERERS = {name: RenderConfig(name, spp=1) for name in ("direct", "path", "hybrid")}


def swing() -> Any:
    return mujoco.MjModel.from_xml_string(SWING.replace("<body", FAR + "<body", 1))


def image(model: Any) -> bytes:
    buffer = np.zeros(mujoco.mj_sizeModel(model), np.uint8)
    mujoco.mj_saveModel(model, None, buffer)
    return buffer.tobytes()


def events_of(world: World, ticks: int = 10) -> bytes:
    return b"".join(raw(packet.events) for _ in range(ticks) for packet in world.step([0.5]))


def world_of(render: str = "direct", control: Any = "auto") -> World:
    world = World(swing(), threads=1, control=control)
    world.add_camera("left", sensor=NOISY, render=RENDERERS[render])
    return world


pytestmark = pytest.mark.filterwarnings("ignore:overflow encountered:RuntimeWarning")


@pytest.fixture
def gives_up(monkeypatch: pytest.MonkeyPatch) -> None:
    """MuJoCo gives up in the middle of the constants of a model whose arm has a mass of 7."""
    original = mujoco.mj_setConst

    def set_const(model: Any, data: Any) -> None:
        if model.body("arm").mass[0] == 7.0:
            model.dof_invweight0[:] = 99.0
            model.stat.meaninertia = 99.0
            raise mujoco.FatalError("gave up")
        original(model, data)

    monkeypatch.setattr(mujoco, "mj_setConst", set_const)


def edit(world: World) -> None:
    """A user's edits, of values, of what follows from them, and of what a scene has no key for."""
    world.model.geom("rod").rgba[:3] = (0.2, 0.3, 0.9)
    world.model.dof_invweight0[:] *= 1.5
    world.model.body_inertia[1] *= 1.1
    world.model.stat.meaninertia *= 1.2


@pytest.mark.parametrize("derives", [False, True])
def test_values_that_fail_leave_the_model_to_the_byte(gives_up: None, derives: bool) -> None:
    model = swing()
    scene = SceneValues(model)
    scene.put(GOOD if derives else {"geom.rod.rgb.r": 0.3})
    model.geom("rod").rgba[:3] = (0.2, 0.3, 0.9)
    model.dof_invweight0[:] *= 1.5
    model.stat.meaninertia *= 1.2
    before, values = image(model), scene.values
    with pytest.raises(EvsError, match="these values make no model: gave up"):
        scene.put({**HEAVY, "geom.rod.rgb.b": 0.5})
    assert image(model) == before
    with pytest.raises(ValueError, match="refused"), scene.putting({"geom.rod.rgb.b": 0.5}):
        raise ValueError("refused")
    assert image(model) == before
    assert scene.values == values
    # the model's own is still known
    scene.put({})
    other = swing()
    assert model.geom("rod").rgba.tolist() == other.geom("rod").rgba.tolist()


@pytest.mark.parametrize("bad", [BAD, HEAVY], ids=["light", "constants"])
@pytest.mark.parametrize("own", [False, True], ids=["plain", "values"])
@pytest.mark.parametrize("render", RENDERERS)
def test_a_world_goes_on_after_a_failed_reset(
    gives_up: None, render: str, own: bool, bad: dict[str, float]
) -> None:
    # a control that reads what follows from the state, as the last step left it
    def control(t_s: float, data: Any) -> Any:
        return [np.sin(40.0 * t_s) + data.body("arm").xquat[2] + data.sensor("angle").data[0]]

    world, twin = world_of(render, control), world_of(render, control)
    view, same = (one.add_view("right", sensor=NOISY) for one in (world, twin))
    for one in (world, twin):
        one.reset(seed=4, scene=GOOD if own else None)
        for _ in range(3):
            one.step()
        edit(one)
        one.step()
    model, data, rebuilt = world.model, world.data, dict(world.cameras[0].rebuilt)
    revision, sensor = world.revision, replace(NOISY, pos_thres=0.3)
    for scene in (bad, {**bad, "joint.swing.qpos": 0.4}):
        with pytest.raises(EvsError, match=SAYS):
            world.reset(seed=9, keyframe="up", sensor=sensor if own else None, scene=scene)
    assert world.model is model
    assert world.data is data
    assert (world.revision, world.cameras[0].rebuilt) == (revision, rebuilt)
    assert image(world.model) == image(twin.model)
    assert world.save() == twin.save()
    assert np.array_equal(view.render()[0], same.render()[0])
    for _ in range(5):
        (packet,), (expected,) = world.step(), twin.step()
        assert raw(packet.events) == raw(expected.events)
    # and takes values that make a model
    for one in (world, twin):
        one.reset(seed=5, scene=OTHER)
    assert events_of(world) == events_of(twin)
    assert world.save() == twin.save()


def test_edits_of_large_arrays_are_compared_when_they_would_be_without_the_failed_reset() -> None:
    xml = SWING.replace("<body", FAR + "<body", 1).replace(
        "<worldbody>",
        """<asset>
      <texture name="dots" type="2d" builtin="checker" rgb1="1 1 1" rgb2="0 0 0" width="16"
        height="16"/><material name="dots" texture="dots" texrepeat="5 5"/></asset><worldbody>""",
    )
    xml = xml.replace('rgba=".3 .3 .3 1"', 'material="dots"')
    worlds = [World(mujoco.MjModel.from_xml_string(xml), threads=1) for _ in range(2)]
    for world in worlds:
        world.add_camera("left", sensor=NOISY)
        world.reset(scene=GOOD)
    for pending in (True, False):
        with pytest.raises(EvsError, match=SAYS):
            worlds[0].reset(scene=BAD)
        for world in worlds:
            # seen by the first step after a reset, and not later
            world.model.tex_data[:] = 40 if pending else 200
        assert events_of(worlds[0], 5) == events_of(worlds[1], 5)
    with pytest.raises(EvsError, match=SAYS):
        worlds[0].reset(scene=BAD)
    assert events_of(worlds[0], 5) == events_of(worlds[1], 5)
    assert worlds[0].cameras[0].luminance.max() < 100


def worlds_of(count: int = 3, **options: Any) -> Worlds:
    worlds = Worlds(swing(), count, threads=2, sensors=("angle",), **options)
    worlds.add_camera("left", sensor=NOISY)
    return worlds


def assert_same(worlds: Worlds, others: Worlds, ticks: int = 6) -> None:
    """What both are, and what they give from here on."""
    assert worlds.ended == others.ended
    assert np.array_equal(worlds.readings["angle"], others.readings["angle"])
    assert np.array_equal(worlds.position, others.position)
    assert worlds.seeds == others.seeds
    (seen,), (expected,) = worlds.step(ticks=ticks), others.step(ticks=ticks)
    assert raw(seen.events) == raw(expected.events)
    assert seen.offsets.tolist() == expected.offsets.tolist()
    assert np.array_equal(worlds.velocity, others.velocity)
    assert worlds.save() == others.save()
    for number in range(len(worlds)):
        assert image(worlds.world(number).model) == image(others.world(number).model)
        assert worlds.world(number).scene_values == others.world(number).scene_values


def refuse(number: int, data: Any) -> None:
    data.qpos[0] = 0.5
    if number == 2:
        raise EvsError("there is no model for this start")


FAILURES: dict[str, Callable[[Worlds], None]] = {
    "the last has no model": lambda worlds: worlds.reset([7, 8, 9], scene=[GOOD, OTHER, BAD]),
    "the first has none": lambda worlds: worlds.reset([7, 8, 9], scene=[HEAVY, GOOD, {}]),
    "a subset": lambda worlds: worlds.reset([7, 8], [2, 0], scene=[OTHER, BAD], keyframe="up"),
    "start": lambda worlds: worlds.reset(5, scene=[OTHER, GOOD, {}], start=refuse),
    "start without values": lambda worlds: worlds.reset(5, start=refuse),
    "over at once": lambda worlds: worlds.reset(
        4, scene=OTHER, start=lambda _, data: data.qpos.__setitem__(0, 1.5), must_run=True
    ),
}


@pytest.mark.parametrize("control", ["random", pytest.param("function", marks=pytest.mark.slow)])
@pytest.mark.parametrize("own", [False, True], ids=["shared", "values"])
@pytest.mark.parametrize("name", FAILURES)
def test_all_worlds_go_on_after_a_failed_reset(
    gives_up: None, name: str, own: bool, control: str
) -> None:
    def function(t_s: float, data: Any) -> Any:
        return [np.sin(40.0 * t_s) + data.qpos[0]]

    limits = {"angle": (-1.2, 1.2)}
    options: dict[str, Any] = {"control": function if control == "function" else control}
    worlds, others = (worlds_of(**options, limits=limits) for _ in range(2))
    assert (worlds.one_by_one == "") == (control == "random")
    for one in (worlds, others):
        one.reset(3, scene=[GOOD, OTHER, {}] if own else None)
        # the last has ended
        one.reset([4], [2], start=lambda _, data: data.qpos.__setitem__(0, 1.5))
        one.step(ticks=4)
    assert {*worlds.ended} == {2}
    with pytest.raises(EvsError, match=SAYS):
        FAILURES[name](worlds)
    assert_same(worlds, others)
    models = [worlds.world(number).model for number in range(3)]
    assert len({id(model) for model in models}) == (3 if own else 1)
    # an edit of a model shows in all that share it
    for one in (worlds, others):
        one.world(0).model.geom("rod").rgba[:3] = (0.2, 0.3, 0.9)
    assert_same(worlds, others)
    for one in (worlds, others):
        one.reset(6, scene=[OTHER, {}, GOOD])
    assert_same(worlds, others)


def test_a_loop_goes_on_after_a_failed_reset(gives_up: None) -> None:
    loop, other = (ClosedLoop(swing(), "left", sensor=NOISY, threads=1) for _ in range(2))
    for one in (loop, other):
        one.reset(seed=2, scene=GOOD)
        one.step([0.5], 3)
    for scene in (BAD, HEAVY):
        with pytest.raises(EvsError, match=SAYS):
            loop.reset(seed=3, state=True, scene=scene)
    assert loop.save() == other.save()
    seen, expected = loop.step([0.1], 5), other.step([0.1], 5)
    assert raw(seen.packets[-1].events) == raw(expected.packets[-1].events)
    assert np.array_equal(seen.position, expected.position)
    assert seen.state is None
    # a camera that a loop cannot have is found before anything is reset
    before = loop.save()
    with pytest.raises(EvsError, match="no keyframe"):
        loop.reset(seed=3, keyframe="nowhere", scene=OTHER)
    assert loop.save() == before


def damaged(blob: bytes, name: str) -> bytes:
    """The state with times that go backwards, or a cache of light on a geom that is not there."""
    about, arrays = unpack(blob)
    if name == "times":
        arrays["moments.times"] = arrays["moments.times"][::-1].copy()
    else:
        arrays["cameras.0.light.keys"][0, 0] = 10_000
    return pack(about, arrays)


@pytest.mark.parametrize("own", [False, True], ids=["plain", "values"])
@pytest.mark.parametrize(
    ("name", "render"),
    [
        *((name, render) for name in ("times", "camera") for render in RENDERERS),
        ("light", "hybrid"),
    ],
)
def test_a_world_goes_on_after_a_failed_restore(name: str, render: str, own: bool) -> None:
    world, twin, source = (world_of(render) for _ in range(3))
    source.reset(seed=8, scene=OTHER)
    source.step([0.5])
    for one in (world, twin):
        one.reset(seed=4, scene=GOOD if own else None)
        events_of(one, 4)
    model, data, revision = world.model, world.data, world.revision
    if name == "camera":
        # values that fit, in a world of another camera
        other = World(swing(), threads=1)
        other.add_camera("right", sensor=NOISY)
        other.reset(scene=OTHER)
        blobs = [other.save()]
    else:
        blobs = [damaged(one.save(), name) for one in (source, twin)]
    for blob in blobs:
        with pytest.raises(EvsError, match=r"^saved (state is damaged|by another)"):
            world.restore(blob)
    assert (world.model is model, world.data is data, world.revision) == (True, True, revision)
    assert image(world.model) == image(twin.model)
    assert world.save() == twin.save()
    assert events_of(world) == events_of(twin)
    world.restore(source.save())
    assert events_of(world) == events_of(source)


def test_no_world_is_restored_where_one_is_damaged() -> None:
    worlds, others, source = worlds_of(), worlds_of(), worlds_of()
    source.reset(8, scene=[OTHER, {}, GOOD])
    source.step(ticks=3)
    for one in (worlds, others):
        one.reset(3, scene=[GOOD, {}, {}])
        one.step(ticks=4)
    blobs = source.save()
    for broken in range(3):
        mixed = [damaged(b, "times") if n == broken else b for n, b in enumerate(blobs)]
        with pytest.raises(EvsError, match="saved state is damaged"):
            worlds.restore(mixed)
        with pytest.raises(EvsError, match="saved state is damaged"):
            worlds.restore([blobs[0], damaged(blobs[1], "times")], [2, 1])
        assert_same(worlds, others)
    worlds.restore(blobs)
    assert_same(worlds, source)


def test_a_loop_goes_on_after_a_failed_restore() -> None:
    loop, other, source = (ClosedLoop(swing(), "left", sensor=NOISY, threads=1) for _ in range(3))
    source.reset(seed=9, scene=OTHER)
    source.step([0.5], 2)
    about, arrays = unpack(source.save())
    for one in (loop, other):
        one.reset(seed=2, scene=GOOD)
        one.step([0.5], 3)
    for name in ("world.moments.times", "channels.controls.times"):
        broken = {**arrays, name: np.array([[9, 1]], np.int64)}
        with pytest.raises(EvsError, match="saved state is damaged"):
            loop.restore(pack(about, broken))
        assert loop.save() == other.save()
    assert loop.world.scene_values == GOOD
    seen, expected = loop.step([0.1], 5), other.step([0.1], 5)
    assert raw(seen.packets[-1].events) == raw(expected.packets[-1].events)
