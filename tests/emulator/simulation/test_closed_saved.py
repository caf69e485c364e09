"""Saved states: bytes that are checked, all or nothing, and say where they belong."""

from __future__ import annotations

import json
import struct
import zlib

import mujoco
import numpy as np
import pytest

from evs.emulator import ClosedLoop, World
from evs.emulator.config import ModelConfig, RenderConfig, SensorConfig
from evs.emulator.config.schema import DelayConfig
from evs.emulator.state import pack, unpack
from evs.msgs import EvsError
from reference.worlds_alone import SWING

SMALL = SensorConfig(preset="dvs128", width=32, height=24)


def a_world(xml=SWING, sensor=SMALL, names=("left", "right"), **options):
    world = World(mujoco.MjModel.from_xml_string(xml), **options)
    for name in names:
        world.add_camera(name, sensor=sensor)
    return world


def a_loop(**options):
    model = mujoco.MjModel.from_xml_string(SWING)
    return ClosedLoop(model, ("left", "right"), sensor=SMALL, limits={"angle": (-2, 2)}, **options)


@pytest.fixture(scope="module")
def blob():
    loop = a_loop(delays=DelayConfig(transport_us=3000, control_us=2000))
    loop.reset(seed=5)
    for tick in range(12):
        loop.step([np.sin(tick)])
    return loop.save()


def same_loop():
    return a_loop(delays=DelayConfig(transport_us=3000, control_us=2000))


ARRAYS = {
    "numbers": np.arange(12, dtype=np.int64).reshape(3, 4),
    "nothing": np.zeros((0, 7), np.float32),
    "one": np.full((90, 80), np.nan),
    "sparse": np.where(np.arange(9000) % 700 == 0, 3, 0),
    "noise": np.random.default_rng(1).normal(size=(50, 50)),
    "scalar": np.array(-3, np.int64),
    "word": np.array("straße"),
    "big-endian": np.arange(5, dtype=">f8"),
    "turned": np.arange(20, dtype=np.uint16).reshape(4, 5).T,
    "bytes": np.frombuffer(b"abc", np.uint8),
}


@pytest.mark.parametrize("compress", [False, True])
def test_arrays_come_back_as_they_were(compress):
    packed = pack({"kind": "test", "n": [1, 2.5, None, True]}, ARRAYS, compress)
    about, arrays = unpack(packed)
    assert about == {"kind": "test", "n": [1, 2.5, None, True]}
    assert list(arrays) == list(ARRAYS)
    for name, array in ARRAYS.items():
        assert arrays[name].shape == array.shape
        assert arrays[name].dtype == array.dtype.newbyteorder("<")
        np.testing.assert_array_equal(arrays[name], array)
        assert arrays[name].flags.writeable
    for view in (bytearray(packed), memoryview(packed)):
        np.testing.assert_array_equal(unpack(view)[1]["noise"], ARRAYS["noise"])
    raw = sum(array.nbytes for array in ARRAYS.values())
    # what is one value, or nearly, costs nearly nothing
    assert len(packed) < raw - 90 * 80 * 8 - 9000 * 8 * 0.9


def signed(head, body=b""):
    """A blob of this head with a right checksum."""
    packed = zlib.compress(head if isinstance(head, bytes) else json.dumps(head).encode())
    rest = struct.pack("<I", len(packed)) + packed + body
    return b"evs save" + struct.pack("<II", 1, zlib.crc32(rest)) + rest


@pytest.mark.parametrize(
    "head",
    [
        b"[",
        b"[" * 100_000,
        b"\xff\xfe",
        {"about": {}},
        {"about": [], "arrays": []},
        {"about": {}, "arrays": {}},
        {"about": {}, "arrays": [["a", "<f8", [1], "raw"]]},
        {"about": {}, "arrays": [["a", "|O", [1], "raw", 8]]},
        {"about": {}, "arrays": [["a", "<f8", [-1], "raw", 8]]},
        {"about": {}, "arrays": [["a", "<f8", [True], "raw", 8]]},
        {"about": {}, "arrays": [["a", "<f8", [2.0], "raw", 16]]},
        {"about": {}, "arrays": [["a", "<f8", [2], "raw", 8]]},
        {"about": {}, "arrays": [["a", "<f8", [2], "pickle", 8]]},
        {"about": {}, "arrays": [["a", "<f8", [2**30, 2**30], "one", 8]]},
        {"about": {}, "arrays": [["a", "<f8", [1] * 99, "one", 8]]},
        {"about": {}, "arrays": [["a", "<f8", [1], "deflate", 8]]},
        {"about": {}, "arrays": [["a", "<f8", [1], "raw", 8], ["a", "<f8", [0], "raw", 0]]},
        {"about": {}, "arrays": [["a", "<U2", [1], "raw", 8]]},
        {"about": {}, "arrays": []},
    ],
)
def test_a_head_that_lies_is_refused_whatever_its_checksum(head):
    with pytest.raises(EvsError, match="saved state is damaged") as caught:
        unpack(signed(head, b"\xff" * 8))
    assert "\n" not in str(caught.value)


def test_a_bomb_is_not_inflated():
    bomb = zlib.compress(b"\0" * 50_000_000, 9)
    rows = {"about": {}, "arrays": [["a", "<f8", [10], "deflate", len(bomb)]]}
    with pytest.raises(EvsError, match="cannot be inflated"):
        unpack(signed(rows, bomb))
    with pytest.raises(EvsError, match="header cannot be read"):
        unpack(signed(b"[" + b" " * 50_000_000))


@pytest.mark.parametrize(
    ("other", "says"),
    [
        (lambda: a_world(SWING.replace('gear="2"', 'gear="3"')), r"another model \(\w{16}, not \w"),
        (lambda: a_world(tick_us=2000), r"scene\.tick_us was 1000, here it is 2000"),
        (lambda: a_world(names=("left",)), r"cameras was \['left', 'right'\], here .*'left'\];"),
        (lambda: a_world(names=("right", "left")), r"cameras\.0 was left, here it is right"),
        (lambda: a_world(sensor="dvs128"), r"camera\.left\.sensor\.width was 32, here it is 128"),
        (lambda: a_world(control="random"), r"scene\.control was auto, here it is random"),
    ],
)  # fmt: skip
def test_what_differs_is_said_and_nothing_has_changed(other, says):
    saved = a_world().save()
    world = other()
    world.step([0.5])
    before = world.save()
    with pytest.raises(EvsError, match=says) as caught:
        world.restore(saved)
    assert "\n" not in str(caught.value)
    assert world.save() == before


def test_loops_differ_by_limits_delays_and_ends(blob):
    for other, says in (
        (a_loop(), r"loop\.delays\.transport_us was 3000, here it is 0"),
        (a_loop(delays=DelayConfig(3000, control_us=2000), max_s=3.0), r"loop\.max_s was None"),
    ):
        other.reset()
        with pytest.raises(EvsError, match=says):
            other.restore(blob)
        assert other.t_us == 0
        assert other.step().t_us == 1000


def test_seed_threads_and_instruction_set_may_differ():
    def one(seed, threads, isa, incremental):
        world = World(mujoco.MjModel.from_xml_string(SWING), seed=seed, threads=threads)
        render = RenderConfig(isa=isa, incremental=incremental)
        camera = world.add_camera("left", sensor=SMALL, render=render)
        return world, camera

    (world, _), (other, camera) = one(3, 1, "auto", True), one(9, 2, "portable", False)
    for _ in range(30):
        world.step([1.0])
    other.restore(world.save())
    assert camera.info.seed == camera.info.config["seed"] == other.seed == 3
    for _ in range(40):
        (ours,), (theirs,) = world.step(), other.step()
        assert ours.seq == theirs.seq
        np.testing.assert_array_equal(ours.events, theirs.events)
    # and so it is after a reset
    assert other.reset() is None
    assert world.reset() is None
    for _ in range(40):
        (ours,), (theirs,) = world.step([1.0]), other.step([1.0])
        np.testing.assert_array_equal(ours.events, theirs.events)


def test_a_state_from_before_the_first_tick_and_of_a_world_without_controls():
    still = SWING.replace('<motor joint="swing" gear="2" ctrlrange="-1 1"/>', "")
    one, other = a_world(still), a_world(still)
    other.step()
    other.restore(one.save())
    assert other.t_us == 0
    for _ in range(30):
        for ours, theirs in zip(one.step(), other.step(), strict=True):
            np.testing.assert_array_equal(ours.events, theirs.events)


def test_a_loop_is_saved_after_a_reset_only_and_done_stays_done():
    loop = a_loop()
    with pytest.raises(EvsError, match="call reset before save"):
        loop.save()
    loop.reset()
    while not loop.done:
        loop.step([3.0])
    other = a_loop()
    seen = other.restore(loop.save())
    assert seen.done == other.done == "angle left -2 ... 2"
    with pytest.raises(EvsError, match="the episode is over"):
        other.step()
    # what was not asked for at reset is not there afterwards
    assert seen.state is None


def test_observations_carry_the_state_again_where_they_did():
    loop = a_loop()
    loop.reset(state=True)
    loop.step([1.0])
    np.testing.assert_array_equal(a_loop().restore(loop.save()).state, loop.world.state)


def test_the_first_look_of_a_view_follows_the_state():
    one, other = a_world(), a_world()
    for _ in range(9):
        one.step([2.0])
    view = other.add_view("left", sensor=SMALL)
    other.restore(one.save())
    assert view.t_us == 9000
    np.testing.assert_array_equal(view.render()[0], one.cameras[0].luminance)


def test_a_network_is_known_by_its_weights():
    def one(name):
        world = World(mujoco.MjModel.from_xml_string(SWING))
        model = ModelConfig(name="evsnet", network=name)
        world.add_camera("left", sensor=SMALL, model=model)
        return world

    saved = one("evsnet_c8").save()
    with pytest.raises(EvsError, match=r"camera\.left\.model\.network was evsnet_c8, here"):
        one("evsnet_c4").restore(saved)


def test_a_loop_whose_world_got_a_camera_since_takes_the_blob_of_its_like():
    loops = [ClosedLoop.around(a_world(names=("left",))) for _ in range(2)]
    for loop in loops:
        loop.world.add_camera("right", sensor=SMALL)
    loops[0].reset(seed=3)
    loops[0].step([0.2], ticks=5)
    # not reset since
    loops[1].restore(loops[0].save())
    assert loops[1].step([0.2], ticks=3) == loops[0].step([0.2], ticks=3)
