"""Randomised scenes: draws are pure, act where they should, and worlds have the bytes of one."""

from __future__ import annotations

import gc
from collections.abc import Mapping
from pathlib import Path
from typing import Any

import mujoco
import numpy as np
import pytest

import evs
from evs.emulator import ClosedLoop, World, Worlds
from evs.emulator.config import CameraConfig, RenderConfig, SensorConfig, VisualConfig
from evs.emulator.simulation.scene_ranges import SceneRanges
from evs.emulator.world import NamedSensors, load_model
from evs.msgs import EvsError
from reference.edited import STAGE
from reference.worlds_alone import SWING, Alone, assert_same_states, both, by_world, raw, step_both

SCENES = Path(__file__).parents[3] / "config/scenes"
CART = SCENES / "cartpole.xml"
SMALL = SensorConfig("ideal", width=40, height=32)
NOISY = SensorConfig("dvs128", width=40, height=32)

RANGES = {
    "light.lamp.brightness": "uniform(0.3, 1)",
    "geom.*.rgb": "uniform(0.1, 1)",
    "geom.rod.friction": "uniform(0.4, 1.2)",
    "body.arm.mass": "log_uniform(0.5, 2) * nominal",
    "joint.swing.damping": "uniform(0, 0.5)",
    "camera.left.pos": "normal(0, 0.02) + nominal",
    "camera.left.rotvec": "normal(0, 1)",
    "camera.left.fovy": "normal(45, 2)",
    "option.gravity.z": "normal(-9.81, 0.3)",
    "joint.swing.qpos": "uniform(-0.5, 0.5)",
    "joint.swing.qvel": "uniform(-4, 4)",
}


def swing() -> Any:
    return mujoco.MjModel.from_xml_string(SWING)


def drawn(count: int, seed: int = 5) -> list[dict[str, float]]:
    """Values of some episodes of the swing."""
    ranges = SceneRanges(RANGES, swing())
    return [ranges.draw(seed, episode).values for episode in range(count)]


def world_of(scene: Any, camera: Any = "left", **options: Any) -> World:
    world = World(scene, threads=1)
    world.add_camera(camera, **{"sensor": SMALL, **options})
    return world


def events_of(world: World, ticks: int = 10) -> bytes:
    return b"".join(raw(packet.events) for _ in range(ticks) for packet in world.step())


def test_a_draw_follows_from_seed_and_episode_alone() -> None:
    ranges = SceneRanges(RANGES, swing())
    first = ranges.draw(7, 3)
    ranges.draw(8, 1)
    again = evs.SceneRanges(dict(reversed(RANGES.items())), swing()).draw(7, 3)
    assert first == again
    assert first.record == {"seed": 7, "episode": 3, "values": first.values}
    assert ranges.draw(7 + 2**64, 3).values == first.values
    for other in (ranges.draw(7, 4), ranges.draw(8, 3)):
        assert all(other.values[key] != value for key, value in first.values.items())
    for key, text in RANGES.items():
        alone = SceneRanges({key: text}, swing()).draw(7, 3).values
        assert alone == {name: first.values[name] for name in alone}
    # a name that a pattern stands for draws what the pattern draws
    one = SceneRanges({"geom.rod.rgb.g": "uniform(0.1, 1)"}, swing()).draw(7, 3).values
    assert one == {"geom.rod.rgb.g": first.values["geom.rod.rgb.g"]}
    for value in first.values.values():
        assert float(f"{value:.6g}") == value


def test_values_that_were_written_down() -> None:
    # a change of these changes every randomised data set that is made again
    values = SceneRanges(RANGES, swing()).draw(1, 2).values
    keys = ("light.lamp.brightness", "body.arm.mass", "camera.left.pos.y", "joint.swing.qpos")
    assert [values[key] for key in keys] == [0.48541, 4.25387, -2.01494, -0.028286]


def test_values_are_near_the_models_own_or_follow_another() -> None:
    ranges = SceneRanges(
        {
            "camera.left.pos.y": "uniform(-0.1, 0.1) + nominal",
            "camera.right.pos.x": "uniform(1.9, 2.1)",
            "geom.rod.rgb.g": "choice(1) * geom.rod.rgb.r",
            "geom.rod.rgb.r": "uniform(0.2, 0.8)",
            "body.arm.mass": "uniform(0.5, 2) * nominal",
            "joint.swing.qvel": "choice(0.5) + joint.swing.qpos",
        },
        swing(),
    )
    own = float(swing().body("arm").mass[0])
    found = [ranges.draw(1, episode).values for episode in range(300)]
    away = np.array([one["camera.left.pos.y"] + 2.0 for one in found])
    # 300 numbers all miss an outer twentieth of a range once in 10^6 runs
    assert -0.1 <= away.min() < -0.09 < 0.09 < away.max() <= 0.1 + 1e-9
    mass = np.array([one["body.arm.mass"] / own for one in found])
    assert 0.5 - 1e-5 <= mass.min() < 0.58 < 1.92 < mass.max() <= 2 + 1e-5
    assert all(one["geom.rod.rgb.g"] == one["geom.rod.rgb.r"] for one in found)
    # the model starts at qpos0, and nobody has a range for it
    assert all(one["joint.swing.qvel"] == 0.5 for one in found)


@pytest.mark.parametrize(
    ("ranges", "says"),
    [
        ({"body.amr.mass": "uniform(1, 2)"}, "at randomise.scene.body.amr.mass: no body 'amr'; th"),
        ({"lamp.*.pos": "uniform(1, 2)"}, "no kind of object 'lamp'; there is: camera"),
        ({"light.x*.pos": "uniform(1, 2)"}, r"at randomise.scene.light.x\*.pos: no light fits 'x"),
        ({"body.arm.mass": 3}, "at randomise.scene.body.arm.mass: 3 is no distribution"),
        ({"body.arm.mass": "unifrm(1, 2)"}, "no distribution 'unifrm'; there is: uniform"),
        ({"body.*.mass": "uniform(0, 1)"}, r"body.\*.mass \(body.arm.mass\): .*0 is outside 1e-12"),
        ({"geom.rod.rgb": "uniform(0, 2)"}, r"rgb \(geom.rod.rgb.b\): .*2 is outside 0 \.\.\. 1"),
        ({"camera.left.fovy": "uniform(5, 4) * nominal"}, "give the lower value first"),
        ({"camera.left.fovy": "uniform(1, 5) * nominal"}, "225 is outside 0.001 ... 179.9"),
        ({"camera.left.fovy": "uniform(-50, 0) + nominal"}, "-5 is outside 0.001 ... 179.9"),
        ({"camera.left.fovy": "normal(1e4, 1) + nominal"}, "outside 0.001"),
        ({"camera.left.pos": "uniform(1, 2) * nominal"}, "pos.x is 0, and a factor must be over 0"),
        ({"body.arm.mass": "uniform(1, 2) * body.am.mass"}, "no factor 'body.am.mass'; nearest"),
        ({"body.arm.mass": "uniform(1, 2) + body.am.mass"}, "no summand 'body.am.mass'; nearest"),
        (
            {"geom.rod.rgb": "uniform(0, 1)", "geom.*.rgb.g": "uniform(0, 1)"},
            "geom.rod.rgb.g has a range already, that of geom.rod.rgb; give it one",
        ),
        ([3], r"randomise.scene is \[3\]; give"),
    ],
)
def test_mistakes_are_one_line(ranges: Any, says: str) -> None:
    with pytest.raises(EvsError, match=says) as error:
        SceneRanges(ranges, swing())
    assert "\n" not in str(error.value)


@pytest.mark.parametrize(("groups", "seen", "hidden"), [((4,), "rod", "0"), ((0,), "0", "rod")])
def test_what_is_shown_follows_the_view(groups: Any, seen: str, hidden: str) -> None:
    model = swing()
    model.geom_group[model.geom("rod").id] = 4
    visual = VisualConfig(geomgroup=groups)
    SceneRanges({f"geom.{seen}.rgb": "uniform(0, 1)"}, model, visual)
    with pytest.raises(EvsError, match=f"geom '{hidden}' has no rgb: it is not shown"):
        SceneRanges({f"geom.{hidden}.rgb": "uniform(0, 1)"}, model, visual)
    world = World(model, visual=visual)
    world.add_camera("left", sensor=SMALL)
    world.reset(scene={f"geom.{seen}.alpha": 0.5})
    with pytest.raises(EvsError, match="is not shown"):
        world.reset(scene={f"geom.{hidden}.alpha": 0.5})


def light(world: World, _: bytes) -> Any:
    return world.cameras[0].luminance.tobytes()


def place(world: World, _: bytes) -> Any:
    return world.data.qpos.tolist()


def start(world: World, _: bytes) -> Any:
    world.reset()
    return world.data.qpos.tolist(), world.data.qvel.tolist()


# values -> what they change: the light, the motion, or only the start of it
ACTS: dict[str, tuple[dict[str, float], Any]] = {
    "brightness": ({"light.lamp.brightness": 0.5}, light),
    "a light's colour": ({"light.lamp.diffuse.g": 0.1}, light),
    "a light's place": ({"light.lamp.pos.x": 1.0}, light),
    "a light's direction": ({"light.lamp.rotvec.y": 20.0}, light),
    "headlight": ({"headlight.brightness": 0.2}, light),
    "colour": ({"geom.rod.rgb.r": 0.1}, light),
    "see-through": ({"geom.rod.alpha": 0.4}, light),
    "fovy": ({"camera.left.fovy": 60.0}, light),
    "a camera's place": ({"camera.left.pos.z": 0.7}, light),
    "a camera's turn": ({"camera.left.rotvec.z": 10.0}, light),
    "mass": ({"body.arm.mass": 50.0}, place),
    "a body's place": ({"body.arm.pos.z": 1.0}, light),
    "a body's turn": ({"body.arm.rotvec.y": 30.0}, place),
    "damping": ({"joint.swing.damping": 50.0}, place),
    "frictionloss": ({"joint.swing.frictionloss": 5.0}, place),
    "armature": ({"joint.swing.armature": 5.0}, place),
    "stiffness": ({"joint.swing.stiffness": 90.0}, place),
    "strength": ({"actuator.0.strength": 9.0}, place),
    "gravity": ({"option.gravity.z": -1.6}, place),
    "qpos": ({"joint.swing.qpos": 0.5}, start),
    "qvel": ({"joint.swing.qvel": 2.0}, start),
}


@pytest.mark.parametrize("name", ACTS)
def test_each_value_changes_what_it_should_and_goes_again(name: str) -> None:
    values, seen = ACTS[name]
    world = world_of(swing())

    def look(scene: Mapping[str, float] | None) -> Any:
        world.reset(seed=3, scene=scene)
        for _ in range(20):
            world.step([1.0])
        return seen(world, b"")

    own = look({})
    changed = look(values)
    assert changed != own
    # it holds until others come
    assert look(None) == changed
    assert world.scene_values == values
    assert look({}) == own
    assert world.scene_values == {}
    # and is what a model gives that has it from the beginning
    model = load_model(swing())
    scene = evs.SceneValues(model)
    scene.put(values)
    world = world_of(model)
    if seen is not start:
        assert look(None) == changed


def test_friction_and_a_free_joints_start_act() -> None:
    model = mujoco.MjModel.from_xml_string("""
<mujoco><worldbody><light pos="0 0 3"/>
  <geom name="floor" type="plane" size="3 3 1"/>
  <body name="box" pos="0 0 .1"><freejoint name="free"/>
    <geom name="side" type="box" size=".1 .1 .1"/></body>
</worldbody></mujoco>""")
    world = World(model)
    ends = []
    for friction in (0.1, 1.5):
        values = {f"geom.{name}.friction": friction for name in ("floor", "side")}
        world.reset(scene={**values, "joint.free.vel.x": 1.0, "joint.free.pos.y": 0.5})
        assert world.data.qpos[1] == 0.5
        # seen before the first step too
        assert world.data.body("box").xpos[1] == 0.5
        for _ in range(100):
            world.step()
        ends.append(float(world.data.qpos[0]))
    assert ends[0] > 1.5 * ends[1] > 0.01


def test_recorded_values_give_the_same_events() -> None:
    record = SceneRanges(RANGES, swing()).draw(11, 2).record
    first, second = world_of(swing()), world_of(swing())
    first.reset(seed=4, scene=record["values"])
    expected = events_of(first)
    # whatever the other world was before, and in whatever order
    second.reset(seed=4, scene=drawn(1)[0])
    events_of(second, 3)
    second.reset(seed=4, scene=dict(reversed(record["values"].items())))
    assert events_of(second) == expected
    second.reset(seed=4, scene={})
    plain = world_of(swing())
    plain.reset(seed=4)
    assert events_of(second) == events_of(plain) != expected


def test_a_texture_is_chosen_by_name() -> None:
    model = mujoco.MjModel.from_xml_string(STAGE.replace("<mesh", DOTS + "<mesh", 1))
    ranges = SceneRanges({"material.tile.texture": "choice(tiles, dots)"}, model)
    numbers = {name: model.texture(name).id for name in ("tiles", "dots")}
    found = {ranges.draw(1, n).values["material.tile.texture"] for n in range(20)}
    assert found == {*numbers.values()}
    world = world_of(model, "eye")
    seen = {}
    for name, number in numbers.items():
        world.reset(scene={"material.tile.texture": number})
        world.step()
        seen[name] = light(world, b"")
    world.reset(scene={})
    world.step()
    assert light(world, b"") == seen["tiles"] != seen["dots"]
    with pytest.raises(EvsError, match=r"is 0; give one of 1 \(tiles\), "):
        world.reset(scene={"material.tile.texture": 0})
    for text, says in (
        ("choice(tiles, dot)", "no value 'dot'; there is: dots, tiles"),
        ("choice(tiles, hide)", "no value 'hide'"),
        ("uniform(0, 1)", "its values are names; give choice"),
        ("choice(tiles, dots) * nominal", "its values are names; give choice"),
    ):
        with pytest.raises(EvsError, match=says):
            SceneRanges({"material.tile.texture": text}, model)
    with pytest.raises(EvsError, match="material 'steel' has no texture: it has no image"):
        SceneRanges({"material.steel.texture": "choice(tiles)"}, model)


def test_a_bad_reset_changes_nothing() -> None:
    world, twin = world_of(swing()), world_of(swing())
    for one in (world, twin):
        one.reset(seed=4, scene=drawn(1)[0])
        events_of(one, 3)
    for scene, says in (
        ({"body.amr.mass": 1.0}, "scene.body.amr.mass: no body 'amr'"),
        ({"body.arm.mass": -1.0}, "scene.body.arm.mass is -1"),
        ("dark", "scene is 'dark'; give"),
    ):
        with pytest.raises(EvsError, match=says):
            world.reset(seed=9, scene=scene)  # type: ignore[arg-type]
        with pytest.raises(EvsError, match="346 x 260"):
            world.reset(seed=9, scene={}, sensor="davis346")
    assert world.save() == twin.save()
    assert events_of(world) == events_of(twin)


def reset_both(
    worlds: Worlds, alone: Alone, chosen: list[int], seeds: list[int], scenes: list[Any]
) -> None:
    worlds.reset(seeds, chosen, scene=scenes)
    for number, seed, scene in zip(chosen, seeds, scenes, strict=True):
        alone.each[number].reset(seed, scene=scene)
        alone.ended.pop(number, None)


@pytest.mark.parametrize("threads", [1, 3])
def test_worlds_have_the_bytes_of_single_worlds_whatever_they_drew(threads: int) -> None:
    cameras = [{"camera": "left", "sensor": NOISY}, {"camera": "right", "sensor": SMALL}]
    worlds, alone = both(swing(), 4, cameras, threads=threads, control="random")
    assert worlds.one_by_one == ""
    # before any of them has values
    step_both(worlds, alone, ticks=3)
    reset_both(worlds, alone, [1, 3], [7, 8], drawn(2))
    assert step_both(worlds, alone, ticks=4) > 0
    assert_same_states(worlds, alone)
    batch = worlds._batch
    reset_both(worlds, alone, [0, 1, 2, 3], [1, 2, 3, 4], drawn(4, seed=6))
    assert step_both(worlds, alone, ticks=[4, 2, 0, 5]) > 0
    reset_both(worlds, alone, [3, 0], [7, 8], [{}, drawn(1)[0]])
    step_both(worlds, alone, ticks=4)
    assert_same_states(worlds, alone)
    # nothing was built anew for those that were not reset
    assert worlds._batch is batch
    assert [worlds.world(n).scene_values for n in range(4)] == [
        world.scene_values for world in alone.each
    ]
    models = {id(worlds.world(n).model) for n in range(4)}
    assert len(models) == 4
    # edits of one model show in that world
    for world in (worlds.world(2), alone.each[2]):
        world.model.geom("rod").rgba[:] = (0.1, 0.9, 0.1, 1.0)
        world.model.opt.gravity[:] = (0.0, 0.0, 50.0)
    step_both(worlds, alone, ticks=4)
    assert_same_states(worlds, alone)


def test_one_scene_for_all_and_sensors_for_each() -> None:
    worlds, alone = both(swing(), 3, [{"camera": "left", "sensor": NOISY}], threads=2)
    sensors = [SensorConfig("dvs128", width=40, height=32, pos_thres=0.1 * n) for n in (2, 3, 4)]
    (scene,) = drawn(1)
    worlds.reset(9, sensor=sensors, scene=scene)
    for number, world in enumerate(alone.each):
        world.reset(worlds.seeds[number], sensor=sensors[number], scene=scene)
    assert step_both(worlds, alone, ticks=5) > 0
    assert_same_states(worlds, alone)
    assert len({id(worlds.world(n).model) for n in range(3)}) == 3
    before = worlds.save()
    for options, says in (
        ({"scene": drawn(2)}, "2 scenes for 3 worlds: give one for each"),
        ({"sensor": sensors[:1]}, "1 sensors for 3 worlds"),
        ({"scene": [{}, {}, {"body.x.mass": 1.0}]}, "scene.body.x.mass: no body 'x'"),
    ):
        with pytest.raises(EvsError, match=says):
            worlds.reset(3, **options)  # type: ignore[arg-type]
    assert worlds.save() == before


DOTS = """<texture name="dots" type="2d" builtin="flat" mark="random" random=".3" rgb1=".9 .8 .1"
  markrgb="0 0 0" width="16" height="16"/>"""
STAGED = {
    "light.*.brightness": "uniform(0.3, 1)",
    "material.*.rgb": "uniform(0.1, 1)",
    "geom.hill.rgb": "uniform(0.1, 1)",
    "geom.box.alpha": "uniform(0.4, 1)",
    "material.floor.reflectance": "uniform(0, 0.5)",
    "material.tile.texture": "choice(tiles, dots)",
    "joint.*.vel": "uniform(-1, 1)",
    "camera.eye.fovy": "uniform(40, 60)",
}
WAYS: dict[str, dict[str, Any]] = {
    "adaptive": {"render": RenderConfig(antialiasing="adaptive", fog=True, haze=True)},
    "path": {"render": RenderConfig(renderer="path", spp=1)},
    "hybrid": {"render": RenderConfig(renderer="hybrid", spp=1)},
    "one by one": {"render": RenderConfig(renderer="path", spp=1, seeds="fresh")},
    "free": {"camera": CameraConfig(distance=3.0)},
    "shaken": {"camera": CameraConfig(distance=3.0, shake_m=0.01, shake_hz=50.0)},
}


@pytest.mark.slow
@pytest.mark.parametrize("way", WAYS)
def test_worlds_with_meshes_and_textures_have_the_bytes_of_single_worlds(way: str) -> None:
    # a tendon cannot be stepped in a batch
    model = mujoco.MjModel.from_xml_string(
        STAGE[: STAGE.index("<tendon>")].replace("<mesh", DOTS + "<mesh", 1)
        + STAGE[STAGE.index("</tendon>") + 9 :]
    )
    camera = {"camera": "eye", "sensor": SMALL, **WAYS[way]}
    worlds, alone = both(model, 3, [camera], threads=2)
    ranges = SceneRanges(STAGED, model)
    scenes = [ranges.draw(2, episode).values for episode in range(3)]
    step_both(worlds, alone, ticks=2)
    reset_both(worlds, alone, [0, 2], [5, 6], scenes[:2])
    assert step_both(worlds, alone, ticks=12) > 0
    reset_both(worlds, alone, [0, 1, 2], [1, 2, 3], scenes)
    assert step_both(worlds, alone, ticks=12) > 0
    assert_same_states(worlds, alone)
    for number in range(3):
        (one,) = worlds.world(number).cameras
        # surfaces were made anew, meshes and textures were not, but for one that was not in use
        assert one.rebuilt["scenes"] >= 1
        assert one.rebuilt["meshes"] == 0
        assert one.rebuilt["textures"] <= one.rebuilt["scenes"]


@pytest.mark.parametrize(
    "control", ["zero", lambda _t_s, _data: [0.5]], ids=["together", "one by one"]
)
def test_each_world_measures_by_its_own_model(control: Any) -> None:
    text = SWING.replace(
        "</sensor>", '<framepos name="tip" objtype="site" objname="tip"/></sensor>'
    )
    model = mujoco.MjModel.from_xml_string(text)
    worlds = Worlds(model, 3, control=control, sensors=("tip",), limits={"tip": (-9, 9)}, threads=2)
    worlds.add_camera("left", sensor=SMALL)
    assert (worlds.one_by_one == "") == (control == "zero")

    def check() -> None:
        for number in range(3):
            world = worlds.world(number)
            named = NamedSensors(world.model, ["tip"])
            assert np.array_equal(worlds.readings["tip"][number], named.read(world.data)["tip"])

    scenes = [{"body.arm.pos.y": 0.1 * n, "joint.swing.qvel": 2.0} for n in range(3)]
    worlds.reset(1, scene=scenes)
    check()
    np.testing.assert_allclose(worlds.readings["tip"][:, 1], (0.0, 0.1, 0.2), atol=1e-12)
    worlds.step(ticks=5)
    check()
    np.testing.assert_allclose(worlds.readings["tip"][:, 1], (0.0, 0.1, 0.2), atol=1e-12)
    # a limit is left by the world whose values say so
    worlds.reset(2, [1], scene={"body.arm.pos.y": 30.0})
    assert {*worlds.ended} == {1}


def test_a_world_that_parts_leaves_the_others_as_they_are() -> None:
    # light that is remembered from tick to tick must not be found again
    camera = {"camera": "left", "sensor": SMALL, "render": RenderConfig("hybrid", spp=1)}
    worlds, alone = both(swing(), 3, [camera], threads=2)
    step_both(worlds, alone, [[1.0]] * 3, ticks=5)
    reset_both(worlds, alone, [0], [3], drawn(1))
    step_both(worlds, alone, ticks=5)
    assert_same_states(worlds, alone)
    assert worlds.world(1).model is worlds.world(2).model
    view = worlds.world(1).add_view("right", sensor=SMALL)
    before = view.render()[0]
    reset_both(worlds, alone, [1], [3], [{"geom.rod.rgb.r": 0.2}])
    worlds.reset(3, [1], scene={"geom.rod.rgb.r": 0.2, "joint.swing.qpos": 0.7})
    assert not np.array_equal(view.render()[0], before)


def test_a_saved_state_brings_its_values() -> None:
    worlds, alone = both(swing(), 3, [{"camera": "left", "sensor": NOISY}], threads=2)
    reset_both(worlds, alone, [0, 1, 2], [1, 2, 3], drawn(3))
    step_both(worlds, alone, ticks=3)
    blobs = worlds.save()
    expected = [raw(events) for events in worlds.step(ticks=5)[0]]
    # into each other, into a fresh world, and into fresh worlds
    worlds.restore([blobs[0]] * 2, [1, 2])
    assert worlds.world(2).scene_values == drawn(3)[0]
    assert by_world(worlds.step(ticks=5))[0][1:] == [expected[0]] * 2
    fresh = world_of(swing(), sensor=NOISY)
    fresh.restore(blobs[1])
    assert fresh.scene_values == drawn(3)[1]
    assert fresh.save() == blobs[1]
    assert events_of(fresh, 5) == expected[1]
    others = Worlds(swing(), 3)
    others.add_camera("left", sensor=NOISY)
    others.restore(blobs)
    assert by_world(others.step(ticks=5))[0] == expected
    # and a state without any takes them out again
    plain = world_of(swing(), sensor=NOISY)
    plain.step()
    fresh.restore(plain.save())
    assert fresh.scene_values == {}
    assert events_of(fresh, 5) == events_of(plain, 5)


def test_a_state_that_is_refused_leaves_the_values() -> None:
    world, twin = (world_of(swing()) for _ in range(2))
    for one in (world, twin):
        one.reset(scene=drawn(1)[0])
        events_of(one, 2)
    other = world_of(CART, "watch")
    other.reset(scene={"body.pole.mass": 0.5})
    with pytest.raises(EvsError, match="saved by another"):
        world.restore(other.save())
    # another camera: the values fit and the rest does not
    second = world_of(swing(), "right")
    second.reset(scene={"body.arm.mass": 0.5})
    with pytest.raises(EvsError, match="saved by another configuration"):
        world.restore(second.save())
    blob = world.save()
    with pytest.raises(EvsError, match="damaged"):
        world.restore(blob[:-9] + bytes([blob[-9] ^ 1]) + blob[-8:])
    assert world.save() == twin.save()
    assert events_of(world) == events_of(twin)


def test_a_loop_takes_values_and_saves_them() -> None:
    loop = ClosedLoop(swing(), "left", sensor=SMALL, threads=1)
    (values,) = drawn(1)
    loop.reset(seed=2, scene=values)
    loop.step([0.5], 3)
    blob = loop.save()
    expected = [raw(packet.events) for packet in loop.step([0.1], 4).packets]
    other = ClosedLoop(swing(), "left", sensor=SMALL, threads=1)
    other.restore(blob)
    assert other.world.scene_values == values
    assert [raw(packet.events) for packet in other.step([0.1], 4).packets] == expected


def test_an_event_camera_in_a_loop_of_ones_own() -> None:
    model = swing()
    data = mujoco.MjData(model)
    camera = evs.EventCamera(model, "left", sensor=SMALL, threads=1)
    scene = evs.SceneValues(model)
    seen = []
    for values in (drawn(1)[0], {}, drawn(1)[0]):
        scene.put(values)
        mujoco.mj_resetData(model, data)
        scene.start(data)
        camera.reset(seed=1)
        found = b""
        for _ in range(6):
            found += raw(camera.observe(data))
            mujoco.mj_step(model, data)
        seen.append(found)
    assert seen[0] == seen[2] != seen[1]


def test_worlds_with_values_are_dropped_at_once_and_grow_by_no_reset() -> None:
    def live() -> None:
        worlds = Worlds(swing(), 3, threads=2)
        worlds.add_camera("left", sensor=SMALL)
        worlds.reset(1, scene=drawn(3))
        worlds.step(ticks=2)
        worlds.restore(worlds.save())
        world = world_of(swing())
        world.reset(scene=drawn(1)[0])
        world.step()

    live()
    gc.collect()
    gc.disable()
    try:
        live()
        assert gc.collect() == 0
    finally:
        gc.enable()


@pytest.mark.parametrize("seed", [3, 4])
def test_a_twin_starts_with_the_values_of_its_world(seed: int) -> None:
    world, expected = (world_of(swing(), sensor=NOISY) for _ in range(2))
    (values,) = drawn(1)
    for one in (world, expected):
        one.reset(seed, scene=values)
        events_of(one, 4)
    twin = world.twin()
    twin.add_like(world.cameras[0])
    assert twin.scene_values == values
    expected.reset(seed)
    assert twin.data.qpos.tobytes() == expected.data.qpos.tobytes()
    assert twin.data.geom_xpos.tobytes() == expected.data.geom_xpos.tobytes()
    assert twin.save() == expected.save()
    assert events_of(twin) == events_of(expected)
    # and goes on alone with others
    twin.reset(seed, scene={})
    assert world.scene_values == values
    plain = world_of(swing(), sensor=NOISY)
    plain.reset(seed)
    assert events_of(twin) == events_of(plain)
