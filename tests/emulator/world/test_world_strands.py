"""Sites, tendons, ropes and slider-cranks lie where MuJoCo's visualiser has them."""

from __future__ import annotations

import re
from dataclasses import replace

import mujoco
import numpy as np
import pytest

from evs.emulator import _core
from evs.emulator.base.scene import ObjectKind, SceneModel, SceneSnapshot
from evs.emulator.camera.scene_plan import contents_of
from evs.emulator.config import CameraConfig, RenderConfig
from evs.emulator.render import NativeRenderer
from evs.emulator.world import SnapshotTaker, bind_camera, extract_scene, load_model
from evs.emulator.world.tendons import catenary

# a wrapped cylinder with its side site, a sphere, a pulley, a hidden group, a fixed tendon, strings
MARKS = """
<mujoco>
  <option timestep=".002"/>
  <visual><quality numslices="12"/></visual>
  <asset><material name="m" rgba=".2 .8 .3 1" specular=".25" emission=".3"/></asset>
  <default><site size=".02"/></default>
  <worldbody>
    <light type="directional" dir=".2 .3 -1"/>
    <geom type="plane" size="2 2 .1"/>
    <site name="s0" pos="-.3 0 1.2" type="box" size=".02 .03 .04" material="m"/>
    <site name="s1" pos=".3 0 1.2" type="ellipsoid" size=".02 .03 .04" rgba="1 0 0 .5"/>
    <site name="hidden" pos=".3 .2 1.2" group="3"/>
    <site name="slider" pos="-.9 .1 .8" zaxis="1 .2 -.1" group="3"/>
    <body pos="-.7 .1 .8"><joint axis="0 1 0"/><geom size=".02"/>
      <site name="crank" pos=".1 0 .05" group="3"/></body>
    <site name="clear" pos=".3 .2 1.2" rgba="1 1 1 0"/>
    <geom name="roll" type="cylinder" size=".1 .05" pos="0 0 1.2" euler="90 0 0"/>
    <site name="side" pos="0 0 1.4" type="capsule" size=".01 .03"/>
    <geom name="ball" type="sphere" size=".12" pos="0 .5 1"/>
    <site name="s2" pos="-.4 .5 1.1"/>
    <site name="s3" pos="-.4 -.5 1.1" type="cylinder" size=".01 .03"/>
    <body name="a" pos="-.3 0 .6"><freejoint/><geom size=".05"/>
      <site name="a" pos=".02 0 .05"/></body>
    <body name="b" pos=".3 0 .6"><joint name="j" type="slide" axis="0 0 1"/><geom size=".05"/>
      <site name="b"/></body>
    <body name="c" pos=".4 .5 1.1"><freejoint/><geom size=".05"/><site name="c"/></body>
    <body name="d" pos=".2 -.5 1.1"><freejoint/><geom size=".05"/><site name="d"/></body>
    <flexcomp name="rope" type="grid" count="5 1 1" spacing=".1 .1 .1" radius=".01" dim="1"
      pos="-.7 0 .5" mass="1" rgba=".9 .3 .2 1"><edge equality="true"/></flexcomp>
    <flexcomp name="cloth" type="grid" count="3 3 1" spacing=".08 .08 .08" radius=".01" dim="2"
      pos="0 0 .3" mass="1"><edge equality="true"/></flexcomp>
  </worldbody>
  <actuator>
    <general name="crank" cranksite="crank" slidersite="slider" cranklength=".2"/>
    <general name="short" cranksite="a" slidersite="slider" cranklength=".2"/>
  </actuator>
  <tendon>
    <spatial name="around" width=".01" rgba="1 .2 .2 1">
      <site site="a"/><site site="s0"/><geom geom="roll" sidesite="side"/><site site="s1"/>
      <site site="b"/>
    </spatial>
    <spatial name="unseen" group="4"><site site="a"/><geom geom="roll"/><site site="b"/></spatial>
    <fixed name="fixed"><joint joint="j" coef="2"/></fixed>
    <spatial name="over" width=".008" material="m">
      <site site="s2"/><geom geom="ball"/><site site="c"/>
    </spatial>
    <spatial name="split" width=".006">
      <site site="s0"/><site site="b"/><pulley divisor="2"/><site site="b"/><site site="s1"/>
      <pulley divisor="2"/><site site="s2"/><geom geom="ball"/><site site="c"/>
    </spatial>
    <spatial name="string" width=".005" range="0 .9" limited="true">
      <site site="s3"/><site site="d"/></spatial>
    <spatial name="elastic" width=".005" stiffness="3" springlength="0 1.3">
      <site site="s2"/><site site="d"/></spatial>
  </tendon>
</mujoco>
"""
VIEW = CameraConfig(lookat=(0, 0, 0.8), distance=2.2, azimuth=110, elevation=-15)
MARKED = (mujoco.mjtObj.mjOBJ_SITE, mujoco.mjtObj.mjOBJ_TENDON, mujoco.mjtObj.mjOBJ_ACTUATOR)


@pytest.fixture(scope="module")
def marks() -> mujoco.MjModel:
    return mujoco.MjModel.from_xml_string(MARKS)


def of_mujoco(model, data) -> tuple[list, ...]:
    """Sites, tendons and slider-cranks in MuJoCo's abstract scene with default options."""
    view, camera = mujoco.MjvScene(model, 5000), mujoco.MjvCamera()
    every = mujoco.mjtCatBit.mjCAT_ALL
    mujoco.mjv_updateScene(model, data, mujoco.MjvOption(), None, camera, every, view)
    shown = view.geoms[: view.ngeom]
    return tuple([g for g in shown if g.objtype == kind] for kind in MARKED)


def ends_of(pos, mat, half) -> np.ndarray:
    """(n, 2, 3) where the axes of capsules begin and end."""
    reach = np.asarray(half)[:, None] * np.asarray(mat).reshape(-1, 9)[:, 2::3]
    return np.stack([pos - reach, pos + reach], 1)


def distance_to(chain: np.ndarray, point: np.ndarray) -> float:
    """m from a point to the nearest of segments (n, 2, 3)."""
    start, span = chain[:, 0], chain[:, 1] - chain[:, 0]
    square = np.maximum((span**2).sum(1), 1e-30)
    share = np.clip(((point - start) * span).sum(1) / square, 0, 1)
    return float(np.linalg.norm(start + share[:, None] * span - point, axis=1).min())


def check_chain(model, tendon, theirs, snapshot, rows, sizes) -> None:
    """Arcs and strings in other pieces than MuJoCo's: the same line as far as these tell."""
    theirs_at = ends_of(
        np.array([g.pos for g in theirs]),
        np.array([g.mat.ravel() for g in theirs]),
        [g.size[2] for g in theirs],
    )
    ours = ends_of(snapshot.geom_pos[rows], snapshot.geom_mat[rows], sizes[rows, 1])
    np.testing.assert_allclose(sizes[rows, 0], model.tendon_width[tendon], rtol=1e-6)
    wraps = model.wrap_objid[model.wrap_type >= int(mujoco.mjtWrap.mjWRAP_SPHERE)]
    largest = max([0.0, *model.geom_size[wraps, 0]])
    if int(mujoco.__version__.split(".")[0]) < 4:
        # a chord instead of the arc
        theirs_at = theirs_at[[g.size[0] > 0.75 * model.tendon_width[tendon] for g in theirs]]
    for corner in theirs_at.reshape(-1, 3):
        # pieces of at most pi / 16 run so far inside
        assert distance_to(ours, corner) < 2e-5 + 0.005 * largest
    np.testing.assert_allclose(ours[[0, -1], [0, 1]], theirs_at[[0, -1], [0, 1]], atol=1e-5)


def check_marks(model, data, scene: SceneModel, snapshot: SceneSnapshot) -> None:
    """The same shapes, places, sizes, colours and ids as MuJoCo's."""
    sites, tendons, cranks = of_mujoco(model, data)
    first = -2 - model.nskin - model.nflex
    sizes = scene.geom_size.copy()
    sizes[scene.stretching] = snapshot.stretched
    rows = np.flatnonzero(scene.geom_kind == ObjectKind.SITE)
    assert [first - g.objid for g in sites] == scene.geom_id[rows].tolist()
    pairs = list(zip(rows, sites, strict=True))
    # what has no radius is not there
    rows = np.flatnonzero((scene.geom_kind == ObjectKind.TENDON) & (sizes[:, 0] > 0))
    ids = first - model.nsite - scene.geom_id[rows]
    assert set(ids.tolist()) == {g.objid for g in tendons}
    for tendon in set(ids.tolist()):
        theirs, ours = [g for g in tendons if g.objid == tendon], rows[ids == tendon]
        if len(theirs) == len(ours):
            pairs += zip(ours, theirs, strict=True)
        else:
            check_chain(model, tendon, theirs, snapshot, ours, sizes)
    rows = np.flatnonzero((scene.geom_kind == ObjectKind.CRANK) & (sizes[:, 0] > 0))
    last = first - model.nsite - model.ntendon
    assert [last - g.objid for g in cranks] == scene.geom_id[rows].tolist()
    pairs += zip(rows, cranks, strict=True)
    for row, theirs in pairs:
        surface = scene.surfaces[scene.geom_surface[row]]
        assert scene.geom_type[row] == theirs.type
        assert surface.rgba == pytest.approx(tuple(theirs.rgba))
        ours = surface.emission, surface.specular, surface.shininess
        assert ours == (theirs.emission, theirs.specular, theirs.shininess)
        size = sizes[row].tolist()
        if theirs.type == mujoco.mjtGeom.mjGEOM_SPHERE:
            size = [size[0]] * 3
        elif theirs.type in (mujoco.mjtGeom.mjGEOM_CAPSULE, mujoco.mjtGeom.mjGEOM_CYLINDER):
            size = [size[0], size[0], size[1]]
        np.testing.assert_allclose(size, theirs.size, atol=1e-5)
        np.testing.assert_allclose(snapshot.geom_pos[row], theirs.pos, atol=1e-5)
        mat = snapshot.geom_mat[row].reshape(3, 3)
        np.testing.assert_allclose(mat @ mat.T, np.eye(3), atol=1e-12)
        if theirs.size[2] > 1e-4:
            # 32-bit ends over a length
            np.testing.assert_allclose(mat, theirs.mat, atol=1e-6 / theirs.size[2])


@pytest.mark.slow
def test_sites_and_tendons_are_mujocos_at_every_instant(marks) -> None:
    data, scene = mujoco.MjData(marks), extract_scene(marks)
    poser, wrapped = SnapshotTaker(marks), set()
    for _ in range(60):
        for _ in range(10):
            mujoco.mj_step(marks, data)
        snapshot = poser.snapshot(data, 0)
        mujoco.mj_fwdPosition(marks, data)
        check_marks(marks, data, scene, snapshot)
        wrapped.add(tuple((snapshot.stretched[:, 0] > 0).tolist()))
    # the test has seen tendons wrap and let go, or a crank that does not reach
    assert len(wrapped) > 1


@pytest.mark.slow
def test_of_every_shipped_robot_too(robot_files) -> None:
    counts = np.zeros(2, int)
    for path in robot_files.values():
        model = load_model(path)
        data, scene = mujoco.MjData(model), extract_scene(model)
        mujoco.mj_forward(model, data)
        check_marks(model, data, scene, SnapshotTaker(model).snapshot(data, 0))
        things = scene.geom_kind
        counts += [(things == ObjectKind.SITE).sum(), (things == ObjectKind.TENDON).sum()]
    assert (counts >= (5, 20)).all()


def test_a_rope_is_its_edges(marks) -> None:
    data, scene = mujoco.MjData(marks), extract_scene(marks)
    for _ in range(200):
        mujoco.mj_step(marks, data)
    snapshot = SnapshotTaker(marks).snapshot(data, 0)
    mujoco.mj_fwdPosition(marks, data)
    rows = np.flatnonzero(scene.geom_kind == ObjectKind.ROPE)
    assert scene.geom_id[rows].tolist() == [-2] * 4
    assert (scene.geom_id[scene.geom_kind == ObjectKind.FLEX] == -3).all()
    assert (scene.geom_body[rows] == -1).all()
    assert scene.surfaces[scene.geom_surface[rows[0]]].rgba == pytest.approx((0.9, 0.3, 0.2, 1))
    corners = data.flexvert_xpos[marks.flex_edge[:4]]
    sizes = snapshot.stretched[np.searchsorted(scene.stretching, rows)]
    np.testing.assert_allclose(sizes[:, 0], 0.01, rtol=1e-6)
    reach = sizes[:, 1, np.newaxis] * snapshot.geom_mat[rows, 2::3]
    for side, corner in ((-1, corners[:, 0]), (1, corners[:, 1])):
        np.testing.assert_allclose(snapshot.geom_pos[rows] + side * reach, corner, atol=1e-7)


@pytest.mark.parametrize(
    "end", [(0.5, 0, 0), (0.3, 0.4, -0.5), (1e-4, 0, 0.2), (0, 0, -0.2), (0.9, 0, 0)]
)
@pytest.mark.parametrize("length", [0.9000001, 1.0, 3.0])
def test_a_string_has_its_length_and_hangs_as_a_chain_does(end, length) -> None:
    points = catenary(np.zeros(3), np.array(end, float), np.array([0, 0, -9.81]), length, 400)
    np.testing.assert_allclose(points[[0, -1]], [np.zeros(3), end], atol=1e-15)
    parts = np.linalg.norm(np.diff(points, axis=0), axis=1)
    assert parts.sum() == pytest.approx(max(length, np.linalg.norm(end)), rel=2e-3)
    # no force sideways: what the ends pull along the span is the same everywhere
    assert (np.diff(points[1:-1, 2], 2) > -1e-9).all()


@pytest.mark.parametrize("renderer", ["direct", "path"])
def test_what_stretches_is_traced_again_and_all_machines_agree(marks, renderer) -> None:
    data, bound = mujoco.MjData(marks), bind_camera(marks, "", 64, 48, VIEW)
    poser, scene = SnapshotTaker(marks, [bound]), extract_scene(marks)
    once = RenderConfig(renderer, spp=1)
    full = NativeRenderer(scene, bound.model, replace(once, incremental=False), 1)
    others = [
        NativeRenderer(scene, bound.model, replace(once, isa=isa), 2)
        for isa in _core.isa_available()
    ]
    first, least = None, 1.0
    for _ in range(60):
        for _ in range(10):
            mujoco.mj_step(marks, data)
        frame = poser.snapshot(data, 0)
        light = full.render(frame, frame.cameras[0]).copy()
        for other in others:
            np.testing.assert_array_equal(other.render(frame, frame.cameras[0]), light)
        least = min(least, others[0].traced_fraction)
        first = light if first is None else first
    assert np.mean(first != light) > 0.05
    assert least < 0.9


def test_a_geom_takes_a_new_size_only_if_it_has_one(marks) -> None:
    bound = bind_camera(marks, "", 8, 6, VIEW)
    caster = NativeRenderer(extract_scene(marks), bound.model, RenderConfig(spp=1), 1)._caster
    size = np.ones((1, 3), np.float32)
    for geom in (-1, 999):
        with pytest.raises(ValueError, match="does not exist"):
            caster.resize(np.array([geom], np.int32), size)
    with pytest.raises(ValueError, match="only shapes"):
        caster.resize(np.array([0], np.int32), size)
    with pytest.raises(ValueError, match="one size"):
        caster.resize(np.array([0, 1], np.int32), size)


def test_one_key_hides_the_sites_and_the_plan_counts_them(marks) -> None:
    bare = mujoco.MjModel.from_xml_string(re.sub(r"<actuator>.*</tendon>", "", MARKS, flags=re.S))
    none = mujoco.MjModel.from_xml_string(
        re.sub(r"<actuator>.*</tendon>|<site [^>]*name=[^>]*>", "", MARKS, flags=re.S)
    )
    bound = bind_camera(bare, "", 64, 48, VIEW)
    lights = {}
    for name, model, sites in (("shown", bare, True), ("off", bare, False), ("none", none, True)):
        scene, config = extract_scene(model), RenderConfig(spp=1, sites=sites)
        snapshot = SnapshotTaker(model, [bound]).snapshot(mujoco.MjData(model), 0)
        renderer = NativeRenderer(scene, bound.model, config, 1)
        lights[name] = renderer.render(snapshot, snapshot.cameras[0]).copy()
        truth = renderer.ground_truth(snapshot, snapshot.cameras[0])
        seen = truth.geom_id < -2 - model.nskin - model.nflex + 1
        assert seen.any() == (name == "shown")
        has = contents_of(scene, config)
        assert has.sites == (9 if name == "shown" else 0)
        assert has.transparent == (name == "shown")
        assert (has.ropes, has.tendons, has.rods) == (1, 0, 4)
    np.testing.assert_array_equal(lights["off"], lights["none"])
    assert (lights["shown"] != lights["off"]).any()
    has = contents_of(extract_scene(marks), RenderConfig())
    # of seven tendons one is in a hidden group and one is fixed
    assert (has.sites, has.tendons, has.ropes) == (9, 5, 1)
    assert "capsule" not in has.geoms


def test_what_stretches_moves_with_its_ends() -> None:
    model = mujoco.MjModel.from_xml_string("""
    <mujoco><worldbody>
      <site name="hook" pos="-.5 0 1" group="3"/>
      <body pos="0 0 1"><joint name="x" type="slide" axis="1 0 0"/>
        <joint name="z" type="slide" axis="0 0 1"/>
        <geom size=".05"/><site name="end" pos="-.3 0 0" group="3"/></body>
    </worldbody><tendon>
      <spatial width=".02"><site site="hook"/><site site="end"/></spatial>
    </tendon></mujoco>""")
    view = CameraConfig(lookat=(-0.3, 0, 1), distance=0.9, azimuth=90, elevation=0)
    bound, data = bind_camera(model, "", 80, 60, view), mujoco.MjData(model)
    scene, poser = extract_scene(model), SnapshotTaker(model, [bound])
    before = poser.snapshot(data, 0)
    data.qpos[:] = 1e-3, 2e-3
    now = poser.snapshot(data, 1000)
    renderer = NativeRenderer(scene, bound.model, RenderConfig(spp=1), 1)
    truth = renderer.ground_truth(now, now.cameras[0], (before, before.cameras[0]))
    tendon = truth.geom_id == -2 - model.nsite
    assert tendon.sum() > 50
    assert (truth.body_id[tendon] == -1).all()
    # as far along as it is, so much of the end's way; px/s at its depth
    share = (truth.position[tendon][:, 0] + 0.5) / 0.201
    inside = (share > 0) & (share < 1)
    scale = bound.model.fx / truth.depth[tendon] / 1e-3
    right, down = 1e-3 * share * scale, -2e-3 * share * scale
    flow = truth.flow[tendon]
    # of the turn, 0.01 rad, the capsule's surface has 2e-2 m * 1e-2 more
    np.testing.assert_allclose(flow[inside, 0], right[inside], atol=2.5e-4 * scale.max())
    np.testing.assert_allclose(flow[inside, 1], down[inside], atol=2.5e-4 * scale.max())
    assert np.abs(flow[inside, 1]).max() > 0.8 * 2e-3 * scale.min()
