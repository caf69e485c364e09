"""A closed loop in real time: controls act when they arrive, and time waits for nobody."""

from __future__ import annotations

from collections import deque
from collections.abc import Iterator
from contextlib import contextmanager
from typing import Any, cast

import numpy as np
import pytest
import zmq
from lockstep_stand_in import StandIn, raw_client
from manual_clock import ManualClock

from evs.drivers.bus.exchange import Peer, ServerEnd
from evs.drivers.clock import monotonic_s
from evs.drivers.lockstep.realtime import RealtimeServer
from evs.msgs import EvsError, Observation
from evs.msgs.lockstep import (
    Bye,
    Join,
    Request,
    Reset,
    Save,
    Step,
    decode_header,
    decode_observation,
    decode_reply,
    encode_request,
)

CAMERAS = [("left", 64, 48)]
PATIENCE_S = 30.0
"""for what has to come, on a machine that is busy"""


class Inbox:
    """A server's end that has what the test has waited for: a slow wire makes nothing late."""

    def __init__(self, end: ServerEnd) -> None:
        self._end = end
        self._came: deque[tuple[Peer, list[Any]]] = deque()

    def fetch(self) -> None:
        """Wait for one more."""
        until_s = monotonic_s() + PATIENCE_S
        while (came := self._end.receive()) is None:
            assert monotonic_s() < until_s
        self._came.append(came)

    def is_waiting(self) -> bool:
        return bool(self._came)

    def receive(self) -> tuple[Peer, list[Any]] | None:
        return self._came.popleft() if self._came else None

    def __getattr__(self, name: str) -> Any:
        return getattr(self._end, name)


@pytest.fixture
def clock(monkeypatch: pytest.MonkeyPatch) -> ManualClock:
    made = ManualClock()
    for room in ("realtime", "server"):
        monkeypatch.setattr(f"evs.drivers.lockstep.{room}.monotonic_s", made)
    return made


class Hand:
    """A server without a thread: the test does its ticks, and says what controllers say."""

    def __init__(self, loop: StandIn, **options: Any) -> None:
        self.loop = loop
        self.lines: list[str] = []
        self.server = RealtimeServer(
            loop, "tcp://127.0.0.1:0", warn=self.lines.append, **{"timeout_s": 60.0, **options}
        )
        self.server.open()
        assert self.server._end is not None
        self._inbox = Inbox(self.server._end)
        self.server._end = cast(ServerEnd, self._inbox)
        self._numbers: dict[Any, int] = {}

    def ask(self, client: Any, request: Request) -> None:
        """Send it, and wait until it can be taken."""
        number = self._numbers[client] = self._numbers.get(client, 0) + 1
        client.send_multipart(encode_request(number, request))
        self._inbox.fetch()

    def ticks(self, count: int) -> None:
        for _ in range(count):
            self.server.poll()

    def heard(self, client: Any, actuators: int = 2) -> Observation:
        """The answer to what it asked last."""
        client.set(zmq.RCVTIMEO, int(1000 * PATIENCE_S))
        number, fields = decode_header((parts := client.recv_multipart())[0])
        assert number == self._numbers[client]
        decode_reply(fields)
        if len(parts) < 4:
            return Observation(0, (), np.zeros(0), np.zeros(0))
        return decode_observation(fields, parts[1:], actuators, CAMERAS)

    def begin(self, client: Any, join: Join) -> None:
        self.ask(client, join)
        self.ticks(1)
        self.heard(client)


@contextmanager
def hand(**options: Any) -> Iterator[tuple[Hand, Any]]:
    """A server in hand with one controller that has joined and reset."""
    made = Hand(StandIn(), **options)
    with raw_client(made.server.address) as client:
        try:
            made.begin(client, Join("one"))
            made.ask(client, Reset(3))
            made.ticks(1)
            assert made.heard(client).t_us == 0
            yield made, client
        finally:
            made.server.close()


def silent(client: Any) -> bool:
    return not client.poll(30)


def test_it_stands_still_until_the_first_reset() -> None:
    made = Hand(StandIn())
    with raw_client(made.server.address) as client:
        made.begin(client, Join("one"))
        made.ticks(3)
        assert made.loop.log == []
        made.ask(client, Step(1, None))
        made.ticks(1)
        with pytest.raises(EvsError, match="the loop has not begun: call reset"):
            made.heard(client)
    made.server.close()


def test_time_goes_on_without_a_decision_and_nothing_is_missed() -> None:
    with hand() as (made, client):
        made.ticks(7)
        assert made.loop.tick == 7
        made.ask(client, Step(1, np.array([1.0, 2.0])))
        made.ticks(1)
        # it was asked for one tick, and seven had passed: all of them at once
        seen = made.heard(client)
        assert seen.t_us == 7000
        assert [packet.seq for packet in seen.packets] == list(range(7))
        assert seen.position.tolist() == [0.0, 0.0]
        # the control has acted in the tick after it came
        assert made.loop.length.tolist() == [1.0, 2.0]
        made.ask(client, Step(1, None))
        made.ticks(1)
        assert [packet.seq for packet in made.heard(client).packets] == [7]


def test_an_answer_comes_once_its_ticks_have_passed() -> None:
    with hand() as (made, client):
        made.ask(client, Step(3, np.array([1.0, 0.0])))
        made.ticks(2)
        assert silent(client)
        made.ticks(1)
        seen = made.heard(client)
        assert (seen.t_us, len(seen.packets)) == (3000, 3)
        assert seen.position.tolist() == [3.0, 0.0]


def test_the_latest_control_wins_and_holds() -> None:
    with hand() as (made, client):
        made.ask(client, Step(1, np.array([1.0, 0.0])))
        made.ask(client, Step(1, np.array([5.0, 0.0])))
        # both are there before the next tick
        made.ticks(4)
        assert made.loop.log[1:] == [("step", (5.0, 0.0), 1)] * 4


def test_each_controller_has_its_own_time() -> None:
    made = Hand(StandIn(), controllers=2)
    with raw_client(made.server.address) as one, raw_client(made.server.address) as two:
        made.begin(one, Join("one", ("tilt",)))
        made.begin(two, Join("two", ("slide",)))
        made.ask(one, Reset(1))
        made.ticks(1)
        assert made.loop.log == []
        made.ask(two, Reset(1))
        made.ticks(1)
        for client in (one, two):
            made.heard(client, 1)
        made.ask(one, Step(1, np.array([1.0])))
        made.ask(two, Step(4, np.array([2.0])))
        made.ticks(4)
        assert made.heard(one, 1).position.tolist() == [1.0]
        seen = made.heard(two, 1)
        assert seen.position.tolist() == [8.0]
        assert [packet.seq for packet in seen.packets] == [0, 1, 2, 3]
    made.server.close()


def test_who_asks_for_nothing_loses_its_seat_and_its_last_control_goes_on(
    clock: ManualClock,
) -> None:
    with hand(timeout_s=0.2) as (made, client):
        made.ask(client, Step(1, np.array([1.0, 0.0])))
        made.ticks(1)
        made.heard(client)
        clock.now_s += 0.15
        made.ticks(1)
        assert made.lines == []
        clock.now_s += 0.1
        made.ticks(1)
        assert made.lines == ["controller 'one' made no request for 0.2 s"]
        assert made.loop.tick == 3
        assert made.loop.length.tolist() == [3.0, 0.0]
        made.ask(client, Step(1, None))
        made.ticks(1)
        with pytest.raises(EvsError, match="you have no seat here, or lost it"):
            made.heard(client)


def test_an_episode_that_ends_is_told_to_who_waits_and_stands_until_a_reset() -> None:
    with hand() as (made, client):
        made.loop.last_tick = 5
        made.ask(client, Step(100, None))
        made.ticks(5)
        seen = made.heard(client)
        assert (seen.t_us, seen.done, len(seen.packets)) == (5000, "it is over", 5)
        made.ticks(2)
        assert made.loop.tick == 5
        made.ask(client, Step(1, None))
        made.ticks(1)
        with pytest.raises(EvsError, match=r"the episode is over \(it is over\): call reset"):
            made.heard(client)
        made.ask(client, Reset(4))
        made.ticks(1)
        assert made.heard(client).t_us == 0
        made.ticks(2)
        assert made.loop.tick == 2


def test_an_end_that_came_between_two_decisions_is_seen_with_all_that_led_to_it() -> None:
    with hand() as (made, client):
        made.loop.last_tick = 4
        made.ticks(9)
        made.ask(client, Step(1, np.array([1.0, 1.0])))
        made.ticks(1)
        seen = made.heard(client)
        assert (seen.t_us, seen.done, len(seen.packets)) == (4000, "it is over", 4)
        made.ask(client, Step(1, None))
        made.ticks(1)
        with pytest.raises(EvsError, match="the episode is over"):
            made.heard(client)


def test_a_bad_control_is_refused_and_time_goes_on() -> None:
    with hand() as (made, client):
        made.ask(client, Step(1, np.array([1.0])))
        made.ticks(1)
        with pytest.raises(EvsError, match="ctrl has 1 numbers, but 'one' has 2 actuators"):
            made.heard(client)
        made.ticks(1)
        assert made.loop.tick == 2


def test_a_reset_is_an_answer_and_its_first_tick_counts() -> None:
    with hand() as (made, client):
        # the first tick is done before the controller has said anything
        made.ticks(1)
        made.ask(client, Step(1, None))
        made.ticks(1)
        seen = made.heard(client)
        assert (seen.t_us, [packet.seq for packet in seen.packets]) == (1000, [0])


def test_the_last_control_of_who_leaves_acts() -> None:
    with hand() as (made, client):
        made.ask(client, Step(1, np.array([1.0, 1.0])))
        made.ticks(1)
        made.heard(client)
        made.ticks(1)
        # answered at once, so that it may say good-bye before the next tick
        made.ask(client, Step(1, np.array([0.0, 0.0])))
        made.ask(client, Bye())
        made.ticks(3)
        assert made.loop.length.tolist() == [2.0, 2.0]


def test_the_last_control_of_who_is_lost_acts(clock: ManualClock) -> None:
    with hand(timeout_s=1.0) as (made, client):
        made.ticks(1)
        clock.now_s += 0.5
        made.ask(client, Step(1, np.array([3.0, 0.0])))
        assert made.server._end is not None
        came = made.server._end.receive()
        assert came is not None
        made.server._take(*came)
        made.heard(client)
        clock.now_s += 2.0
        made.ticks(2)
        assert made.lines == ["controller 'one' made no request for 1 s"]
        assert made.loop.length.tolist() == [6.0, 0.0]


def test_who_joins_again_sees_nothing_from_before() -> None:
    with hand() as (made, client):
        made.ticks(2)
        made.ask(client, Bye())
        made.ticks(2)
        made.heard(client)
        made.begin(client, Join("one"))
        tick = made.loop.tick
        made.ask(client, Step(1, None))
        made.ticks(1)
        assert [packet.seq for packet in made.heard(client).packets] == list(range(4, tick))


def test_a_reset_that_another_does_not_want_is_told_and_nobody_loses_a_seat(
    clock: ManualClock,
) -> None:
    made = Hand(StandIn(), controllers=2, timeout_s=1.0)
    with raw_client(made.server.address) as one, raw_client(made.server.address) as two:
        made.begin(one, Join("one", ("tilt",)))
        made.begin(two, Join("two", ("slide",)))
        made.ask(one, Reset(1))
        made.ask(two, Reset(1))
        made.ticks(2)
        for client in (one, two):
            made.heard(client, 1)
        clock.now_s += 0.5
        made.ask(one, Reset(2))
        for _ in range(4):
            made.ask(two, Step(1, None))
            made.ticks(1)
            made.heard(two, 1)
            clock.now_s += 0.4
        with pytest.raises(
            EvsError, match=r"'two' did not request a reset within 1 s; time goes on"
        ):
            made.heard(one, 1)
        assert made.lines == []
        made.ask(one, Step(1, None))
        made.ticks(1)
        assert made.heard(one, 1).t_us > 0
    made.server.close()


def test_who_asks_for_something_else_than_steps_keeps_its_seat(clock: ManualClock) -> None:
    with hand(timeout_s=1.0) as (made, client):
        for _ in range(4):
            made.ask(client, Save())
            made.ticks(1)
            client.recv_multipart()
            clock.now_s += 0.6
        assert made.lines == []
