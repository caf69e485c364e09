"""Worlds: many worlds in one call give the bytes that each gives alone, as a World."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import mujoco
import numpy as np
import pytest

import evs
from evs.emulator import World, Worlds
from evs.emulator.config import CameraConfig, ModelConfig, RenderConfig, SceneConfig, SensorConfig
from evs.msgs import EVENT_DTYPE, EvsError
from reference.worlds_alone import (
    SWING,
    Alone,
    assert_same_states,
    both,
    by_world,
    change_both,
    raw,
    step_both,
)

SCENES = Path(__file__).parents[3] / "config/scenes"

IDEAL = SensorConfig("ideal", width=64, height=64)
READ_OUT = SensorConfig("dvs128", width=40, height=32)
PATH = RenderConfig(renderer="path", spp=1)

# name -> scene, cameras
CASES: dict[str, tuple[str, list[dict[str, Any]]]] = {
    "direct": ("humanoid", [{"camera": "side", "sensor": IDEAL}]),
    "a readout": ("pencil", [{"camera": "scene", "sensor": READ_OUT}]),
    "noise of many kinds": ("pendulum", [{"sensor": SensorConfig(width=40, height=32)}]),
    "adaptive antialiasing": (
        "pendulum",
        [{"sensor": IDEAL, "render": RenderConfig(antialiasing="adaptive")}],
    ),
    "the adaptive model": ("pendulum", [{"sensor": IDEAL, "model": ModelConfig(name="adaptive")}]),
    "path": ("pendulum", [{"sensor": READ_OUT, "render": PATH}]),
    "hybrid": ("pendulum", [{"sensor": READ_OUT, "render": RenderConfig("hybrid", spp=1)}]),
    "two cameras": (
        "cartpole",
        [{"camera": "watch", "sensor": IDEAL}, {"camera": "onboard", "sensor": READ_OUT}],
    ),
    "a mounted camera": (
        "cartpole",
        [
            {
                "camera": CameraConfig(body="cart", pos=(0, -0.8, 0.3), quat=(0.7, 0.7, 0, 0)),
                "sensor": IDEAL,
            }
        ],
    ),
    "a free camera": ("goalie", [{"camera": CameraConfig(distance=1.5), "sensor": IDEAL}]),
    "a shaking camera": (
        "cartpole",
        [{"camera": CameraConfig(distance=2.0, shake_m=0.01, shake_hz=50.0), "sensor": IDEAL}],
    ),
    "sites": ("swing", [{"camera": "left", "sensor": IDEAL}]),
    "no sites": (
        "swing",
        [{"camera": "left", "sensor": IDEAL, "render": RenderConfig(sites=False)}],
    ),
    "no headlight": (
        "swing",
        [{"camera": "left", "sensor": IDEAL, "render": RenderConfig(headlight="off")}],
    ),
}


def scene_of(name: str) -> Any:
    """A file of config/scenes, or the swing."""
    if name == "swing":
        return mujoco.MjModel.from_xml_string(SWING)
    return SCENES / f"{name}.xml"


def push(number: int, world: World) -> None:
    """A world's own velocity in every degree of freedom."""
    world.data.qvel[:] = 4.0 + 0.7 * number


def swings(
    count: int = 3, *, sensor: SensorConfig = READ_OUT, **options: Any
) -> tuple[Worlds, Alone]:
    """The swing, pushed, seen from the left."""
    made = both(scene_of("swing"), count, [{"camera": "left", "sensor": sensor}], **options)
    change_both(*made, push)
    return made


@pytest.mark.parametrize("name", CASES)
def test_each_world_gives_the_bytes_of_a_world_alone(name: str) -> None:
    scene, cameras = CASES[name]
    worlds, alone = both(scene_of(scene), 3, cameras, seed=3, threads=2, control="random")
    change_both(worlds, alone, push)
    assert worlds.one_by_one == ""
    assert step_both(worlds, alone, ticks=4) > 0
    assert_same_states(worlds, alone)
    step_both(worlds, alone, ticks=2)


@pytest.mark.parametrize("threads", [1, 2, 5])
@pytest.mark.parametrize("count", [1, 2, 3, 7])
def test_neither_threads_nor_other_worlds_change_a_byte(count: int, threads: int) -> None:
    worlds, alone = swings(count, threads=threads, control="random")
    assert len(worlds) == count
    assert (worlds.one_by_one == "") == (count > 1)
    assert step_both(worlds, alone, ticks=6) > 0
    assert_same_states(worlds, alone)


def test_a_world_does_not_depend_on_how_many_there_are() -> None:
    def seen(count: int) -> list[bytes]:
        worlds, _ = swings(count, control="random", seed=9)
        return [raw(events) for events in worlds.step(ticks=8)[0]]

    few, many = seen(2), seen(6)
    assert few == many[:2]
    assert len({*many}) == 6


@pytest.mark.parametrize("parts", [(12,), (1,) * 12, (5, 7), (1, 10, 1)])
def test_neither_does_it_depend_on_the_ticks_in_a_step(parts: tuple[int, ...]) -> None:
    worlds, alone = swings(control="random")
    (expected,) = alone.step(ticks=12)
    seen = [b""] * 3
    for ticks in parts:
        (events,) = worlds.step(ticks=ticks)
        seen = [before + raw(one) for before, one in zip(seen, events, strict=True)]
    assert seen == expected
    assert_same_states(worlds, alone)


def test_each_world_has_a_number_of_ticks_of_its_own() -> None:
    worlds, alone = swings(4, control="random")
    for ticks in ([3, 0, 1, 7], [0, 0, 0, 2], [4, 6, 5, 0]):
        assert step_both(worlds, alone, ticks=ticks) > 0
        assert_same_states(worlds, alone)
    assert worlds.t_us.tolist() == [7000, 6000, 6000, 9000]
    seen, *_ = worlds.step(ticks=np.array([0, 2, 2, 0]))
    assert (seen.counts[[0, 3]] == 0).all()


def test_controls_hold_until_others_come() -> None:
    worlds, alone = swings(sensor=IDEAL)
    controls = [[0.5], [-1.0], [0.0]]
    assert step_both(worlds, alone, controls, ticks=5) > 0
    step_both(worlds, alone, ticks=5)
    assert [one.data.ctrl.tolist() for one in map(worlds.world, range(3))] == controls
    # also for a world that does not move now
    step_both(worlds, alone, [[1.0], [1.0], [-0.5]], ticks=[0, 2, 2])
    step_both(worlds, alone, ticks=5)
    assert_same_states(worlds, alone)
    assert [one.data.ctrl.tolist() for one in map(worlds.world, range(3))] == [[1], [1], [-0.5]]


@pytest.mark.parametrize("control", ["random", "zero"])
def test_after_a_reset_the_control_source_acts_again(control: str) -> None:
    worlds, alone = swings(control=control)
    step_both(worlds, alone, [[1.0], [-1.0], [0.5]], ticks=[2, 0, 3])
    worlds.reset(worlds=[1])
    alone.each[1].reset()
    step_both(worlds, alone, ticks=5)
    assert_same_states(worlds, alone)


def test_controls_are_copied() -> None:
    worlds, alone = swings()
    controls = np.array([[0.5], [-1.0], [0.25]])
    seen = by_world(worlds.step(controls, ticks=2))
    expected = alone.step(controls, ticks=2)
    controls[:] = 0.0
    seen += by_world(worlds.step(ticks=5))
    assert seen == expected + alone.step(ticks=5)
    assert_same_states(worlds, alone)


@pytest.mark.parametrize("control", ["zero", "keyframe", "random"])
def test_sources_of_control_act_in_each_world(control: str) -> None:
    worlds, alone = swings(control=control, tick_us=2500)
    step_both(worlds, alone, ticks=8)
    assert_same_states(worlds, alone)


def test_stamps_begin_at_start_us(tmp_path: Path) -> None:
    (tmp_path / "swing.xml").write_text(SWING)
    scene = SceneConfig(file=str(tmp_path / "swing.xml"), start_us=5_000_000, tick_us=2000)
    cameras = [
        {"camera": "left", "sensor": IDEAL},
        {"camera": "right", "sensor": READ_OUT},
    ]
    worlds, alone = both(scene, 3, cameras, seed=4)
    change_both(worlds, alone, push)
    assert worlds.t_us.tolist() == [5_000_000] * 3
    seen = worlds.step(ticks=5)
    assert by_world(seen) == alone.step(ticks=5)
    for camera in seen:
        assert len(camera.events) > 0
        assert (camera.events["t"] > 5_000_000).all()
        assert (camera.events["t"] <= 5_010_000 + 1000).all()
    assert_same_states(worlds, alone)


def test_random_controls_of_a_configuration_follow_from_its_control_seed(tmp_path: Path) -> None:
    (tmp_path / "swing.xml").write_text(SWING)
    scene = SceneConfig(file=str(tmp_path / "swing.xml"), control="random", control_seed=5)
    worlds, alone = both(scene, 2, [{"camera": "left", "sensor": IDEAL}], seed=4)
    step_both(worlds, alone, ticks=8)
    assert_same_states(worlds, alone)
    assert worlds.world(0).data.ctrl != worlds.world(1).data.ctrl


def test_what_a_caller_put_into_a_world_acts_in_it() -> None:
    worlds, alone = swings(sensor=IDEAL)
    step_both(worlds, alone, ticks=2)

    def change(number: int, world: World) -> None:
        world.data.ctrl[:] = 0.1 * number
        world.data.xfrc_applied[:, 1] = 3.0 * number
        world.data.qacc_warmstart[:] = number

    change_both(worlds, alone, change)
    step_both(worlds, alone, ticks=2)
    change_both(
        worlds,
        alone,
        lambda number, world: number and world.cameras[0].adjust(pos_thres=0.1 * number),
    )
    assert step_both(worlds, alone, ticks=5) > 0
    assert_same_states(worlds, alone)


def test_a_camera_that_comes_later_begins_then() -> None:
    worlds, alone = swings(control="random")
    step_both(worlds, alone, ticks=3)
    info = worlds.add_camera("right", sensor=IDEAL)
    for world in alone.each:
        world.add_camera("right", sensor=IDEAL)
    assert worlds.cameras == ("left", "right")
    assert worlds.infos == tuple(camera.info for camera in alone.each[0].cameras)
    assert info == worlds.infos[1]
    assert step_both(worlds, alone, ticks=5) > 0
    assert_same_states(worlds, alone)


def test_events_are_views_of_one_array_that_nobody_writes_to_again() -> None:
    worlds, alone = swings(3, sensor=IDEAL)
    (first,) = worlds.step(ticks=4)
    (expected,) = alone.step(ticks=4)
    worlds.step(ticks=4)
    assert [raw(events) for events in first] == expected
    assert len(first) == len(worlds) == 3
    assert first.events.dtype == EVENT_DTYPE
    assert first.offsets.tolist() == [0, *np.cumsum([len(events) for events in first])]
    assert first.counts.tolist() == [len(events) for events in first]
    assert first.counts.sum() == len(first.events) > 0
    assert all(np.shares_memory(first.events, events) for events in first if len(events))
    assert raw(first[-1]) == raw(first[2])
    with pytest.raises(IndexError):
        first[3]


def test_two_makes_of_the_same_worlds_give_the_same_bytes_and_another_seed_others() -> None:
    def seen(seed: int) -> list[list[bytes]]:
        worlds, _ = swings(2, control="random", seed=seed)
        return by_world(worlds.step(ticks=8))

    assert seen(3) == seen(3) != seen(4)


def test_worlds_are_told_by_their_parts() -> None:
    worlds = Worlds(scene_of("swing"), 3, seed=7)
    assert repr(worlds) == "<evs.Worlds: 3 of no camera yet>"
    worlds.add_camera("left", sensor=READ_OUT)
    worlds.add_camera("left", sensor=READ_OUT)
    worlds.add_camera(sensor=READ_OUT, name="eye")
    assert repr(worlds) == "<evs.Worlds: 3 of left, left_2, eye>"
    assert worlds.seeds == (7, 7 + 65536, 7 + 2 * 65536)
    assert evs.Worlds is Worlds


Edit = Any


def colour(model: Any) -> None:
    model.geom("rod").rgba[:] = (0.1, 0.3, 0.1, 1.0)


def invisible(model: Any) -> None:
    model.geom("rod").rgba[3] = 0.0


def optics(model: Any) -> None:
    model.cam("left").fovy[0] = 80.0


def lamp(model: Any) -> None:
    model.light("lamp").diffuse[:] = 0.2


def place(model: Any) -> None:
    model.body("arm").pos[:] = (0.2, 0.0, 0.9)


def gravity(model: Any) -> None:
    model.opt.gravity[:] = (0.0, 0.0, 200.0)


def damping(model: Any) -> None:
    model.dof_damping[:] = 3.0


def inertia(model: Any) -> None:
    model.body("arm").ipos[:] = (0.5, 0.0, 0.1)
    model.body("arm").mass[:] *= 2.0


def sites_place(model: Any) -> None:
    model.site("tip").pos[2] = 0.2


def lamps_place(model: Any) -> None:
    model.light("lamp").pos[:] = (1.0, -1.0, 2.0)


def cameras_place(model: Any) -> None:
    model.cam("left").pos[0] = 0.1


EDITS = (
    *(colour, invisible, optics, lamp, place, sites_place, lamps_place, cameras_place),
    *(gravity, damping, inertia),
)


@pytest.mark.parametrize("edit", EDITS, ids=lambda edit: edit.__name__)
@pytest.mark.parametrize(
    "sensors",
    [None, pytest.param(("rate",), marks=pytest.mark.slow)],
    ids=["unmeasured", "measured"],
)
def test_an_edit_of_the_model_shows_in_every_world(
    edit: Edit, sensors: tuple[str, ...] | None
) -> None:
    worlds, alone = swings(sensor=IDEAL, sensors=sensors)
    kept, _ = swings(sensor=IDEAL)
    step_both(worlds, alone, ticks=3)
    kept.step(ticks=3)
    edit(worlds.model)
    for world in alone.each:
        edit(world.model)
    step_both(worlds, alone, ticks=[5, 0, 5])
    step_both(worlds, alone, ticks=[5, 10, 5])
    assert_same_states(worlds, alone)
    # and it is an edit that shows
    kept.step(ticks=10)
    lights = [one.world(1).cameras[0].luminance.tobytes() for one in (worlds, kept)]
    assert lights[0] != lights[1]


def test_an_edit_that_cannot_be_shown_moves_nothing_until_it_is_undone() -> None:
    worlds, alone = swings(sensor=IDEAL)
    step_both(worlds, alone, ticks=3)
    before = worlds.model.geom_rgba.copy()
    worlds.model.geom("rod").rgba[0] = np.nan
    for _ in range(2):
        with pytest.raises(EvsError, match="rgba of geom 'rod' is nan"):
            worlds.step()
    worlds.model.geom_rgba[:] = before
    assert worlds.t_us.tolist() == [3000] * 3
    step_both(worlds, alone, ticks=5)
    assert_same_states(worlds, alone)


def test_a_comparison_fails_where_worlds_differ_in_one_byte() -> None:
    worlds, alone = swings(3, sensor=IDEAL)
    worlds.world(1).data.qvel[0] *= 1.01
    with pytest.raises(AssertionError):
        step_both(worlds, alone, ticks=12)
    worlds, alone = swings(3, sensor=IDEAL)
    step_both(worlds, alone)
    worlds.world(2).data.qacc_warmstart[:] += 1e-9
    with pytest.raises(AssertionError):
        assert_same_states(worlds, alone)
    events = np.zeros(2, EVENT_DTYPE)
    events.view(np.uint8)[-1] = 1
    assert raw(events) != raw(np.zeros(2, EVENT_DTYPE))
