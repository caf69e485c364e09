"""Worlds are reset, saved and restored in any part, as World is; bad input is one line."""

from __future__ import annotations

import signal
from collections.abc import Callable, Sequence
from dataclasses import replace
from functools import partial
from typing import Any

import mujoco
import numpy as np
import pytest

from evs.emulator import ClosedLoop, World, Worlds
from evs.emulator.config import ModelConfig, ReadoutConfig, SensorConfig
from evs.emulator.state.blob import pack, unpack
from evs.msgs import EvsError
from reference.worlds_alone import (
    SWING,
    Alone,
    assert_same_states,
    both,
    change_both,
    raw,
    step_both,
)

SMALL = SensorConfig("dvs128", width=40, height=32)
OTHER = replace(SMALL, pos_thres=0.4, cutoff_hz=50.0)


def model() -> mujoco.MjModel:
    return mujoco.MjModel.from_xml_string(SWING)


def moving(count: int = 4, ticks: int = 3, **options: Any) -> tuple[Worlds, Alone]:
    """Worlds that have done some ticks under random controls."""
    options = {"control": "random", **options}
    worlds, alone = both(model(), count, [{"camera": "left", "sensor": SMALL}], **options)
    change_both(worlds, alone, push)
    assert step_both(worlds, alone, ticks=ticks) > 0
    return worlds, alone


def push(number: int, world: World) -> None:
    world.data.qvel[:] = 5.0 + number


def moving_with_slow_link() -> tuple[Worlds, Alone]:
    """Worlds whose cameras still have events to send."""
    slow = replace(SMALL, readout=ReadoutConfig(bandwidth_mevs=0.02, fifo=40, stamp="sent"))
    worlds, alone = both(model(), 3, [{"camera": "left", "sensor": slow}], control="random")
    change_both(worlds, alone, push)
    assert step_both(worlds, alone, ticks=4) > 0
    assert all(worlds.world(number).cameras[0].events_waiting > 0 for number in range(3))
    return worlds, alone


@pytest.mark.parametrize("which", [None, [0], [3, 1], [], np.array([2, 0])], ids=str)
def test_a_reset_of_some_is_that_of_world(which: Any) -> None:
    worlds, alone = moving()
    worlds.reset(worlds=which)
    chosen = range(4) if which is None else [int(number) for number in which]
    for number in chosen:
        alone.each[number].reset()
    assert_same_states(worlds, alone)
    assert worlds.t_us.tolist() == [0 if number in chosen else 3000 for number in range(4)]
    change_both(worlds, alone, push)
    assert step_both(worlds, alone, ticks=5) > 0
    assert_same_states(worlds, alone)


def test_a_reset_repeats_the_episode() -> None:
    worlds, _ = moving(3, ticks=1)
    worlds.reset(start=lambda number, data: data.qvel.fill(5.0 + number))
    first = [raw(events) for events in worlds.step(ticks=6)[0]]
    worlds.reset(worlds=[1], start=lambda number, data: data.qvel.fill(5.0 + number))
    (again,) = worlds.step(ticks=6)
    assert raw(again[1]) == first[1] != b""
    assert raw(again[0]) != first[0]


@pytest.mark.parametrize(
    ("seed", "which", "expected"),
    [
        (9, None, (9, 9 + 65536, 9 + 2 * 65536)),
        (np.int64(9), [2], (0, 65536, 9 + 2 * 65536)),
        (-5, [0], (-5, 65536, 2 * 65536)),
        ([7, 8], [2, 0], (8, 65536, 7)),
        (np.array([4, 5, 6]), None, (4, 5, 6)),
        ([2**80], [1], (0, 2**80, 2 * 65536)),
        (None, None, (0, 65536, 2 * 65536)),
    ],
    ids=str,
)
def test_seeds_of_a_reset(seed: Any, which: Any, expected: tuple[int, ...]) -> None:
    worlds, alone = moving(3)
    worlds.reset(seed, which)
    assert worlds.seeds == expected
    for number in range(3) if which is None else which:
        alone.each[number].reset(expected[number])
    assert_same_states(worlds, alone)
    step_both(worlds, alone, ticks=5)
    # as a world that is made with this seed
    number = 0 if which is None else which[0]
    fresh = World(model(), control="random", seed=expected[number])
    fresh.add_camera("left", sensor=SMALL)
    for _ in range(5):
        fresh.step()
    assert worlds.save([number]) == [fresh.save()]


def test_keyframes_and_starts_of_a_reset() -> None:
    worlds, alone = moving()
    worlds.reset(worlds=[1, 3], keyframe="up")
    for number in (1, 3):
        alone.each[number].reset(keyframe="up")
    assert [float(worlds.world(number).data.qpos[0]) for number in (1, 3)] == [-1.0, -1.0]
    step_both(worlds, alone, ticks=3)

    given: list[tuple[int, float]] = []

    def start(number: int, data: Any) -> None:
        given.append((number, float(data.qpos[0])))
        data.qpos[0], data.qvel[0] = 0.1 * number, 3.0 * number

    worlds.reset(worlds=[2, 0], keyframe="none", start=start)
    assert given == [(2, 0.0), (0, 0.0)]
    for number in (2, 0):
        alone.each[number].reset(keyframe="none")
        start(number, alone.each[number].data)
    assert step_both(worlds, alone, ticks=5) > 0
    assert_same_states(worlds, alone)


def test_a_reset_exchanges_the_sensor_of_some() -> None:
    worlds, alone = moving()
    worlds.reset(worlds=[0, 2], sensor=OTHER)
    for number in (0, 2):
        alone.each[number].reset(sensor=OTHER)
    assert [worlds.world(number).cameras[0].sensor.pos_thres for number in (0, 2)] == [0.4, 0.4]
    change_both(worlds, alone, push)
    assert step_both(worlds, alone, ticks=8) > 0
    assert_same_states(worlds, alone)
    # the next reset keeps it
    worlds.reset(5, [0])
    alone.each[0].reset(5)
    step_both(worlds, alone, ticks=5)
    assert_same_states(worlds, alone)


@pytest.mark.parametrize("compress", [False, True])
@pytest.mark.parametrize("which", [None, [2], [3, 0]], ids=str)
def test_saved_states_are_those_of_world(which: Any, compress: bool) -> None:
    worlds, alone = moving()
    chosen = range(4) if which is None else which
    blobs = worlds.save(which, compress)
    assert blobs == [alone.each[number].save(compress) for number in chosen]
    step_both(worlds, alone, ticks=4)
    after = worlds.save()
    worlds.restore(blobs, which)
    for number, blob in zip(chosen, blobs, strict=True):
        alone.each[number].restore(blob)
    assert_same_states(worlds, alone)
    assert worlds.save() != after
    step_both(worlds, alone, ticks=4)
    # those that went back have done the same again
    assert [worlds.save()[number] for number in chosen] == [after[number] for number in chosen]


def test_states_go_from_worlds_to_worlds_and_to_world_and_back() -> None:
    worlds, alone = moving(3)
    blobs = worlds.save()
    world = World(model(), control="random", seed=99)
    world.add_camera("left", sensor=SMALL)
    world.restore(blobs[2])
    others, _ = moving(5, threads=1)
    others.restore([*blobs, world.save()], [4, 3, 2, 0])
    (expected,) = alone.step(ticks=5)
    (seen,) = others.step(ticks=5)
    assert [raw(seen[number]) for number in (4, 3, 2, 0)] == [*expected, expected[2]]
    assert b"".join(raw(world.step()[0].events) for _ in range(5)) == expected[2] != b""
    assert others.seeds == (worlds.seeds[2], 65536, *worlds.seeds[::-1])
    back = [alone.each[number].save() for number in (1, 0)]
    worlds.restore(back, [0, 2])
    assert worlds.save([0, 2]) == back


def test_what_waits_in_a_readout_is_sent_by_who_goes_on() -> None:
    worlds, alone = moving_with_slow_link()
    assert_same_states(worlds, alone)
    step_both(worlds, alone, ticks=[2, 0, 1])
    saved = worlds.save()
    assert step_both(worlds, alone, ticks=2) > 0
    worlds.restore(saved)
    for world, state in zip(alone.each, saved, strict=True):
        world.restore(state)
    assert step_both(worlds, alone, ticks=3) > 0
    assert_same_states(worlds, alone)


def test_controls_that_were_given_are_saved() -> None:
    worlds, alone = moving(2, control="zero")
    step_both(worlds, alone, [[0.5], [-0.5]])
    blobs = worlds.save()
    step_both(worlds, alone, [[0.0], [0.0]], ticks=3)
    worlds.restore(blobs[::-1])
    for world, blob in zip(alone.each, blobs[::-1], strict=True):
        world.restore(blob)
    step_both(worlds, alone, ticks=4)
    assert [worlds.world(number).data.ctrl[0] for number in (0, 1)] == [-0.5, 0.5]
    assert_same_states(worlds, alone)


@pytest.mark.parametrize("begin", ["reset", "restore"])
def test_edited_vertices_show_in_every_world(begin: str) -> None:
    mesh = """<asset><mesh name="wedge" vertex="0 0 0  .5 0 0  0 .5 0  0 0 .5"/></asset>"""
    xml = SWING.replace("<worldbody>", f"{mesh}<worldbody>").replace(
        "<body ", '<geom type="mesh" mesh="wedge" pos="0 0 .3"/><body '
    )
    scene = mujoco.MjModel.from_xml_string(xml)
    worlds, alone = both(scene, 3, [{"camera": "left", "sensor": SMALL}])
    step_both(worlds, alone, ticks=2)
    light = worlds.world(2).cameras[0].luminance.tobytes()
    for one in (worlds.model, *(world.model for world in alone.each)):
        one.mesh_vert[:] *= 0.5
    if begin == "restore":
        # a state belongs to the model as it is when it is saved
        worlds.restore(worlds.save())
        for world in alone.each:
            world.restore(world.save())
    else:
        worlds.reset()
        for world in alone.each:
            world.reset()
    step_both(worlds, alone, ticks=3)
    assert_same_states(worlds, alone)
    assert worlds.world(2).cameras[0].luminance.tobytes() != light


@pytest.mark.parametrize("chosen", [0, 1, 2])
def test_edited_texels_show_in_worlds_that_were_not_reset(chosen: int) -> None:
    """A reset of one world compares all of the model, which the others share."""
    checked = """<asset><texture name="tiles" type="2d" builtin="checker" rgb1="1 1 1" rgb2="0 0 0"
        width="32" height="32"/><material name="floor" texture="tiles"/></asset><worldbody>"""
    xml = SWING.replace("<worldbody>", checked).replace('rgba=".3 .3 .3 1"', 'material="floor"')
    worlds = Worlds(mujoco.MjModel.from_xml_string(xml), 3, threads=1, control="zero")
    worlds.add_camera("left", sensor=SMALL)
    worlds.step(ticks=3)
    worlds.model.tex_data[:] = 255 - worlds.model.tex_data
    worlds.reset(worlds=[chosen])
    (seen,) = worlds.step(ticks=1)
    others = [number for number in range(3) if number != chosen]
    assert (seen.counts[others] > 500).all()


def test_a_world_that_somebody_looks_at_hides_no_edit_from_the_others() -> None:
    worlds, alone = moving(3)
    for one in (worlds.model, *(world.model for world in alone.each)):
        one.geom("rod").rgba[:] = (0.1, 0.2, 0.1, 1.0)
    view = worlds.world(1).add_view("left", sensor=SMALL)
    assert view.render()[0].shape == (32, 40)
    step_both(worlds, alone, ticks=3)
    assert_same_states(worlds, alone)


@pytest.mark.parametrize("sensors", [("angle", "gyro", "force", "energy", "tip"), ("angle",)])
def test_measurements_are_those_of_the_closed_loop(sensors: tuple[str, ...]) -> None:
    more = """<accelerometer name="force" site="tip"/><gyro name="gyro" site="tip"/>
        <e_kinetic name="energy"/><framepos name="tip" objtype="site" objname="tip"/></sensor>"""
    scene = mujoco.MjModel.from_xml_string(SWING.replace("</sensor>", more))
    worlds = Worlds(scene, 3, sensors=sensors, seed=3)
    worlds.add_camera("left", sensor=SMALL)
    loops = [ClosedLoop(scene, "left", sensor=SMALL, seed=seed) for seed in worlds.seeds]
    kept = dict.fromkeys(sensors, (-np.inf, np.inf))
    watched = [ClosedLoop(scene, "left", sensor=SMALL, limits=kept) for _ in loops]
    controls = [[0.3], [-0.3], [0.9]]

    def start(number: int, data: Any) -> None:
        data.qvel[0] = 3.0 + number

    worlds.reset(start=start)
    for number in range(3):
        for loop in (loops[number], watched[number]):
            loop.reset(start=partial(start, number))
    for ticks in (0, 1, 4):
        if ticks:
            worlds.step(controls, ticks=ticks)
        for number, (loop, other) in enumerate(zip(loops, watched, strict=True)):
            seen = loop.step(controls[number], ticks=ticks) if ticks else None
            if ticks:
                other.step(controls[number], ticks=ticks)
            if seen is not None:
                assert worlds.position[number].tobytes() == seen.position.tobytes()
                assert worlds.velocity[number].tobytes() == seen.velocity.tobytes()
            for name, values in other._encoders.values.items():
                assert worlds.readings[name][number].tobytes() == values.tobytes(), (ticks, name)
    assert [*worlds.readings] == [*sensors]
    assert worlds.position.shape == worlds.velocity.shape == (3, 1)
    # copies
    worlds.position[:], worlds.readings["angle"][:] = 7.0, 7.0
    assert not (worlds.position == 7.0).any()
    assert not (worlds.readings["angle"] == 7.0).any()


BAD_STEPS: dict[str, tuple[dict[str, Any], str]] = {
    "no tick": ({"ticks": 0}, "ticks is 0: a step is one tick or more"),
    "no tick at all": ({"ticks": [0, 0]}, r"ticks is \[0, 0\]: a step"),
    "back": ({"ticks": -1}, "ticks is -1: a step"),
    "one back": ({"ticks": [1, -1]}, "a step is one tick or more"),
    "half a tick": ({"ticks": 0.5}, "ticks is 0.5: give a whole number, or one for each world"),
    "too many numbers": ({"ticks": [1, 1, 1]}, "give a whole number, or one for each world"),
    "a truth": ({"ticks": True}, "ticks is True: give a whole number"),
    "ragged ticks": ({"ticks": [[1], [1, 2]]}, "ticks"),
    "one row": ({"ctrl": [0.0]}, r"shape \(1,\): give \(2, 1\), a row for each world"),
    "a row too many": ({"ctrl": [[0.0]] * 3}, r"shape \(3, 1\)"),
    "not a number": ({"ctrl": [[0.0], [np.nan]]}, "not finite, for world 1"),
    "infinite": ({"ctrl": [[-np.inf], [0.0]]}, "not finite, for world 0"),
    "words": ({"ctrl": "left"}, "ctrl"),
    "ragged controls": ({"ctrl": [[0.0], [0.0, 1.0]]}, "ctrl"),
}


def refused(act: Callable[[], Any], match: str) -> None:
    """One line of EvsError."""
    with pytest.raises(EvsError, match=match) as caught:
        act()
    assert "\n" not in str(caught.value)


@pytest.fixture(scope="module")
def pair() -> Worlds:
    """Two worlds, 2 ms old, that no bad input changes."""
    worlds = Worlds(model(), 2)
    worlds.add_camera("left", sensor=SMALL)
    worlds.step(ticks=2)
    return worlds


@pytest.mark.parametrize("name", BAD_STEPS)
def test_a_bad_step_moves_no_world(name: str, pair: Worlds) -> None:
    arguments, match = BAD_STEPS[name]
    before = pair.save()
    refused(lambda: pair.step(**arguments), match)
    assert pair.save() == before


def test_more_ticks_than_a_clock_counts_are_refused() -> None:
    worlds = Worlds(model(), 2)
    worlds.add_camera("left", sensor=SMALL)

    def too_long(*_: Any) -> None:
        raise TimeoutError

    before = signal.signal(signal.SIGALRM, too_long)
    # a step that begins is not over this year
    signal.setitimer(signal.ITIMER_REAL, 1.0)
    try:
        refused(lambda: worlds.step(ticks=2**63), "ticks is 9223372036854775808")
    finally:
        signal.setitimer(signal.ITIMER_REAL, 0.0)
        signal.signal(signal.SIGALRM, before)


BAD_RESETS: dict[str, tuple[dict[str, Any], str]] = {
    "half a seed": ({"seed": 1.5}, "seed is 1.5"),
    "a word": ({"seed": ["one", 2]}, "seed is 'one'; give a whole number"),
    "a truth": ({"seed": True}, "seed is True"),
    "too few seeds": ({"seed": [1]}, "1 seeds for 2 worlds: give one for each"),
    "no such world": ({"worlds": [0, 2]}, r"there is no world 2: they are 0 \.\.\. 1"),
    "one from behind": ({"worlds": [-1]}, "there is no world -1"),
    "twice": ({"worlds": [1, 1]}, "worlds names a world twice"),
    "a mask": ({"worlds": np.array([True, False])}, "worlds is .*True.*; give a whole number"),
    "a number": ({"worlds": 1}, "worlds is 1"),
    "no such keyframe": ({"keyframe": "down"}, "no keyframe 'down'; there is: up"),
    "another size": ({"sensor": "davis346"}, "346 x 260 px for a camera of 40 x 32"),
    "no sensor": ({"sensor": 3}, "sensor= takes a name or a SensorConfig, not 3"),
}


@pytest.mark.parametrize("name", BAD_RESETS)
def test_a_bad_reset_changes_no_world(name: str, pair: Worlds) -> None:
    arguments, match = BAD_RESETS[name]
    before = pair.save()
    refused(lambda: pair.reset(**arguments), match)
    assert pair.save() == before


def damaged(blob: bytes) -> bytes:
    return blob[:-9] + bytes([blob[-9] ^ 1]) + blob[-8:]


@pytest.mark.parametrize(
    ("spoil", "which", "match"),
    [
        (lambda blobs: blobs[:1], None, "1 states for 2 worlds: give one for each"),
        (lambda blobs: blobs, [0], "2 states for 1 worlds"),
        (lambda blobs: blobs, [0, 2], "there is no world 2"),
        (lambda blobs: [b"", blobs[1]], None, "no saved state of evs"),
        (lambda blobs: [damaged(blobs[0]), blobs[1]], None, "damaged"),
        (lambda blobs: [3, blobs[1]], None, "a saved state is bytes, not int"),
    ],
)
def test_bad_states_change_no_world(
    spoil: Callable[[list[bytes]], Sequence[Any]], which: Any, match: str, pair: Worlds
) -> None:
    before = pair.save()
    refused(lambda: pair.restore(spoil(before), which), match)
    assert pair.save() == before


def test_worlds_before_a_damaged_state_are_not_restored(pair: Worlds) -> None:
    before = pair.save()
    pair.step()
    after = pair.save()
    refused(lambda: pair.restore([before[0], damaged(before[1])]), "damaged")
    assert pair.save() == after
    pair.restore(before)


@pytest.mark.parametrize(
    ("name", "spoil", "match"),
    [
        ("waiting", lambda waiting: waiting + 255, "an event is not on the sensor"),
        ("clock", lambda clock: clock + 1000 * (np.arange(24) == 12), "of a sensor with more rows"),
        ("t_us", lambda t_us: t_us - 1, "us does not follow the last, which ended at"),
    ],
)
def test_a_readout_that_cannot_go_on_is_one_line(
    name: str, spoil: Callable[[Any], Any], match: str
) -> None:
    worlds, _ = moving_with_slow_link()
    about, arrays = unpack(worlds.save([1])[0])
    place = f"cameras.0.pixels.readout.{name}"
    assert arrays[place].any()
    worlds.restore([pack(about, {**arrays, place: spoil(arrays[place])})], [1])
    refused(worlds.step, match)


BAD_WORLDS: dict[str, tuple[dict[str, Any], str]] = {
    "none": ({"count": 0}, r"count is 0: give 1 \.\.\. 65536 worlds"),
    "too many": ({"count": 65537}, "count is 65537"),
    "a half": ({"count": 1.5}, "count is 1.5; give a whole number"),
    "a truth": ({"count": True}, "count is True"),
    "threads": ({"threads": -1}, "threads is -1; give 0 for one per core, or more"),
    "no seed": ({"seed": "a"}, "seed is 'a'"),
    "no sensor": ({"sensors": ["tilt"]}, "no sensor 'tilt'; there is: "),
    "no limit": ({"limits": {"tilt": (0, 1)}}, "no sensor 'tilt'"),
    "no range": ({"limits": {"angle": (1, 0)}}, r"limits\['angle'\] is \(1, 0\); give \(low, high"),
    "no tick": ({"tick_us": 0}, "scene.tick_us is 0"),
    "no control": ({"control": "mind"}, "no control 'mind'"),
}


@pytest.mark.parametrize("name", BAD_WORLDS)
def test_worlds_that_cannot_be_made(name: str) -> None:
    arguments, match = BAD_WORLDS[name]
    refused(lambda: Worlds(**{"scene": model(), "count": 2, **arguments}), match)


def test_a_camera_that_cannot_be_added_is_in_no_world(pair: Worlds) -> None:
    refused(lambda: pair.add_camera("up", sensor=SMALL), "no camera 'up'; there is: left, right")
    refused(
        lambda: pair.add_camera("right", sensor=SMALL, model=ModelConfig(chunk=4)),
        "model.chunk is 4, but worlds are seen tick by tick: leave it 1",
    )
    assert pair.cameras == ("left",)
    assert len(pair.world(1).cameras) == 1


def test_nothing_is_measured_unasked(pair: Worlds) -> None:
    for name in ("position", "velocity", "readings"):
        refused(lambda name=name: getattr(pair, name), "nothing is measured: make the worlds with")


def test_what_is_not_measured_has_no_readings_but_encoders() -> None:
    worlds = Worlds(model(), 2, sensors=())
    assert worlds.readings == {}
    assert worlds.position.shape == (2, 1)
