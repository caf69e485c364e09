"""Light of the `hybrid` renderer that is out of date: how wrong it is, and when it is gone.

One room. Lamps, a mocap body, a door, balls and the camera change after a long rest, in which the
incremental renderer has stopped tracing. The truth of an instant is a renderer that begins there.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, replace
from functools import cache

import mujoco
import numpy as np
import pytest

import evs
from evs.emulator.base.features import Switches
from evs.emulator.base.scene import F32, CameraPose, LightKind, SceneSnapshot, Shape
from evs.emulator.config import CameraConfig, FlickerConfig, RenderConfig, SensorConfig
from evs.emulator.render import NativeRenderer, make_renderer
from evs.emulator.world import SnapshotTaker, bind_camera, extract_scene
from reference.edited import LARGE, SMALL, stage
from reference.scenes import SAMPLED_OUTLINES
from reference.stage import Builder, Stage, matt, turned

HYBRID = RenderConfig(renderer="hybrid", spp=1)
RENEWAL, QUARTERS, PATHS = 16, 4, 16
CYCLE = RENEWAL * QUARTERS
SETTLED = CYCLE + 2 * RENEWAL
GONE = 2 * CYCLE + 2 * RENEWAL
"""unread nodes are dropped within two cycles, then their neighbours settle"""
REST = 3 * CYCLE
ROUNDING = 2e-6
CELL = 0.02
"""share by which light may differ where a fresh start places nodes elsewhere in their cell"""
ROUNDED = 0.01
"""share of the pixels that may differ by more where nodes were lit in the frame of another camera:
a rounding error decides what a path meets"""

GREY = 0.8
WHITE: float = ((GREY + 0.055) / 1.055) ** 2.4
"""linear reflectance of everything in the room"""
ROOM = f"""
<mujoco>
  <visual><headlight active="0"/></visual>
  <asset>
    <material name="matt" rgba="{GREY} {GREY} {GREY} 1" specular="0"/>
    <material name="glow" rgba="{GREY} {GREY} {GREY} 1" specular="0" emission="4"/>
  </asset>
  <default><geom material="matt"/></default>
  <worldbody>
    <light type="directional" dir="0 0 -1" diffuse="0 0 0" ambient=".1 .1 .1"/>
    <light name="lamp" type="point" pos=".8 2 .8" attenuation="0 0 1" diffuse="2 2 2"
           bulbradius="0"/>
    <body name="bulb" mocap="true" pos="1 -1 1.5">
      <light name="bulb" type="point" attenuation="0 0 1" diffuse="1 1 1" bulbradius=".1"/></body>
    <geom type="plane" size="2 3 .1"/>
    <geom type="box" size=".8 .05 .6" pos="-1.2 1 .6"/>
    <geom type="box" size=".8 .05 .6" pos="1.2 1 .6"/>
    <geom type="box" size=".4 .05 .1" pos="0 1 1.1"/>
    <geom type="box" size="2 .05 .6" pos="0 2.5 .6"/>
    <body pos="-.4 1 .5"><joint name="door" axis="0 0 1"/>
      <geom type="box" size=".4 .04 .5" pos=".4 0 0"/></body>
    <body name="block" mocap="true" pos="-1 0 .2"><geom type="box" size=".2 .15 .2"/></body>
    <body name="ball" mocap="true" pos=".8 -.2 .15"><geom size=".15"/></body>
    <body name="glow" mocap="true" pos="-1.4 .5 .7"><geom size=".1" material="glow"/></body>
  </worldbody>
</mujoco>
"""
VIEW = CameraConfig(lookat=(0, 0.4, 0.3), distance=3.5, azimuth=90, elevation=-20)
AWAY = (0.0, 0.0, 1e6)

Instant = tuple[SceneSnapshot, CameraPose]


class Room:
    """The room at one instant, which a test changes as it likes."""

    def __init__(self) -> None:
        self.model = mujoco.MjModel.from_xml_string(ROOM)
        self.data = mujoco.MjData(self.model)
        self.bound = bind_camera(self.model, "", 48, 36, VIEW)
        self.taker = SnapshotTaker(self.model, [self.bound])
        self.scene = extract_scene(self.model)

    def put(self, body: str, *pos: float) -> None:
        self.data.mocap_pos[self.model.body(body).mocapid[0]] = pos

    def turn_door(self, angle: float) -> None:
        self.data.joint("door").qpos[0] = angle

    def instant(self, t_us: int = 0) -> Instant:
        mujoco.mj_forward(self.model, self.data)
        shot = self.taker.snapshot(self.data, t_us)
        return shot, shot.cameras[0]

    def renderer(self, cached: bool = True, **render: object) -> NativeRenderer:
        """A renderer that has seen nothing yet; `cached`: whether cached light shows."""
        config = replace(HYBRID, **render)  # type: ignore[arg-type]
        off = SAMPLED_OUTLINES.off | (frozenset() if cached else {"cached_light"})
        made = make_renderer(self.scene, self.bound.model, config, 1, switches=Switches(off=off))
        assert isinstance(made, NativeRenderer)
        return made


@dataclass(frozen=True)
class Change:
    """What happens in the room."""

    move: Callable[[Room, float], None]
    """puts things where they are at a share of the way, 0 ... 1"""
    ticks: int = 1
    """how long it takes"""
    forgotten: int = SETTLED
    """after so many ticks of rest nothing of it is left"""
    hides_nodes: bool = False
    """whether it hides nodes or shows some, which a fresh start places elsewhere in their cell"""
    one_way: bool = False
    """whether all light grows, or all fades"""


def line(body: str, start: tuple[float, ...], end: tuple[float, ...]) -> Callable[..., None]:
    """A body goes from `start` to `end`."""

    def move(room: Room, share: float) -> None:
        room.put(body, *(np.array(start) + (np.array(end) - start) * share))

    return move


BULB, BULB_ELSEWHERE = (1, -1, 1.5), (-1, -1, 1.0)
CHANGES = {
    "lamp on": Change(line("bulb", AWAY, BULB), one_way=True),
    "lamp off": Change(line("bulb", BULB, AWAY), one_way=True),
    "bulb jumps": Change(line("bulb", BULB, BULB_ELSEWHERE)),
    "bulb slides": Change(line("bulb", BULB, BULB_ELSEWHERE), ticks=30),
    "glowing ball jumps": Change(line("glow", (-1.4, 0.5, 0.7), (-0.3, 0.2, 0.6)), forgotten=GONE),
    "block jumps": Change(
        line("block", (-1, 0, 0.2), (0.3, 0.3, 0.2)), forgotten=GONE, hides_nodes=True
    ),
    "block is taken away": Change(
        line("block", (-1, 0, 0.2), (3, -30, 0.2)), forgotten=GONE, hides_nodes=True
    ),
    "door opens": Change(
        lambda room, share: room.turn_door(1.2 * share), 30, GONE, hides_nodes=True
    ),
    "door shuts": Change(
        lambda room, share: room.turn_door(1.2 - 1.2 * share), 30, GONE, hides_nodes=True
    ),
    "ball rolls": Change(line("ball", (0.8, -0.2, 0.15), (0.6, -0.2, 0.15)), 40, GONE),
    # 0.1 m a tick
    "ball at 100 m/s": Change(line("ball", (-4, 0.2, 0.3), (4, 0.2, 0.3)), 80, GONE),
}
ALL = pytest.mark.parametrize(
    "name",
    [
        pytest.param(name, marks=pytest.mark.slow if change.ticks > 1 else ())
        for name, change in CHANGES.items()
    ],
)


@dataclass
class Take:
    """A change and what was seen of it; the first row is before it. Ticks follow it at rest."""

    alike: bool
    """whether incremental and full tracing gave the same bytes in every tick"""
    slept: bool
    """whether the incremental renderer had stopped tracing before"""
    light: F32
    cached: F32
    """its part that comes from the cache"""
    fresh: F32
    """a renderer that begins at that instant"""
    fresh_cached: F32
    same: np.ndarray
    """(h, w) pixels that show the same point of the room all the time"""
    largest: float
    """the largest change of a quarter of a node's paths, as light of a pixel"""


def quarters_of(renderer: NativeRenderer) -> dict[tuple[int, ...], F32]:
    """Node -> the means of its quarters' paths, (4, 3)."""
    saved = renderer.save()
    quarters = saved["light"][:, 9:21].reshape(-1, QUARTERS, 3) / PATHS
    return {
        tuple(key[:6]): each for key, each in zip(saved["keys"].tolist(), quarters, strict=True)
    }


def largest_change(states: list[dict[tuple[int, ...], F32]]) -> float:
    common = set.intersection(*(set(state) for state in states))
    values = np.array([[state[key] for key in sorted(common)] for state in states])
    return WHITE * float(np.ptp(values, axis=0).max())


@cache
def take_of(name: str) -> Take:
    """Film a change."""
    change, room = CHANGES[name], Room()
    instants = []
    for tick in range(change.ticks + 1):
        change.move(room, tick / change.ticks)
        instants.append(room.instant())
    kept, full = room.renderer(), room.renderer(incremental=False)
    bare, slept, alike = room.renderer(cached=False), False, True

    def render(instant: Instant) -> F32:
        nonlocal alike
        light = kept.render(*instant).copy()
        alike = alike and light.tobytes() == full.render(*instant).tobytes()
        return light

    # wakes in the middle of a cycle
    for _ in range(REST + 12):
        first = render(instants[0])
        slept = slept or kept.traced_fraction == 0
    film = [*instants, *instants[-1:] * (change.forgotten + CYCLE)]
    light = np.stack([first, *map(render, film[1:])])
    direct, fresh, states, shown = [], [], [], []
    for instant in instants:
        new = room.renderer()
        fresh.append(new.render(*instant).copy())
        direct.append(bare.render(*instant).copy())
        states.append(quarters_of(new))
        shown.append(new.hits(*instant))
    still = np.ptp([shot.geom_pos for shot, _ in instants], axis=0).max(axis=1) == 0
    geoms, distances = (np.array(part) for part in zip(*shown, strict=True))
    same = (np.ptp(geoms, axis=0) == 0) & (geoms[0] >= 0) & still[geoms[0]]
    same &= np.ptp(distances, axis=0) == 0
    rows = np.minimum(np.arange(len(film)), len(instants) - 1)
    seen, without = np.stack(fresh)[rows], np.stack(direct)[rows]
    return Take(
        alike, slept, light, light - without, seen, seen - without, same, largest_change(states)
    )


@ALL
def test_incremental_tracing_keeps_the_bytes(name: str) -> None:
    take = take_of(name)
    assert take.slept
    assert take.alike


@ALL
def test_stale_light_lies_between_what_was_and_what_is(name: str) -> None:
    change, take = CHANGES[name], take_of(name)
    was_stale = np.abs(take.cached - take.fresh_cached)[:, take.same].max()
    assert was_stale > 0.02 * take.fresh_cached.max()
    # a quarter of the paths may still be the old one where another is new: light may rise in the
    # one and fall in the other
    slack = (
        ROUNDING if change.one_way else ROUNDING + take.largest / (2 if change.ticks == 1 else 1)
    )
    for tick, cached in enumerate(take.cached):
        lately = take.fresh_cached[max(0, tick - SETTLED) : tick + 1]
        assert (cached >= lately.min(axis=0) - slack)[take.same].all(), tick
        assert (cached <= lately.max(axis=0) + slack)[take.same].all(), tick


@ALL
def test_stale_light_gives_way_quarter_by_quarter(name: str) -> None:
    change, take = CHANGES[name], take_of(name)
    for at_rest in range(SETTLED - 1):
        # new quarters show once their neighbours are averaged, and the steps are made
        quarters = max(0, (at_rest - 2 * RENEWAL + 1) // RENEWAL)
        tick = change.ticks - 1 + at_rest
        error = np.abs(take.cached[tick] - take.fresh_cached[tick])[take.same].max()
        assert error <= take.largest * (1 - quarters / QUARTERS) + ROUNDING, at_rest


@ALL
def test_cached_light_changes_in_small_steps(name: str) -> None:
    change, take = CHANGES[name], take_of(name)
    steps = np.diff(take.cached, axis=0)[:, take.same]
    # one quarter of four, in 16 steps
    assert np.abs(steps).max() <= take.largest / CYCLE + ROUNDING
    if change.one_way:
        assert (steps >= -ROUNDING).all() or (steps <= ROUNDING).all()


@ALL
def test_what_changed_is_forgotten(name: str) -> None:
    change, take = CHANGES[name], take_of(name)
    end = change.ticks - 1 + change.forgotten
    if change.hides_nodes:
        np.testing.assert_allclose(take.light[end], take.fresh[end], rtol=CELL, atol=1e-4)
    else:
        np.testing.assert_array_equal(take.light[end], take.fresh[end])
    assert all(light.tobytes() == take.light[end].tobytes() for light in take.light[end:])


def under_the_sky(x: float) -> Stage:
    """A box on a floor that the sky alone lights."""
    made = Builder()
    made.add(Shape.PLANE, (3, 3, 1), (0, 0, 0), matt(0.7))
    made.add(Shape.BOX, (0.4, 0.4, 0.4), (x, 0, 0.4), matt(0.5))
    dark, grey = (0.0, 0.0, 0.0), (0.5, 0.5, 0.5)
    made.shine(LightKind.DIRECTIONAL, ambient=grey, diffuse=dark)
    return made.look((0.3, -3, 1.5), (0, 0, 0.3))


@pytest.mark.parametrize(("start", "end"), [(30.0, 0.0), (0.0, 30.0)])
def test_nodes_under_a_box_darken_no_floor_beside_it(start: float, end: float) -> None:
    before, after = under_the_sky(start), under_the_sky(end)
    one, fresh = (make_renderer(after.scene, after.camera, HYBRID, 1) for _ in range(2))
    one.render(before.shot, before.pose)
    for _ in range(GONE):
        light = one.render(after.shot, after.pose)
    expected = fresh.render(after.shot, after.pose)
    np.testing.assert_allclose(light, expected, rtol=CELL, atol=1e-4)


BACK_ROOM = CameraConfig(lookat=(0, 2, 0.5), distance=2, azimuth=270, elevation=-30)
FROM_THE_SIDE = CameraConfig(lookat=(0, 0.4, 0.3), distance=3.5, azimuth=150, elevation=-40)


def seen_from(room: Room, view: CameraConfig) -> CameraPose:
    bound = bind_camera(room.model, "", 48, 36, view)
    return SnapshotTaker(room.model, [bound]).snapshot(room.data, 0).cameras[0]


def ahead(pose: CameraPose) -> CameraPose:
    """Past the room, with nothing in view."""
    return replace(pose, pos=pose.pos + np.array([0.0, 6.0, 0.0]))


@pytest.mark.slow
@pytest.mark.parametrize("turned_round", [False, True])
@pytest.mark.parametrize("away", [1, 40, CYCLE + 6, 2 * CYCLE + 1])
def test_a_camera_that_jumps_there_and_back_sees_what_a_fresh_one_sees(
    away: int, turned_round: bool
) -> None:
    room = Room()
    shot, here = room.instant()
    there = seen_from(room, BACK_ROOM) if turned_round else ahead(here)
    kept, full = room.renderer(), room.renderer(incremental=False)
    for pose, ticks in ((here, 20), (there, away), (here, SETTLED)):
        expected = room.renderer().render(shot, pose)
        for _ in range(ticks):
            light = kept.render(shot, pose)
            np.testing.assert_array_equal(light, full.render(shot, pose))
            assert (np.abs(light - expected) > CELL * expected + 1e-4).mean() < ROUNDED
    np.testing.assert_array_equal(light, expected)


def test_paths_keep_their_directions_when_the_camera_turns() -> None:
    room = Room()
    shot, pose = room.instant()
    states = []
    for angle in (0.0, 15.0):
        mat = turned((0, 0, 1), angle) @ pose.mat.reshape(3, 3)
        one = room.renderer()
        one.render(shot, replace(pose, mat=np.ascontiguousarray(mat.ravel())))
        states.append(quarters_of(one))
    both = sorted(set(states[0]) & set(states[1]))
    assert len(both) > 1000
    before, after = (np.array([state[key] for key in both]) for state in states)
    # a rounding error may decide what a path meets
    assert (np.abs(after - before) > 1e-3 * before.mean()).mean() < 0.05


def test_a_camera_that_jumps_aside_sees_what_a_fresh_one_sees() -> None:
    room = Room()
    shot, here = room.instant()
    aside = seen_from(room, FROM_THE_SIDE)
    kept, full = room.renderer(), room.renderer(incremental=False)
    for pose in (here, aside, here):
        for _ in range(GONE):
            light = kept.render(shot, pose)
            np.testing.assert_array_equal(light, full.render(shot, pose))
        expected = room.renderer().render(shot, pose)
        np.testing.assert_allclose(light, expected, rtol=CELL, atol=1e-4)


@pytest.mark.parametrize("away", [10, CYCLE + 6, SETTLED - 1, 2 * CYCLE])
def test_a_lamp_goes_out_while_the_camera_is_away(away: int) -> None:
    room = Room()
    kept, full = room.renderer(), room.renderer(incremental=False)
    bare = room.renderer(cached=False)
    lit, here = room.instant()
    old = room.renderer().render(lit, here) - bare.render(lit, here)
    for _ in range(9):
        for one in (kept, full):
            one.render(lit, here)
    room.put("bulb", *AWAY)
    dark, _ = room.instant()
    direct, expected = bare.render(dark, here), room.renderer().render(dark, here)
    for tick in range(away + SETTLED):
        pose = ahead(here) if tick < away else here
        light = kept.render(dark, pose)
        np.testing.assert_array_equal(light, full.render(dark, pose))
        if tick >= away:
            assert (light < (1 - CELL) * expected - ROUNDING).mean() < ROUNDED, tick
            assert (light > (1 + CELL) * (direct + old) + ROUNDING).mean() < ROUNDED, tick
        if tick >= max(away, SETTLED - 1):
            assert (np.abs(light - expected) > CELL * expected + 1e-4).mean() < ROUNDED, tick
    np.testing.assert_array_equal(light, expected)


@pytest.mark.parametrize("waveform", ["mains", "pwm"])
def test_cached_light_does_not_flicker(waveform: str) -> None:
    table = FlickerConfig(light="*", waveform=waveform, hz=50.0, depth=1.0, duty=0.3)
    room = Room()
    kept = room.renderer(flicker=(table,))
    full = room.renderer(flicker=(table,), incremental=False)
    bare, steady = room.renderer(flicker=(table,), cached=False), room.renderer()
    steady.render(*room.instant())
    expected = {name: steady.save()[name].tobytes() for name in ("keys", "light")}
    lights, cached = [], []
    for tick in range(SETTLED):
        instant = room.instant(1000 * tick)
        light = kept.render(*instant).copy()
        np.testing.assert_array_equal(light, full.render(*instant))
        lights.append(light)
        cached.append(light - bare.render(*instant))
        saved = kept.save()
        assert all(saved[name].tobytes() == values for name, values in expected.items()), tick
    assert np.ptp(lights, axis=0).max() > 0.2
    assert np.ptp(cached, axis=0).max() < ROUNDING


@pytest.mark.parametrize("waveform", ["mains", "pwm"])
def test_the_light_of_a_lamp_that_flickers_and_goes_out_fades_steadily(waveform: str) -> None:
    table = FlickerConfig(light="*", waveform=waveform, hz=50.0, depth=1.0, duty=0.3)
    room = Room()
    one, bare = room.renderer(flicker=(table,)), room.renderer(cached=False, flicker=(table,))
    one.render(*room.instant())
    room.put("bulb", *AWAY)
    cached = []
    for tick in range(1, SETTLED + 1):
        instant = room.instant(1000 * tick)
        light = one.render(*instant)
        cached.append(light - bare.render(*instant))
    assert (np.diff(cached, axis=0) <= ROUNDING).all()
    fresh = room.renderer(flicker=(table,)).render(*instant)
    np.testing.assert_array_equal(light, fresh)


IN_EVERY_TICK = (
    "camera's place",
    "light's place",
    "light's direction",
    "geom's place",
    "geom's turn",
)
"""edits that move something and make no new renderer"""


class Watched:
    """Incremental and full tracing of one model that a test edits."""

    def __init__(self) -> None:
        self.model, self.data = stage()
        self.data.qvel[:] = 0
        self.kept, self.full = self.camera(), self.camera(incremental=False)

    def camera(self, **render: object) -> evs.EventCamera:
        config = replace(HYBRID, **render)  # type: ignore[arg-type]
        sensor = SensorConfig("ideal", width=48, height=36)
        return evs.EventCamera(self.model, "eye", sensor=sensor, render=config, threads=1)

    def watch(self, ticks: int = 1) -> F32:
        """The light of the last tick."""
        for _ in range(ticks):
            mujoco.mj_step(self.model, self.data)
            for camera in (self.kept, self.full):
                camera.observe(self.data)
            np.testing.assert_array_equal(self.kept.luminance, self.full.luminance)
        return self.kept.luminance.copy()

    def fresh(self) -> F32:
        """The light of a camera that begins now."""
        camera = self.camera()
        camera.observe(self.data)
        return camera.luminance.copy()


@pytest.mark.parametrize(
    "name",
    [
        pytest.param(name, marks=() if k % 6 == 0 else pytest.mark.slow)
        for k, name in enumerate([*SMALL, *LARGE])
        if name not in IN_EVERY_TICK
    ],
)
def test_an_edit_leaves_no_light_of_before(name: str) -> None:
    one = Watched()
    one.watch(3)
    # light is stale when the edit comes
    SMALL["light's place"](one.model)
    one.watch(5)
    {**SMALL, **LARGE}[name](one.model)
    if name in LARGE:
        for camera in (one.kept, one.full):
            camera.refresh()
    light = one.watch()
    np.testing.assert_array_equal(light, one.fresh())


@pytest.mark.slow
@pytest.mark.parametrize("name", IN_EVERY_TICK)
def test_edited_places_are_forgotten(name: str) -> None:
    one = Watched()
    one.watch(3)
    SMALL[name](one.model)
    first, expected = one.watch(), one.fresh()
    assert np.abs(first - expected).max() > 2e-3 * expected.max()
    if name.startswith("light"):
        np.testing.assert_array_equal(one.watch(SETTLED - 1), expected)
    else:
        np.testing.assert_allclose(one.watch(GONE - 1), expected, rtol=CELL, atol=1e-4)
