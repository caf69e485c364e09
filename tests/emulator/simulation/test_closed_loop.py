"""Loop: reset, step, what a controller sees, what is refused."""

from __future__ import annotations

import gc
import types

import mujoco
import numpy as np
import pytest

import evs
from evs.emulator import ClosedLoop, World
from evs.emulator.config import ApsConfig, ImuConfig, ModelConfig, SensorConfig
from evs.msgs import EvsError, Observation
from reference.closed_cart import CART, SMALL, drive, make, wave


@pytest.fixture(scope="module")
def cart():
    return mujoco.MjModel.from_xml_string(CART)


def test_a_step_is_a_tick_of_every_camera_and_of_the_encoders(cart):
    loop = make(cart)
    first, *later = drive(loop, wave(100))
    assert first.t_us == 0
    assert first.packets == first.frames == first.imu == ()
    assert [seen.t_us for seen in later] == list(range(1000, 101_000, 1000))
    for number, seen in enumerate(later):
        assert [packet.camera for packet in seen.packets] == ["left", "right"]
        assert {packet.seq for packet in seen.packets} == {number}
        assert {packet.time_end_us for packet in seen.packets} == {seen.t_us}
        assert seen.done == ""
        assert seen.state is None
    assert sum(len(packet) for seen in later for packet in seen.packets) > 30
    assert (loop.t_us, loop.tick_us, loop.nu) == (100_000, 1000, 2)


def test_the_encoders_are_of_the_decisions_moment_and_not_a_step_old(cart):
    loop = make(cart)
    seen = drive(loop, wave(30))[-1]
    qpos, qvel = loop.world.data.qpos, loop.world.data.qvel
    # gear 10 turns the joint's way into the actuator's
    np.testing.assert_allclose(seen.position, [10 * qpos[0], qpos[1]], rtol=1e-12)
    np.testing.assert_allclose(seen.velocity, [10 * qvel[0], qvel[1]], rtol=1e-12)
    assert abs(qvel[0]) > 0.01


def test_several_ticks_give_what_single_ones_give(cart):
    single, several = make(cart), make(cart)
    drive(single, [])
    drive(several, [])
    for ctrl in ((0.5, 0.0), None, (-0.8, 0.0)):
        ones = [single.step(ctrl)] + [single.step() for _ in range(6)]
        seven = several.step(ctrl, ticks=7)
        packets = tuple(packet for seen in ones for packet in seen.packets)
        assert seven == Observation(7000 * (seven.t_us // 7000), packets, *_ends(ones[-1]))


def _ends(seen):
    return seen.position, seen.velocity


def test_looking_changes_nothing_of_the_motion(cart):
    world = World(cart, control=lambda t_s, _: wave(60)[round(t_s * 1000)])
    for name in ("left", "right"):
        world.add_camera(name, sensor=SMALL)
    loop = make(cart, limits={"tilt": (-9, 9), "speed": (-99, 99), "bump": (-1, 1e9)}, max_s=9)
    seen = drive(loop, wave(60), seed=0, state=True)[1:]
    for (left, right), ours in zip((world.step() for _ in range(60)), seen, strict=True):
        assert [left.events.tobytes(), right.events.tobytes()] == [
            packet.events.tobytes() for packet in ours.packets
        ]
    np.testing.assert_array_equal(world.state, seen[-1].state)


def test_the_same_seed_gives_the_same_bytes_whatever_happened_before(cart):
    loop = make(cart, seed=3)
    first = drive(loop, wave(25), state=True)
    drive(loop, [(9.0, 0.0)] * 17, seed=4, keyframe="leaning")
    again = drive(loop, wave(25), state=True)
    assert again == first
    anew = make(cart, seed=3)
    # a loop that was made with the seed needs none
    assert drive(anew, wave(25), seed=None, state=True) == first
    other = drive(loop, wave(25), seed=4, state=True)
    assert any(a.packets[0].events.tobytes() != b.packets[0].events.tobytes()
               for a, b in zip(other[1:], first[1:], strict=True))  # fmt: skip
    np.testing.assert_array_equal(other[-1].state, first[-1].state)


def test_a_keyframe_and_a_start_of_ones_own(cart):
    loop = make(cart)
    assert loop.reset(keyframe="leaning").position[1] == pytest.approx(0.2)
    assert loop.reset().position[1] == 0.0

    def start(data):
        data.qpos[1] = 0.1

    assert loop.reset(keyframe="leaning", start=start).position[1] == pytest.approx(0.1)
    with pytest.raises(EvsError, match="no keyframe 'leanin'; there is: leaning"):
        loop.reset(keyframe="leanin")


@pytest.mark.parametrize(
    ("ctrl", "says"),
    [
        ([1.0], r"step\(ctrl\) has shape \(1,\), the model has 2 controls: give shape \(2,\)"),
        ([[1.0, 2.0]], r"has shape \(1, 2\)"),
        (3.0, r"has shape \(\)"),
        ([np.nan, 0.0], r"has nan at index 0: controls must be finite"),
        ([0.0, -np.inf], r"has -inf at index 1: controls must be finite"),
        ("fast", "which is not 2 numbers"),
        (["1", None], "has nan at index 1"),
        ([{}, 2], "which is not 2 numbers"),
    ],
)
def test_a_control_that_cannot_be_is_refused_and_nothing_has_moved(cart, ctrl, says):
    loop = make(cart)
    loop.reset(state=True)
    before = loop.step((0.4, 0.0), ticks=3)
    state = loop.world.state
    with pytest.raises(EvsError, match=says) as caught:
        loop.step(ctrl)
    assert "\n" not in str(caught.value)
    assert loop.t_us == before.t_us
    np.testing.assert_array_equal(loop.world.state, state)
    assert loop.step().t_us == before.t_us + 1000


@pytest.mark.parametrize("ticks", [0, -1, 1.5, "2", True, None])
def test_ticks_are_whole_and_at_least_one(cart, ticks):
    loop = make(cart)
    loop.reset()
    with pytest.raises(EvsError, match="ticks is"):
        loop.step(ticks=ticks)
    assert loop.t_us == 0


def test_nothing_moves_before_a_reset(cart):
    loop = make(cart)
    with pytest.raises(EvsError, match="has not begun: call reset first"):
        loop.step()
    assert loop.t_us == 0


@pytest.mark.parametrize(
    ("options", "says"),
    [
        ({"limits": {"tild": (0, 1)}}, "no sensor 'tild'; there is: tilt, "),
        ({"limits": {"tilt": (1, 0)}}, r"limits\['tilt'\] is \(1, 0\); give \(low, high\)"),
        ({"limits": {"tilt": 3}}, r"limits\['tilt'\] is 3; give \(low, high\)"),
        ({"limits": {"tilt": (float("nan"), 1)}}, r"give \(low, high\)"),
        ({"max_s": 0}, "max_s is 0: give simulated seconds over 0"),
        ({"max_s": float("inf")}, "max_s is inf"),
        ({"max_s": "3"}, "max_s is .3.; give a finite number"),
        ({"model": ModelConfig(name="evsnet", chunk=8)}, "model.chunk is 8, .*leave it 1"),
    ],
)
def test_what_makes_no_loop_is_refused_in_one_line(cart, options, says):
    with pytest.raises(EvsError, match=says) as caught:
        make(cart, **options)
    assert "\n" not in str(caught.value)


def test_frames_and_imu_come_along(cart):
    sensor = SensorConfig(
        "davis346", width=40, height=32, aps=ApsConfig(enabled=True, rate_hz=100, exposure_us=2000),
        imu=ImuConfig(enabled=True),
    )  # fmt: skip
    loop = ClosedLoop(cart, "left", sensor=sensor)
    loop.reset(seed=1)
    seen = loop.step(ticks=50)
    assert [frame.seq for frame in seen.frames] == list(range(len(seen.frames)))
    assert 3 <= len(seen.frames) <= 5
    assert all(frame.end_us <= seen.t_us for frame in seen.frames)
    stamps = np.concatenate([packet.samples["t"] for packet in seen.imu])
    assert len(stamps) >= 47
    assert stamps.max() <= seen.t_us


def test_a_loop_goes_around_any_world(cart):
    world = World(cart, control="random", seed=5)
    world.add_camera("left", sensor="dvs128")
    world.add_camera("right", sensor=SMALL)
    loop = ClosedLoop.around(world, max_s=0.01)
    loop.reset()
    seen = loop.step(ticks=99)
    assert seen.done == "0.01 s are over"
    assert [packet.width for packet in seen.packets[:2]] == [128, 40]
    # until a control was given the world's own source acts
    assert np.any(world.data.ctrl)


def test_the_names_of_the_package(cart):
    assert evs.Observation is Observation


WAYS_OUT = (types.ModuleType, types.FunctionType, type)
"""what an object of any program leads to: its class and code, which hold no simulation"""


def reached(root):
    """Everything that can be reached from an object, without its classes and their code."""
    found, todo = {}, [root]
    while todo:
        one = todo.pop()
        if id(one) not in found and not isinstance(one, WAYS_OUT):
            found[id(one)] = one
            todo += gc.get_referents(one)
            if isinstance(one, np.ndarray) and one.base is not None:
                todo.append(one.base)
    return list(found.values())


def test_no_way_leads_from_an_observation_to_the_simulator(cart):
    loop = make(cart, limits={"tilt": (-9, 9)})
    for seen in drive(loop, wave(5), state=True):
        plain = {type(one) for one in reached(seen)}
        strangers = {
            kind
            for kind in plain
            if kind.__module__ not in ("builtins", "numpy", "numpy.dtypes")
            and not kind.__module__.startswith("evs.msgs")
            and kind is not Observation
        }
        # the memory of events is the native core's, and holds nothing else
        assert {kind.__name__ for kind in strangers} <= {"nb_ndarray"}
    assert ClosedLoop in {type(one) for one in reached({"a loop": loop})}


def test_an_observation_is_its_own_copy(cart):
    loop = make(cart)
    loop.reset(seed=2, state=True)
    seen = loop.step((1.0, 0.0), ticks=30)
    alone = Observation(**{
        name: getattr(seen, name) for name in Observation.__dataclass_fields__
    })  # fmt: skip
    bits = [seen.position.copy(), seen.velocity.copy(), seen.state.copy()]
    events = [packet.events.copy() for packet in seen.packets]
    state = loop.world.state
    for array in (seen.position, seen.velocity, seen.state):
        array[:] = 7.0
    np.testing.assert_array_equal(loop.world.state, state)
    seen.position[:], seen.velocity[:], seen.state[:] = bits
    loop.step((-1.0, 0.0), ticks=30)
    assert seen == alone
    for before, packet in zip(events, seen.packets, strict=True):
        np.testing.assert_array_equal(before, packet.events)


def test_a_camera_that_came_later_is_there_after_a_reset(cart):
    loop = make(cart)
    loop.reset()
    loop.world.add_camera("left", sensor=SMALL, name="third")
    with pytest.raises(EvsError, match="another camera since the last reset: call reset"):
        loop.step()
    loop.reset()
    assert [packet.camera for packet in loop.step().packets] == ["left", "right", "third"]


def test_a_start_that_fails_leaves_the_episode_as_it_was(cart):
    def start(data):
        data.qpos[:] = 0.3
        raise EvsError("no")

    loop, other = make(cart), make(cart)
    with pytest.raises(EvsError, match=r"^no$"):
        loop.reset(start=start)
    with pytest.raises(EvsError, match="call reset first"):
        loop.step()
    for one in (loop, other):
        one.reset(seed=1)
        one.step([0.5, 0.0], 3)
    with pytest.raises(EvsError, match=r"^no$"):
        loop.reset(seed=2, state=True, start=start)
    assert loop.save() == other.save()
    seen = loop.step([0.5, 0.0], 5)
    assert seen.state is None
    assert [one.events.tobytes() for one in seen.packets] == [
        one.events.tobytes() for one in other.step([0.5, 0.0], 5).packets
    ]


def test_a_camera_that_came_later_cannot_keep_events_back(cart):
    loop = make(cart)
    loop.world.add_camera("left", sensor=SMALL, model=ModelConfig(name="evsnet", chunk=8))
    with pytest.raises(EvsError, match=r"model.chunk is 8, .*leave it 1"):
        loop.reset()
