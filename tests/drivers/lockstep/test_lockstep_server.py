"""The lock-step server: the loop over the wire is the loop in process, and nothing upsets it."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from lockstep_stand_in import Later, StandIn, answered, raw_client, serving

from evs.drivers.clock import monotonic_s, sleep_s
from evs.drivers.lockstep import LockstepServer, RemoteLoop, connect
from evs.msgs import EvsError, Observation
from evs.msgs.lockstep import Join, Reset, Save, encode_request


def both(address: str, **options: Any) -> tuple[RemoteLoop, RemoteLoop]:
    one = connect(address, "one", actuators=("tilt",), **options)
    return one, connect(address, "two", actuators=("slide",), **options)


@contextmanager
def waits_only(server: LockstepServer, seconds: float) -> Iterator[None]:
    """Meanwhile it is impatient: before and after it a slow machine has its time."""
    before, server._timeout_s = server._timeout_s, seconds
    try:
        yield
    finally:
        server._timeout_s = before


@pytest.mark.parametrize("kind", ["tcp", "ipc"])
def test_over_the_wire_it_is_the_loop_in_process(kind: str, tmp_path: Path) -> None:
    here = StandIn(cameras=("left", "right"))
    here.last_tick = 40
    there = StandIn(cameras=("left", "right"))
    there.last_tick = 40
    address = "tcp://127.0.0.1:0" if kind == "tcp" else f"ipc://{tmp_path}/loop"
    random = np.random.default_rng(0)
    with serving(there, address=address) as server, connect(server.address) as loop:
        assert loop.actuators == ("tilt", "slide")
        assert loop.nu == 2
        assert loop.tick_us == 1000
        assert [one.camera for one in loop.cameras] == ["left", "right"]
        assert (loop.cameras[0].width, loop.cameras[0].height) == (64, 48)
        assert np.array_equal(loop.ctrl_range, here.ctrl_range)
        assert loop.reset(5, "home", True) == here.reset(5, "home", True)
        seen, steps = here.step(), 0
        assert loop.step() == seen
        while not seen.done:
            ctrl = None if steps % 3 == 0 else random.normal(size=2)
            ticks = 1 + steps % 4
            seen = here.step(ctrl, ticks)
            assert loop.step(ctrl, ticks) == seen
            assert loop.done == seen.done
            assert loop.t_us == seen.t_us
            steps += 1
    assert steps > 10
    assert there.log == here.log
    assert server.counts["steps"] == steps + 1
    assert server.counts["episodes"] == 1
    assert server.waits.total == steps + 1


def test_state_is_there_only_for_who_asked() -> None:
    with serving(StandIn(), controllers=2) as server:
        one, two = both(server.address)
        with one, two:
            later = Later(lambda: one.reset(state=True))
            assert two.reset().state is None
            assert later.get().state is not None
            later = Later(one.step)
            assert two.step().state is None
            assert np.array_equal(later.get().state, [1, 0, 0])
            later = Later(one.reset)
            two.reset()
            assert later.get().state is None


def test_each_sees_the_cameras_it_wants_in_its_order() -> None:
    loop = StandIn(cameras=("a", "b", "c"))
    with serving(loop) as server, connect(server.address, cameras=("c", "a")) as client:
        assert [one.camera for one in client.cameras] == ["c", "a"]
        client.reset()
        assert [packet.camera for packet in client.step().packets] == ["a", "c"]
    with serving(loop) as server, connect(server.address, cameras=()) as client:
        client.reset()
        assert client.step().packets == ()


def test_nothing_moves_until_everybody_has_decided() -> None:
    loop = StandIn()
    with serving(loop, controllers=2) as server:
        one, two = both(server.address)
        with one, two:
            reset = Later(lambda: one.reset(7))
            sleep_s(0.2)
            assert reset.waits
            assert loop.log == []
            two.reset(7)
            reset.get()
            step = Later(lambda: one.step([0.5]))
            sleep_s(0.2)
            assert step.waits
            assert loop.log == [("reset", 7, "")]
            second = two.step([-0.25])
            first = step.get()
    assert loop.log[1:] == [("step", (0.5, -0.25), 1)]
    # each has its own encoders, and the same events
    assert (first.position, second.position) == ([0.5], [-0.25])
    assert first.t_us == second.t_us == 1000
    assert first.packets[0].events.tobytes() == second.packets[0].events.tobytes()


def test_who_keeps_keeps_its_own_actuators() -> None:
    loop = StandIn()
    with serving(loop, controllers=2) as server:
        one, two = both(server.address)
        with one, two:
            for first, second in (([1.0], [2.0]), (None, [3.0]), (None, None), ([4.0], None)):
                action = one.reset if not loop.log else (lambda: None)
                if not loop.log:
                    later = Later(action)
                    two.reset()
                    later.get()
                later = Later(lambda ctrl=first: one.step(ctrl))
                two.step(second)
                later.get()
    given = [entry[1] for entry in loop.log[1:]]
    assert given == [(1.0, 2.0), (1.0, 3.0), (1.0, 3.0), (4.0, 3.0)]


def test_an_order_of_ones_own() -> None:
    loop = StandIn(("a", "b", "c"))
    with serving(loop) as server, connect(server.address, actuators=("c", "a")) as client:
        client.reset()
        seen = client.step([1.0, 2.0])
    assert loop.log[-1] == ("step", (2.0, 0.0, 1.0), 1)
    assert seen.position.tolist() == [1.0, 2.0]


@pytest.mark.parametrize(
    ("ask", "says"),
    [
        (lambda loop: loop.step(ticks=2), "a step of 1 tick and 'two' for a step of 2 ticks"),
        (lambda loop: loop.reset(), "a step of 1 tick and 'two' for a reset"),
        (lambda loop: loop.restore(b"x"), "and 'two' for a restore of 1 bytes"),
    ],
)
def test_who_asks_for_something_else_is_refused(ask: Callable[[Any], Any], says: str) -> None:
    loop = StandIn()
    with serving(loop, controllers=2) as server:
        one, two = both(server.address)
        with one, two:
            later = Later(one.reset)
            two.reset()
            later.get()
            later = Later(one.step)
            while server._barrier.since_s is None:
                sleep_s(0.01)
            with pytest.raises(EvsError, match=says):
                ask(two)
            assert later.waits
            assert loop.log == [("reset", None, "")]
            # it may think again
            two.step()
            assert later.get().t_us == 1000


def test_a_new_request_withdraws_the_one_before() -> None:
    loop = StandIn()
    with serving(loop, controllers=2, timeout_s=60) as server:
        two = connect(server.address, "two", actuators=("slide",))
        with two, raw_client(server.address) as raw:
            answered(raw, encode_request(1, Join("one", ("tilt",))))
            raw.send_multipart(encode_request(2, Reset(1)))
            # it takes its reset back by asking for something else, and decides nothing
            assert answered(raw, encode_request(3, Save()))["number"] == 3
            with waits_only(server, 0.2):
                sleep_s(0.5)
            assert loop.log == []
            # so nobody has kept anybody waiting
            assert server._clients.names == "'two', 'one'"
            later = Later(lambda: two.reset(1))
            assert answered(raw, encode_request(4, Reset(1)))["number"] == 4
            later.get()
    assert loop.log == [("reset", 1, "")]


def test_more_than_travels_is_told(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr("evs.drivers.lockstep.server.MAX_BLOB_BYTES", 100)
    with serving(StandIn()) as server, connect(server.address) as client:
        client.reset()
        assert client.step(None, 3).t_us == 3000
        with pytest.raises(EvsError, match="128 bytes of events came in these ticks"):
            client.step(None, 4)
        # they are done all the same
        assert client.step().t_us == 8000


def test_a_controller_that_does_not_decide_loses_its_seat() -> None:
    loop, warned = StandIn(), []
    with serving(loop, controllers=2, timeout_s=60, warn=warned.append) as server:
        one, two = both(server.address)
        with one, two:
            later = Later(one.reset)
            two.reset()
            later.get()
            says = r"controller .two. gave no decision for 0\.3 s; noth"
            with waits_only(server, 0.3), pytest.raises(EvsError, match=says):
                one.step([1.0])
            assert loop.log == [("reset", None, "")]
            assert warned == ["controller 'two' gave no decision for 0.3 s"]
            # the late answer
            with pytest.raises(EvsError, match="you have no seat here, or lost it"):
                two.step([1.0])
            with pytest.raises(EvsError, match="nothing has moved since: reset, or restore"):
                one.step([1.0])
            with connect(server.address, "three", actuators=("slide",)) as three:
                later = Later(one.reset)
                three.reset()
                later.get()
                later = Later(one.step)
                three.step()
                assert later.get().t_us == 1000
    assert server.report()["controllers_lost"] == 1


def test_several_that_do_not_decide_are_named_together() -> None:
    loop = StandIn(("a", "b", "c"))
    with serving(loop, controllers=3, timeout_s=0.3) as server:
        three = [connect(server.address, name, actuators=(name,)) for name in "abc"]
        with pytest.raises(EvsError, match="controllers 'b', 'c' gave no decision for 0"):
            three[0].reset()
        # it waits for others to come, and so may they
        with pytest.raises(EvsError, match=r"1 of 3 controllers are here \('a'\) after 0"):
            three[0].reset()
        for one in three:
            one.close()
    assert server.report()["controllers_lost"] == 2


@pytest.mark.slow
def test_a_controller_whose_connection_closes_is_noticed_at_once() -> None:
    loop, warned = StandIn(), []
    with serving(loop, controllers=2, timeout_s=60, warn=warned.append) as server:
        one = connect(server.address, "one", actuators=("tilt",))
        with one, raw_client(server.address) as raw:
            answered(raw, encode_request(1, Join("two", ("slide",))))
            later = Later(one.reset)
            answered(raw, encode_request(2, Reset()))
            later.get()
            later = Later(one.step)
            raw.close()
            begin_s = monotonic_s()
            with pytest.raises(EvsError, match="controller 'two' has gone"):
                later.get()
            assert monotonic_s() - begin_s < 20
    assert loop.log == [("reset", None, "")]
    assert warned == ["controller 'two' has gone (its connection closed)"]


def test_who_waits_for_controllers_that_never_come_hears_how_many() -> None:
    with (
        serving(StandIn(), controllers=3, timeout_s=0.2) as server,
        connect(server.address, "one", actuators=()) as loop,
        pytest.raises(EvsError, match=r"1 of 3 controllers are here \('one'\) after 0.2 s"),
    ):
        loop.reset()


def test_good_bye_frees_the_seat() -> None:
    loop = StandIn()
    with serving(loop) as server:
        for seed in (1, 2):
            with connect(server.address) as client:
                client.reset(seed)
        client.close()
        with pytest.raises(EvsError, match="this connection is closed"):
            client.step()
    assert [entry[1] for entry in loop.log] == [1, 2]
    assert server.report()["controllers_lost"] == 0


def test_good_bye_in_the_middle_of_a_decision_is_told_to_the_others() -> None:
    with serving(StandIn(), controllers=2) as server:
        one, two = both(server.address)
        with one:
            later = Later(one.reset)
            while server._barrier.since_s is None:
                sleep_s(0.01)
            two.close()
            with pytest.raises(EvsError, match="controller 'two' has left; nothing has moved"):
                later.get()


def test_saved_and_restored_over_the_wire() -> None:
    loop = StandIn()
    with serving(loop) as server, connect(server.address) as client:
        client.reset(3)
        client.step([1.0, 2.0], 5)
        blob = client.save()
        assert len(client.save(compress=True)) < len(blob)
        first = [client.step(), client.step([0.5, 0.5])]
        client.restore(blob)
        assert [client.step(), client.step([0.5, 0.5])] == first
    assert (server.report()["restores"], server.report()["saves"]) == (1, 2)


def test_a_loop_that_fails_ends_the_server_and_says_why() -> None:
    class Failing(StandIn):
        def step(self, ctrl: Any = None, ticks: int = 1) -> Observation:
            raise RuntimeError("no more")

    server = LockstepServer(Failing(), "tcp://127.0.0.1:0")
    server.open()
    later = Later(lambda: server.serve([]))
    with connect(server.address) as client:
        client.reset()
        with pytest.raises(EvsError, match="the loop has failed: no more"):
            client.step()
    with pytest.raises(RuntimeError, match="no more"):
        later.get()
    server.close()
    server.close()
