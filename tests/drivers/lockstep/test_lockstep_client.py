"""A controller whose server is silent, strange or gone: an error in time, and no hang."""

from __future__ import annotations

import threading
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import Any

import pytest
import zmq
from lockstep_stand_in import StandIn, serving

from evs.drivers.bus.address import free_address
from evs.drivers.bus.curve_keys import write_keys
from evs.drivers.clock import monotonic_s, sleep_s
from evs.drivers.lockstep import LockstepServer, connect
from evs.msgs import EvsError
from evs.msgs.lockstep import decode_header
from evs.msgs.packet import packb

Answerer = Callable[[int, list[bytes]], list[list[bytes]]]


@contextmanager
def strange_server(answers: Answerer) -> Iterator[str]:
    """A ROUTER that says what the function of (count of requests, frames) gives."""
    stopped: list[bool] = []
    address: list[str] = []
    ready = threading.Event()

    def run() -> None:
        with zmq.Context() as context, context.socket(zmq.ROUTER) as router:
            router.set(zmq.LINGER, 0)
            router.set(zmq.RCVTIMEO, 20)
            address.append(f"tcp://127.0.0.1:{router.bind_to_random_port('tcp://127.0.0.1')}")
            ready.set()
            count = 0
            while not stopped:
                try:
                    identity, *parts = router.recv_multipart()
                except zmq.Again:
                    continue
                count += 1
                for answer in answers(count, parts):
                    router.send_multipart([identity, *answer])

    thread = threading.Thread(target=run)
    thread.start()
    assert ready.wait(10)
    try:
        yield address[0]
    finally:
        stopped.append(True)
        thread.join(10)


def joined(number: int = 1, **changed: Any) -> list[bytes]:
    camera = {"camera": "left", "width": 4, "height": 3, "sensor": "x", "tick_us": 1000}
    camera |= {"seed": 0, "latency_us": 0, "frames": False, "imu": False}
    told = {"ok": True, "number": number, "tick_us": 1000, "actuators": ["a"], "cameras": [camera]}
    return [packb({**told, **changed}), bytes(16)]


def in_time(ask: Callable[[], Any], says: str, limit_s: float = 5.0) -> None:
    begin_s = monotonic_s()
    with pytest.raises(EvsError, match=says) as caught:
        ask()
    assert monotonic_s() - begin_s < limit_s
    assert "\n" not in str(caught.value)


def test_nobody_there() -> None:
    in_time(lambda: connect(free_address(), timeout_s=0.3), "nobody serves a closed loop at tcp://")


def test_a_controller_may_be_there_first() -> None:
    address = free_address()
    found: list[Any] = []

    def join() -> None:
        with connect(address) as loop:
            found.append(loop.reset(1))

    thread = threading.Thread(target=join)
    thread.start()
    with serving(StandIn(), address=address):
        thread.join(20)
    assert [seen.t_us for seen in found] == [0]


def test_a_server_that_says_nothing_more() -> None:
    with strange_server(lambda count, _: [joined()] if count == 1 else []) as address:
        loop = connect(address)
        loop.timeout_s = 0.3
        in_time(loop.reset, "no answer from tcp://.* within 0.3 s: it is busy, waits for another")
        loop.close()


@pytest.mark.slow
def test_a_server_that_goes_is_noticed_before_the_time_is_up() -> None:
    with strange_server(lambda count, _: [joined()] if count == 1 else []) as address:
        loop = connect(address, timeout_s=60)
    in_time(loop.reset, "the server at tcp://.* has gone")
    in_time(loop.reset, "the server at tcp://.* has gone")
    loop.close()
    loop.close()


def test_a_server_that_ends_says_so_to_who_waits() -> None:
    server = LockstepServer(StandIn(), "tcp://127.0.0.1:0", controllers=2)
    server.open()
    stopped: list[str] = []
    thread = threading.Thread(target=server.serve, args=(stopped,))
    thread.start()
    loop = connect(server.address, actuators=())
    lines: list[str] = []

    def reset() -> None:
        try:
            loop.reset()
        except EvsError as error:
            lines.append(str(error))

    waiting = threading.Thread(target=reset)
    waiting.start()
    while server._barrier.since_s is None:
        sleep_s(0.01)
    stopped.append("stopped")
    thread.join(10)
    server.close()
    waiting.join(10)
    assert lines == ["the server of the loop has ended"]
    loop.close()


@pytest.mark.slow
def test_a_request_that_was_lost_is_asked_again() -> None:
    heard: list[list[bytes]] = []

    def answers(count: int, parts: list[bytes]) -> list[list[bytes]]:
        heard.append(parts)
        # the first join is lost; the answer to the second comes twice, and one of long ago
        if count == 1:
            return []
        return [joined(0x7FFF), joined(), joined()]

    with strange_server(answers) as address:
        connect(address, timeout_s=10).close()
    assert heard[0] == heard[1]


@pytest.mark.parametrize(
    ("answer", "says"),
    [
        ([b"rubbish"], "header"),
        ([packb({"ok": True})], "header lacks 'number'"),
        ([packb({"ok": 1, "number": 1})], "is 1, not true or false"),
        ([packb({"ok": False, "number": 1})], "header field 'error' is None"),
        ([packb({"ok": False, "number": 1, "error": "no seat"})], "no seat"),
        (joined(cameras=[{"camera": "x"}]), "the server's cameras cannot be understood"),
        (joined(cameras=7), "the server's cameras cannot be understood"),
        (joined(tick_us=0), "header field 'tick_us' is 0"),
        ([joined()[0]], "an answer of 1 frames"),
        ([joined()[0], b"123"], "ctrl_range: 3 bytes are not whole"),
    ],
)
def test_a_join_that_is_answered_with_rubbish(answer: list[bytes], says: str) -> None:
    with strange_server(lambda *_: [answer]) as address:
        in_time(lambda: connect(address, timeout_s=5), says)


def test_what_comes_back_from_a_step_is_checked() -> None:
    def answers(_: int, parts: list[bytes]) -> list[list[bytes]]:
        # where the machine is slow, a request comes twice
        number, _fields = decode_header(parts[0])
        header = packb({"ok": True, "number": number, "t": 1000, "done": ""})
        bad = bytes(8) * 4 + (5).to_bytes(8, "little")
        every = [joined(), [header, bytes(16), b"", b""], [header], [header, bytes(8), b"", b""]]
        every += [[header, bytes(16), bytes(7), b""], [header, bytes(16), bad, b""]]
        every += [[header, bytes(16), b"", bytes(16)]]
        return [every[number - 1]] if number <= len(every) else []

    with strange_server(answers) as address, connect(address, timeout_s=5) as loop:
        assert loop.step([1.0]).t_us == 1000
        in_time(loop.step, "3 frames after its header, not 0")
        in_time(loop.step, "1 numbers of encoders for 1 actuators")
        in_time(loop.step, "not whole")
        in_time(loop.step, "0 events are fewer than the table of packets says")
        in_time(loop.step, "1 events are more than the table of packets says")


def test_with_keys_only_who_is_allowed_comes_in(tmp_path: Path) -> None:
    public, secret = write_keys(tmp_path / "server")
    mine_public, mine_secret = write_keys(tmp_path / "mine")
    other_public, other_secret = write_keys(tmp_path / "other")
    keys = {"key": str(secret), "allow": (str(mine_public),)}
    with serving(StandIn(), **keys) as server:
        at = server.address
        with connect(at, server_key=str(public), key=str(mine_secret)) as loop:
            assert loop.reset().t_us == 0
        wrong = {"server_key": str(public), "key": str(other_secret)}
        in_time(lambda: connect(at, timeout_s=20, **wrong), "does not let us in: server_key")
        in_time(lambda: connect(at, timeout_s=20), "does not let us in: it wants keys")
    assert other_public.is_file()


def test_arrays_cannot_be_written() -> None:
    with serving(StandIn()) as server, connect(server.address) as loop:
        loop.reset(state=True)
        seen = loop.step([1.0, 2.0])
        assert seen.state is not None
        for array in (seen.position, seen.velocity, seen.state, seen.packets[0].events):
            assert not array.flags.writeable


def test_a_second_close_and_a_use_after_it() -> None:
    with serving(StandIn()) as server:
        loop = connect(server.address)
        loop.close()
        loop.close()
        in_time(loop.save, "this connection is closed: connect again")


@pytest.mark.parametrize("blob", [b"", "abc", None, 3])
def test_what_is_no_saved_state_is_refused_here(blob: Any) -> None:
    with serving(StandIn()) as server, connect(server.address) as loop:
        with pytest.raises(EvsError, match="no bytes of a saved state"):
            loop.restore(blob)
        assert loop.reset().t_us == 0


@pytest.mark.parametrize("timeout_s", [0, -1.0, float("nan"), "3", None])
def test_a_timeout_is_seconds(timeout_s: Any) -> None:
    with pytest.raises(EvsError, match="give seconds, over 0"):
        connect("tcp://127.0.0.1:1", timeout_s=timeout_s)
