"""The `hybrid` renderer: soft light whose slow part is cached on surfaces.

Its reference is `path`: the same light, converged. What it promises of time is tested by bytes.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace
from functools import partial

import mujoco
import numpy as np
import pytest

from evs.emulator import World, _core
from evs.emulator.base.features import Switches
from evs.emulator.base.scene import CameraPose
from evs.emulator.config import CameraConfig, RenderConfig
from evs.emulator.render import NativeRenderer, make_renderer
from evs.emulator.world import SnapshotTaker, bind_camera, extract_scene
from evs.msgs import EvsError
from reference import path_stages
from reference.ball_room import ball_room
from reference.random_scenes import RandomStage, check_film
from reference.stage import Stage

SLOW = pytest.mark.slow
HYBRID = RenderConfig(renderer="hybrid", spp=2, antialiasing="fixed")
RENEWAL, QUARTERS = 16, 4
DROPPED = 2 * RENEWAL * QUARTERS
REST = 3 * RENEWAL * QUARTERS


def renderer_of(
    stage: RandomStage | Stage, threads: int = 1, rgb: bool = False, **render: object
) -> NativeRenderer:
    own = stage.render if isinstance(stage, RandomStage) else {"sky": stage.render.sky}
    config = replace(HYBRID, **{**own, **render})  # type: ignore[arg-type]
    made = make_renderer(stage.scene, stage.camera, config, threads, rgb=rgb)
    assert isinstance(made, NativeRenderer)
    return made


def film_of(stage: RandomStage, ticks: int, moves: float = 0.02) -> list:
    """Instants at which the geoms and the camera have moved."""
    frames = []
    pos = stage.pose.pos.copy()
    for tick in range(ticks):
        frames.append((stage.snapshot(1000 * tick), CameraPose(pos.copy(), stage.pose.mat)))
        stage.geom_pos += stage.rng.normal(size=stage.geom_pos.shape) * moves
        pos += stage.rng.normal(size=3) * moves
    return frames


@pytest.mark.parametrize("antialiasing", ["fixed", "adaptive"])
@pytest.mark.parametrize("seed", [4, *(pytest.param(k, marks=SLOW) for k in (0, 1, 2, 3, 5))])
def test_threads_and_instruction_sets_change_no_byte(seed: int, antialiasing: str) -> None:
    film = film_of(RandomStage(seed, rich=True, size=(39, 27)), 5)
    lights = []
    for threads, isa in [(3, "auto"), *((1, isa) for isa in _core.isa_available())]:
        stage = RandomStage(seed, rich=True, size=(39, 27))
        one = renderer_of(stage, threads, isa=isa, antialiasing=antialiasing)
        lights.append([one.render(*instant).tobytes() for instant in film])
    assert all(light == lights[0] for light in lights[1:])


@pytest.mark.parametrize("antialiasing", ["fixed", "adaptive"])
@pytest.mark.parametrize("seed", [0, 1, *(pytest.param(k, marks=SLOW) for k in (2, 3))])
def test_colour_leaves_the_luminance_as_it_is(seed: int, antialiasing: str) -> None:
    stage = RandomStage(seed, size=(39, 27))
    film = film_of(stage, 3)
    grey = renderer_of(stage, antialiasing=antialiasing)
    colour = renderer_of(stage, rgb=True, antialiasing=antialiasing)
    for instant in film:
        np.testing.assert_array_equal(grey.render(*instant), colour.render(*instant))
        assert colour.rgb is not None
        # grey light on coloured textures takes their mean colour for the luminance
        np.testing.assert_allclose(
            colour.rgb @ [0.2126, 0.7152, 0.0722], colour._device.luminance, rtol=0.15, atol=0.02
        )


def test_single_pixels_are_those_of_the_picture() -> None:
    stage = RandomStage(3, size=(23, 17))
    film = film_of(stage, 4)
    whole, single = renderer_of(stage), renderer_of(stage)
    pixels = np.array([[0, 0], [22, 16], [7, 3]], np.int32)
    for instant in film:
        expected = whole.render(*instant)[pixels[:, 1], pixels[:, 0]]
        np.testing.assert_array_equal(single.trace(*instant, pixels), expected)


@pytest.mark.slow
@pytest.mark.parametrize("antialiasing", ["fixed", "adaptive"])
def test_a_scene_at_rest_keeps_every_byte_and_then_traces_nothing(antialiasing: str) -> None:
    stage = RandomStage(4, rich=True, size=(39, 27))
    kept = renderer_of(stage, antialiasing=antialiasing)
    full = renderer_of(stage, antialiasing=antialiasing, incremental=False)
    instant = film_of(stage, 1)[0]
    first = full.render(*instant).copy()
    for tick in range(REST + 4):
        np.testing.assert_array_equal(kept.render(*instant), first)
        np.testing.assert_array_equal(full.render(*instant), first)
        assert kept.traced_fraction == (1 if tick <= REST else 0)
        assert full.traced_fraction == 1


SKY_VIEW = """<mujoco><asset><texture name="sky" type="skybox" builtin="gradient" rgb1=".6 .7 .9"
    rgb2=".1 .1 .2" width="8" height="8"/></asset><worldbody><geom type="plane" size="2 2 1"/>
    <body mocap="true" pos="0 0 1"><geom size=".1"/></body>
    <camera pos="0 0 3" xyaxes="1 0 0 0 -.3 1"/></worldbody></mujoco>"""


@pytest.mark.parametrize("incremental", [True, False])
@pytest.mark.parametrize("off", ["", "cached_light"])
def test_without_nodes_no_packet_is_traced_twice(off: str, incremental: bool) -> None:
    """Before a sky, into which a ball then rises, and without cached light."""
    model = mujoco.MjModel.from_xml_string(SKY_VIEW)
    data = mujoco.MjData(model)
    bound = bind_camera(model, "", 64, 48)
    taker, switches = SnapshotTaker(model, [bound]), Switches(off=frozenset({off} - {""}))
    scene = extract_scene(model)
    kept, full = (
        make_renderer(scene, bound.model, replace(HYBRID, incremental=one), 1, switches=switches)
        for one in (incremental, False)
    )
    packets = 16 * 12
    for tick in range(24):
        data.mocap_pos[0] = (0, 2, 1 + 0.1 * tick)
        mujoco.mj_forward(model, data)
        shot = taker.snapshot(data, 1000 * tick)
        before = kept.work["packets_traced"]
        lights = [one.render(shot, shot.cameras[0]) for one in (kept, full)]
        np.testing.assert_array_equal(*lights)
        traced = kept.work["packets_traced"] - before
        risen = kept.work["cache_nodes"] > 0
        if tick > 1 and not risen:  # the second tick records
            assert traced < 9 if incremental and not off else traced == packets
    assert risen == (not off)


PERISCOPE = """<mujoco><visual><headlight active="0"/></visual><asset>
    <material name="mirror" rgba="0 0 0 1" reflectance=".5" specular="0"/>
    <material name="lamp" rgba="1 1 1 1" emission="8" specular="0"/></asset><worldbody>
    <geom type="plane" size=".5 .5 1" pos="1 0 0" zaxis="-1 0 1" material="mirror"/>
    <geom type="plane" size=".5 .5 1" pos="1 0 1" zaxis="-1 0 -1" material="mirror"/>
    <geom type="box" size=".1 3 3" pos="-1 0 1" material="lamp"/>
    <body mocap="true" pos="0 2 1"><geom size=".1" rgba="0 0 0 1"/></body>
    <camera xyaxes="0 -1 0 0 0 1" fovy="20"/></worldbody></mujoco>"""


def test_a_mirror_shows_the_image_in_another() -> None:
    """And what moves before the second one."""
    model = mujoco.MjModel.from_xml_string(PERISCOPE)
    data = mujoco.MjData(model)
    bound = bind_camera(model, "", 32, 24)
    taker, scene = SnapshotTaker(model, [bound]), extract_scene(model)
    kept, full = (
        make_renderer(scene, bound.model, replace(HYBRID, bounces=0, incremental=one), 1)
        for one in (True, False)
    )
    for y in (2.0, 2.0, 1.0, 0.5, 0.1, 0.0, 0.0, 2.0, 2.0):
        data.mocap_pos[0] = (0, y, 1)
        mujoco.mj_forward(model, data)
        shot = taker.snapshot(data, 0)
        light = kept.render(shot, shot.cameras[0])
        np.testing.assert_array_equal(light, full.render(shot, shot.cameras[0]))
        middle = light[11:13, 15:17]
        if y == 0:
            hidden = middle.copy()
        if y > 0.2:
            np.testing.assert_allclose(middle, 0.5 * 0.5 * 8, rtol=1e-5)
    assert hidden.max() < 0.1


def moving(stage: RandomStage, ticks: int) -> list:
    """Geoms that move for a while, rest until nothing is traced, and move on."""
    rest = film_of(stage, 1)[0]
    before = film_of(stage, 8)
    return [*before, *[rest] * (REST + 30), *film_of(stage, ticks)]


@pytest.mark.parametrize("antialiasing", ["fixed", "adaptive"])
def test_incremental_equals_full_tracing(antialiasing: str) -> None:
    stage = RandomStage(7, size=(31, 23))
    film = moving(stage, 24)
    kept, full = (
        renderer_of(stage, antialiasing=antialiasing, incremental=incremental)
        for incremental in (True, False)
    )
    fractions = []
    for instant in film:
        np.testing.assert_array_equal(kept.render(*instant), full.render(*instant))
        fractions.append(kept.traced_fraction)
    assert 0 in fractions


def of_seed(seed: int) -> dict[str, object]:
    edges = {"antialiasing": "adaptive"} if seed % 5 == 4 else {}
    return {"renderer": "hybrid", "bounces": seed % 3, **edges}


@pytest.mark.slow
def test_a_film_of_random_scenes_is_the_same_however_it_is_made() -> None:
    small = {"size": (39, 27)}
    check_film(range(5, 17, 2), 6, of_seed, bulbs=True, **small)
    check_film(range(20, 22), 6, of_seed, rich=True, **small)


@pytest.mark.slow
@pytest.mark.campaign
def test_films_of_more_random_scenes_are_the_same() -> None:
    small = {"size": (39, 27)}
    check_film(range(100, 115), 10, of_seed, bulbs=True, **small)
    check_film(range(200, 208), 10, of_seed, rich=True, **small)
    check_film(range(300, 302), 4, of_seed, bulbs=True, many=150, **small)


LIT_ROOM = """<mujoco><asset>
    <texture name="sky" type="skybox" builtin="gradient" rgb1=".6 .7 .9" rgb2=".1 .1 .2"
             width="8" height="8"/>
    <texture name="tiles" type="2d" builtin="checker" rgb1=".8 .7 .6" rgb2=".3 .4 .3"
             width="32" height="32"/>
    <material name="floor" texture="tiles" texrepeat="3 3" reflectance=".2"/>
    <material name="lamp" emission="3"/><material name="gloss" specular=".8" shininess=".7"/>
  </asset><worldbody>
  <light name="bulb" mode="{mode}" pos="1 -1 2" dir="0 0 -1" cutoff="80" bulbradius=".2"/>
  <geom type="plane" size="{floor} {floor} 1" material="floor"/>
  <geom type="ellipsoid" size=".2 .2 .1" pos="-.8 .5 1.2" material="lamp"/>
  <geom type="box" size=".2 .3 .2" pos=".6 .3 .2" euler="0 0 20" material="gloss"/>
  <geom type="cylinder" size=".1 .3" pos="-.5 .6 .3" material="gloss"/>
  <body pos="0 0 .7"><freejoint/><geom size=".12" rgba=".3 .5 .8 1"/>
    <geom type="capsule" size=".05 .2" pos=".1 0 .2" euler="0 60 0" rgba=".8 .8 .3 1"/></body>
  <camera name="eye" pos="0 -2 .8" xyaxes="1 0 0 0 .2 1"/></worldbody></mujoco>"""


@pytest.mark.parametrize("floor", [2, 0])
@pytest.mark.parametrize(
    ("mode", "spp", "antialiasing"),
    [
        ("fixed", 1, "fixed"),
        ("fixed", 4, "adaptive"),
        pytest.param("fixed", 3, "fixed", marks=SLOW),
        pytest.param("trackcom", 2, "fixed", marks=SLOW),
        pytest.param("trackcom", 3, "adaptive", marks=SLOW),
    ],
)
def test_packets_before_a_still_camera_are_lit_again(
    mode: str, spp: int, antialiasing: str, floor: int
) -> None:
    """Penumbrae, a mirror with sky, a horizon with haze, and a bulb that follows what falls.

    Most packets only read the cache again, or evaluate lamps at the surfaces that they have kept;
    some need not even do that. From tick 70 on, the bulb rests in any case.
    """
    model = mujoco.MjModel.from_xml_string(LIT_ROOM.format(mode=mode, floor=floor))
    data = mujoco.MjData(model)
    camera = bind_camera(model, "eye", 64, 48, CameraConfig())
    scene, snapshots = extract_scene(model), SnapshotTaker(model, [camera])
    config = RenderConfig(renderer="hybrid", spp=spp, antialiasing=antialiasing)
    kept, full = (
        make_renderer(
            scene, camera.model, replace(config, incremental=incremental), 1, rgb=spp == 3
        )
        for incremental in (True, False)
    )
    lit_again, left = [], []
    for tick in range(80):
        before = kept.work  # type: ignore[attr-defined]
        data.time += 1e-3
        data.qpos[2] -= 2e-3
        data.qpos[0] += 3e-3
        if tick == 70:
            model.light_mode[:] = mujoco.mjtCamLight.mjCAMLIGHT_FIXED
        mujoco.mj_forward(model, data)
        snapshot = snapshots.snapshot(data, 1000 * tick)
        instant = snapshot, snapshot.cameras[0]
        assert kept.render(*instant).tobytes() == full.render(*instant).tobytes(), tick
        lit_again.append(1 - kept.traced_fraction)  # type: ignore[attr-defined]
        after = kept.work  # type: ignore[attr-defined]
        done = sum(after[key] - before[key] for key in ("packets_traced", "packets_relit"))
        left.append(1 - done / (16 * 12))
    assert np.median(lit_again) > 0.25
    assert np.median(left) > 0.1
    assert full.traced_fraction == 1  # type: ignore[attr-defined]


@pytest.mark.slow
def test_a_restart_gives_the_bytes_of_a_fresh_start() -> None:
    stage = RandomStage(3, size=(23, 17))
    film = film_of(stage, 12, moves=0.05)
    used, new = renderer_of(stage), renderer_of(stage)
    for instant in film[:9]:
        used.render(*instant)
    used.restart()
    for instant in film[9:]:
        np.testing.assert_array_equal(used.render(*instant), new.render(*instant))


@pytest.mark.slow
def test_a_saved_cache_goes_on_with_the_same_bytes() -> None:
    stage = RandomStage(3, size=(23, 17))
    film = film_of(stage, 90, moves=0.01)
    one = renderer_of(stage)
    for instant in film[:70]:
        one.render(*instant)
    other = renderer_of(stage)
    other.prepare_restore(one.save())()
    np.testing.assert_array_equal(other.render_again(*film[69]), one._device.luminance)
    for instant in film[70:]:
        np.testing.assert_array_equal(other.render(*instant), one.render(*instant))


@pytest.mark.slow
def test_edges_that_ask_for_nodes_in_a_sweep_leave_nothing_behind() -> None:
    """The camera jumps in the tick of a sweep; what a saved state does not hold must not matter."""
    stage = RandomStage(5, size=(23, 17), bulbs=True)
    before = film_of(stage, 1)[0]
    after = before[0], CameraPose(stage.pose.pos + 0.15, stage.pose.mat)
    one, other = (renderer_of(stage, antialiasing="adaptive", spp=4) for _ in range(2))
    for _ in range(RENEWAL * QUARTERS - 1):
        one.render(*before)
    one.render(*after)
    other.prepare_restore(one.save())()
    for _ in range(DROPPED):
        np.testing.assert_array_equal(one.render(*after), other.render(*after))
    np.testing.assert_array_equal(one.save()["light"], other.save()["light"])


@pytest.mark.parametrize(
    "damage",
    [
        lambda saved: saved.pop("keys"),
        lambda saved: saved.update(light=saved["light"][1:]),
        lambda saved: saved.update(light=saved["light"].astype(np.float64)),
        lambda saved: saved.update(luminance=saved["luminance"][1:]),
        lambda saved: saved.update(tick=np.array(-1)),
        lambda saved: saved["keys"].__setitem__((0, 0), 10_000),
        lambda saved: saved["keys"].__setitem__((0, 1), 1000),
        # a face that only cylinders have, and a place beyond every lattice
        lambda saved: saved["keys"].__setitem__((slice(None), 2), 6),
        lambda saved: saved["keys"].__setitem__((0, 3), 2**31 - 1),
    ],
)
def test_damaged_states_are_refused(damage: Callable[[dict], object]) -> None:
    stage = RandomStage(3, size=(23, 17))
    one = renderer_of(stage)
    expected = one.render(*film_of(stage, 1)[0]).copy()
    saved = one.save()
    damage(saved)
    with pytest.raises(EvsError, match="saved state is damaged"):
        renderer_of(stage).prepare_restore(saved)()
    np.testing.assert_array_equal(one._device.luminance, expected)


def test_nodes_that_are_no_longer_seen_are_dropped() -> None:
    stage = RandomStage(11, size=(39, 27))
    one = renderer_of(stage)
    instant = film_of(stage, 1)[0]
    one.render(*instant)
    before = one.work["cache_nodes"]
    assert before > 100
    away = CameraPose(instant[1].pos + 100.0, instant[1].mat)
    for _ in range(DROPPED):
        one.render(instant[0], away)
    assert one.work["cache_nodes"] < before / 2


def test_a_full_cache_has_a_coarser_lattice(monkeypatch: pytest.MonkeyPatch) -> None:
    most = 400
    film = film_of(RandomStage(11, size=(39, 27)), 4)
    fine = renderer_of(RandomStage(11, size=(39, 27))).render(*film[0]).copy()
    monkeypatch.setattr(_core, "Tracing", partial(_core.Tracing, nodes=most))
    lights = []
    for threads, antialiasing in ((1, "fixed"), (3, "fixed"), (1, "adaptive"), (3, "adaptive")):
        one = renderer_of(RandomStage(11, size=(39, 27)), threads, antialiasing=antialiasing)
        lights.append([one.render(*instant).tobytes() for instant in film])
        assert 0 < one.work["cache_nodes"] <= most
        assert one.save()["coarser"] > 0
    assert lights[0] == lights[1]
    assert lights[2] == lights[3]
    coarse = np.frombuffer(lights[0][0], np.float32).reshape(fine.shape)
    assert abs((coarse - fine).mean()) < 0.1 * fine.mean()


@pytest.mark.statistical
@pytest.mark.parametrize(
    ("name", "block"),
    [
        ("sun", 0.03), ("bare_bulb", 0.03), ("dome", 0.03), ("sky", 0.03), ("sunset", 0.03),
        ("swell", 0.03), ("panel", 0.05), ("room", 0.05), ("bulb", 0.07), ("glass", 0.08),
    ],
)  # fmt: skip
def test_light_is_that_of_converged_paths(name: str, block: float) -> None:
    stage = getattr(path_stages, name)()
    config = replace(stage.render, renderer="path", spp=1024, bounces=stage.bounces)
    path = make_renderer(stage.scene, stage.camera, config, 0).render(stage.shot, stage.pose)
    ours = renderer_of(stage, 0, spp=16, bounces=stage.bounces).render(stage.shot, stage.pose)
    error = (ours - path).astype(float)
    assert abs(error.mean()) < 0.01 * path.mean()
    h, w = (side // 8 * 8 for side in path.shape)
    blocks = error[:h, :w].reshape(h // 8, 8, w // 8, 8).mean((1, 3))
    assert np.abs(blocks).max() < block * path.mean()


def events_of(world: World, ticks: int) -> list[bytes]:
    """Of the first camera."""
    return [b"".join(packet.events.tobytes() for packet in world.step()[:1]) for _ in range(ticks)]


@pytest.mark.slow
def test_a_still_scene_is_silent_for_a_minute() -> None:
    world = ball_room(HYBRID)
    assert sum(len(packet.events) for _ in range(60_000) for packet in world.step()) == 0


def test_a_restored_world_and_one_with_another_camera_see_the_same() -> None:
    world, other = ball_room(HYBRID), ball_room(HYBRID)
    more = ball_room(HYBRID, ("eye", "other"))
    for each in (world, more):
        each.data.qvel[0] = 2.0
    first = events_of(world, 80)
    assert sum(map(len, first)) > 1000
    assert events_of(more, 80) == first
    other.restore(world.save())
    assert events_of(other, 40) == events_of(world, 40)
    world.reset()
    world.data.qvel[0] = 2.0
    assert events_of(world, 80) == first
