"""What groups and flags of mjvOption show and hide: mjvScene, and models without it, as oracles."""

from __future__ import annotations

import pickle
from collections.abc import Callable
from types import SimpleNamespace
from typing import Any

import mujoco
import numpy as np
import pytest

import evs
from evs.emulator import LeftOutWarning
from evs.emulator.base.scene import ObjectKind, SceneModel
from evs.emulator.world import SnapshotTaker, extract_scene, resolve_visual
from evs.msgs import EvsError

Flags = mujoco.mjtVisFlag

ALL_KINDS = """
<mujoco><visual><map alpha=".4"/></visual>
<asset><texture name="t" type="2d" builtin="checker" width="8" height="8"/>
<material name="m" texture="t"/></asset>
<worldbody><light pos="0 0 3"/>
<geom type="plane" size="3 3 .1"/><geom name="far" size=".1" pos="1 0 0" group="4"/>
<site name="still" group="1"/><site name="a" pos="0 1 1"/>
<body name="b" pos="0 0 1"><joint type="ball"/>
<geom type="box" size=".1 .1 .1" group="0" material="m"/><geom size=".1" group="1"/>
<geom size=".1" group="2" rgba="1 1 1 0"/><geom size=".1" group="3"/><geom size=".1" group="9"/>
<site name="moves" group="3"/><site name="e" pos="0 .2 0" group="5"/></body>
<body pos="0 0 2"><joint/><geom size=".05"/></body>
<flexcomp name="cloth" type="grid" count="3 3 1" spacing=".1 .1 .1" pos="0 0 3" dim="2"
 radius=".01"><edge equality="true"/></flexcomp>
<flexcomp name="rope" type="grid" count="4 1 1" spacing=".1 .1 .1" pos="0 1 3" dim="1"
 radius=".01"><edge equality="true"/></flexcomp></worldbody>
<tendon><spatial group="3" width=".01"><site site="a"/><site site="moves"/></spatial>
<spatial width=".01"><site site="a"/><site site="e"/></spatial></tendon>
<deformable><skin vertex="0 0 0 0 1 0 1 0 0" face="0 1 2" group="1">
<bone body="b" bindpos="0 0 0" bindquat="1 0 0 0" vertid="0 1 2" vertweight="1 1 1"/></skin>
</deformable></mujoco>"""

OPTIONS: dict[str, dict[str, Any]] = {
    "usual": {},
    "another group": {"geomgroup": (1, 3, 5)},
    "no geoms": {"geomgroup": ()},
    "sites": {"sitegroup": (3, 5)},
    "tendons": {"tendongroup": (3,)},
    "no tendons": {"tendon": False},
    "skins": {"skingroup": (0,)},
    "no skins": {"skin": False},
    "flexes": {"flexgroup": (1,)},
    "edges": {"flexskin": False},
    "no edges": {"flexedge": False},
    "faces": {"flexskin": False, "flexface": True},
    "what moves": {"static": False},
    "glass": {"transparent": True},
    "plain": {"texture": False},
}


def option_of(wanted: dict[str, Any]) -> mujoco.MjvOption:
    option = mujoco.MjvOption()
    for name, value in wanted.items():
        if name.endswith("group"):
            getattr(option, name)[:] = [group in value for group in range(6)]
        else:
            option.flags[getattr(Flags, f"mjVIS_{name.upper()}")] = value
    return option


def shown_by_mujoco(
    model: mujoco.MjModel, option: mujoco.MjvOption
) -> dict[tuple[str, int], tuple[float, bool]]:
    """(kind, id) of all that has a shape -> its alpha, and whether it has an image."""
    data, view = mujoco.MjData(model), mujoco.MjvScene(model, 1000)
    mujoco.mj_forward(model, data)
    every = mujoco.mjtCatBit.mjCAT_ALL
    mujoco.mjv_updateScene(model, data, option, None, mujoco.MjvCamera(), every, view)
    found = {}
    for geom in view.geoms[: view.ngeom]:
        kind = mujoco.mjtObj(geom.objtype).name.removeprefix("mjOBJ_")
        if kind == "FLEX" and not (
            view.flexfaceused[geom.objid]
            or (view.flexedgeopt and not (view.flexskinopt and view.flexfaceused[geom.objid]))
        ):
            continue
        if kind in ObjectKind.__members__:
            textured = geom.matid >= 0 and model.mat_texid[geom.matid].max() >= 0
            found[kind, geom.objid] = round(float(geom.rgba[3]), 5), bool(textured)
    return found


def shown_by_evs(
    model: mujoco.MjModel, scene: SceneModel
) -> dict[tuple[str, int], tuple[float, bool]]:
    first = {
        ObjectKind.GEOM: 0,
        ObjectKind.SKIN: -2,
        ObjectKind.FLEX: -2 - model.nskin,
        ObjectKind.ROPE: -2 - model.nskin,
        ObjectKind.SITE: -2 - model.nskin - model.nflex,
        ObjectKind.TENDON: -2 - model.nskin - model.nflex - model.nsite,
    }
    found = {}
    for kind, number, row in zip(
        scene.geom_kind.tolist(), scene.geom_id.tolist(), scene.geom_surface, strict=True
    ):
        surface, what = scene.surfaces[row], ObjectKind(kind)
        name = "FLEX" if what == ObjectKind.ROPE else what.name
        index = number if what == ObjectKind.GEOM else first[what] - number
        found[name, index] = round(surface.rgba[3], 5), surface.texture >= 0
    return found


@pytest.mark.parametrize("name", OPTIONS)
def test_what_is_shown_is_what_mujocos_scene_has(name: str) -> None:
    model, option = mujoco.MjModel.from_xml_string(ALL_KINDS), option_of(OPTIONS[name])
    visual = resolve_visual(option)
    assert visual == evs.VisualConfig(**OPTIONS[name])
    scene = extract_scene(model, visual=visual)
    shown = shown_by_mujoco(model, option)
    assert shown_by_evs(model, scene) == shown
    assert len(shown) > 3
    # rows of snapshots are those of the scene, and edges and faces are where MuJoCo has them
    snapshot = SnapshotTaker(model, visual=visual).snapshot(mujoco.MjData(model), 0)
    assert len(snapshot.geom_pos) == len(scene.geom_id)
    assert len(snapshot.deformed) == len(scene.deforming)
    assert len(snapshot.stretched) == len(scene.stretching)


TWO_GROUPS = """
<mujoco><worldbody><light pos="1 -1 4" dir="-.2 .2 -1"/>
<geom type="plane" size="2 2 .1"/><geom size=".2" pos=".5 .5 .2" group="1" rgba=".2 .3 .8 1"/>
<body name="arm" pos="0 0 .8"><inertial pos="0 0 0" mass="1" diaginertia="1 1 1"/>
<joint name="turn" axis="0 0 1"/>{hidden}
<geom type="box" size=".3 .1 .1" group="1" rgba=".9 .4 .1 1"/></body>
<camera name="eye" pos="0 -2 1.5" xyaxes="1 0 0 0 .6 .8"/></worldbody>
<actuator><motor joint="turn" ctrlrange="-1 1"/></actuator></mujoco>"""
HIDDEN = """<geom name="cover" type="box" size=".35 .2 .2" rgba="0 .8 0 1" group="0"/>
<geom name="above" size=".3" pos=".6 0 .5" rgba="0 0 .8 1"/>"""
# the floor is in group 2
TWO_GROUPS = TWO_GROUPS.replace('type="plane"', 'type="plane" group="2"')


def sensor(width: int = 24, height: int = 20) -> evs.SensorConfig:
    return evs.SensorConfig("ideal", width=width, height=height)


def pictures(model: mujoco.MjModel, renderer: str, **options: Any) -> list[Any]:
    """Light and truth at some angles of the arm, and the events between them."""
    data, found = mujoco.MjData(model), []
    render = evs.RenderConfig(renderer=renderer, spp=1 if renderer == "hybrid" else 4)
    camera = evs.EventCamera(model, "eye", sensor=sensor(), render=render, threads=1, **options)
    for k in range(4):
        data.time, data.qpos[0] = 1e-3 * k, 0.2 * k
        events, truth = camera.observe(data), camera.ground_truth()
        found += [camera.luminance, events, truth.depth, truth.normal, truth.flow]
    return found


@pytest.mark.parametrize(
    "renderer", ["direct", "hybrid", "path", pytest.param("raster", marks=pytest.mark.slow)]
)
def test_what_is_hidden_is_as_if_it_were_not_there(renderer: str) -> None:
    whole = mujoco.MjModel.from_xml_string(TWO_GROUPS.format(hidden=HIDDEN))
    without = mujoco.MjModel.from_xml_string(TWO_GROUPS.format(hidden=""))
    option = option_of({"geomgroup": (1, 2)})
    seen = pictures(whole, renderer, visual=option)
    expected = pictures(without, renderer)
    for one, other in zip(seen, expected, strict=True):
        assert one.tobytes() == other.tobytes()
    covered = pictures(whole, renderer)
    assert not np.array_equal(covered[0], seen[0])


SIGHTS: dict[str, Callable[[mujoco.MjModel, Any], Any]] = {
    "World": lambda model, visual: evs.World(model, visual=visual).add_view("eye", sensor=sensor()),
    "SceneConfig": lambda model, visual: evs.World(
        evs.SceneConfig(file=model, visual=resolve_visual(visual))  # type: ignore[arg-type]
    ).add_view("eye", sensor=sensor()),
    "twin": lambda model, visual: (
        evs.World(model, visual=visual).twin().add_view("eye", sensor=sensor())
    ),
    "ClosedLoop": lambda model, visual: stepped(
        evs.ClosedLoop(model, "eye", sensor=sensor(), visual=visual).world
    ),
    "Worlds": lambda model, visual: many(evs.Worlds(model, 2, visual=visual)),
    "LoopEnv": lambda model, visual: stepped(loop_env(model, visual).loop.world),
    "make_vec": lambda model, visual: many(
        evs.make_vec(model, 2, cameras="eye", sensor=sensor(), size=None, visual=visual).worlds
    ),
    "SimulatedDataset": lambda model, visual: sample(
        evs.SimulatedDataset(
            model, "eye", samples=1, ticks=1, sensor=sensor(), truth=["geom_id"], visual=visual
        )
    ),
}


def sample(dataset: evs.SimulatedDataset) -> Any:
    """What a worker of a loader would simulate."""
    geom_id = pickle.loads(pickle.dumps(dataset))[0]["geom_id"]
    return SimpleNamespace(ground_truth=lambda: SimpleNamespace(geom_id=geom_id))


def stepped(world: evs.World) -> Any:
    world.step()
    return world.cameras[0]


def many(worlds: Any) -> Any:
    if not worlds.cameras:
        worlds.add_camera("eye", sensor=sensor())
    worlds.step()
    return worlds._worlds[1].cameras[0]


def loop_env(model: Any, visual: Any) -> Any:
    from evs.drivers.gym.loop_env import LoopEnv

    return LoopEnv(model, "eye", sensor=sensor(), size=None, visual=visual)


@pytest.mark.parametrize("name", SIGHTS)
def test_everything_that_sees_takes_an_option(name: str, tmp_path: Any) -> None:
    model: Any = mujoco.MjModel.from_xml_string(TWO_GROUPS.format(hidden=HIDDEN))
    if name == "SceneConfig":
        path = tmp_path / "scene.xml"
        path.write_text(TWO_GROUPS.format(hidden=HIDDEN))
        model = str(path)
    sight = SIGHTS[name](model, option_of({"geomgroup": (1, 2)}))
    ids = set(sight.ground_truth().geom_id.ravel().tolist())
    # the floor, the ball and the arm; neither `cover` nor `above`
    assert ids == {-1, 0, 1, 4}


@pytest.mark.parametrize(
    ("visual", "says"),
    [
        (evs.VisualConfig(geomgroup=(7,)), r"scene.visual.geomgroup is \(7,\): groups are 0"),
        (evs.VisualConfig(sitegroup=("a",)), r"scene.visual.sitegroup.0 is 'a'"),  # type: ignore[arg-type]
        (3, r"visual= takes a mujoco.MjvOption or an evs.VisualConfig, not builtins.int"),
        (
            evs.VisualConfig(geomgroup=(5,)),
            r"in groups 5 with alpha above 0.*3 in group 0 \(0, 3, 7\).*\(scene.visual\)",
        ),
    ],
)
def test_what_cannot_be_is_refused(visual: Any, says: str) -> None:
    xml = "<mujoco><worldbody>{}<geom size='1' group='2'/></worldbody></mujoco>"
    bare = "<geom size='1'/>" * 3
    model = mujoco.MjModel.from_xml_string(xml.format(bare))
    with pytest.raises(EvsError, match=says.replace("0, 3, 7", "0, 1, 2")) as error:
        evs.EventCamera(model, visual=visual)
    assert "\n" not in str(error.value)


def test_marks_of_a_viewer_are_named_when_they_are_left_out() -> None:
    option = mujoco.MjvOption()
    option.flags[Flags.mjVIS_CONTACTPOINT] = option.flags[Flags.mjVIS_JOINT] = 1
    with pytest.warns(LeftOutWarning, match="mjVIS_JOINT, mjVIS_CONTACTPOINT of the mjvOption"):
        resolve_visual(option)


def test_saved_states_belong_to_what_is_seen() -> None:
    model = mujoco.MjModel.from_xml_string(TWO_GROUPS.format(hidden=HIDDEN))

    def camera(**options: Any) -> evs.EventCamera:
        return evs.EventCamera(model, "eye", sensor=sensor(), threads=1, **options)

    data, hiding = mujoco.MjData(model), {"visual": option_of({"geomgroup": (1, 2)})}
    first = camera(**hiding)
    first.observe(data)
    saved = first.save()
    camera(**hiding).restore(saved)
    with pytest.raises(EvsError, match="another"):
        camera().restore(saved)
