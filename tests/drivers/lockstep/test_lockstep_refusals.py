"""What a lock-step server refuses, in one line each, while its loop goes on."""

from __future__ import annotations

import socket
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
import pytest
import zmq
from lockstep_stand_in import StandIn, answered, raw_client, serving

from evs.drivers.lockstep import LockstepServer, RemoteLoop, connect
from evs.msgs import EvsError
from evs.msgs.lockstep import Join, Reset, Step, encode_request
from evs.msgs.packet import packb, unpackb


@pytest.mark.parametrize(
    ("options", "says"),
    [
        ({"name": "late"}, "every seat is taken: 1 of 1 controllers are here .'controller'."),
        ({"actuators": ("tlt",)}, "every seat is taken"),
    ],
)
def test_a_second_one_at_a_full_seat(options: dict[str, Any], says: str) -> None:
    with serving(StandIn()) as server, connect(server.address) as loop:
        with pytest.raises(EvsError, match=says):
            connect(server.address, **options)
        loop.reset()


@pytest.mark.parametrize(
    ("options", "says"),
    [
        ({"actuators": ("tlt",)}, "no actuator 'tlt'; there is: tilt, slide"),
        ({"actuators": ("tilt", "tilt")}, "one is named twice"),
        ({"actuators": "tilt"}, r"as in actuators=\('tilt',\)"),
        ({"actuators": ("slide",)}, "actuator 'slide' belongs to controller 'first'"),
        ({}, "actuator 'slide' belongs to controller 'first'"),
        ({"cameras": ("lft",), "actuators": ()}, "no camera 'lft'; there is: left"),
        ({"cameras": ("left", "left"), "actuators": ()}, "one is named twice"),
        ({"name": "first", "actuators": ()}, "a controller 'first' has already joined"),
        ({"name": "a\nb"}, "1 ... 255 printable bytes"),
        ({"timeout_s": 0}, "timeout_s is 0: give seconds, over 0"),
        ({"key": "x"}, "key needs server_key"),
    ],
)
def test_a_seat_that_cannot_be(options: dict[str, Any], says: str) -> None:
    loop = StandIn()
    with (
        serving(loop, controllers=2) as server,
        connect(server.address, "first", actuators=("slide",)),
    ):
        with pytest.raises(EvsError, match=says) as caught:
            connect(server.address, **{"name": "second", **options})
        assert "\n" not in str(caught.value)
        connect(server.address, "good", actuators=("tilt",)).close()


@pytest.mark.parametrize(
    ("ask", "says"),
    [
        (lambda loop: loop.step([1.0]), r"takes 2 numbers, .*not shape \(1,\)"),
        (lambda loop: loop.step([[1.0, 2.0]]), r"not shape \(1, 2\)"),
        (lambda loop: loop.step(["a", "b"]), "are no numbers"),
        (lambda loop: loop.step([1.0, float("nan")]), r"ctrl\[1\] is nan: controls are finite"),
        (lambda loop: loop.step([float("inf"), 0.0]), r"ctrl\[0\] is inf: controls are finite"),
        (lambda loop: loop.step([0.0, 0.0], 0), "ticks is 0: a step is 1 ..."),
        (lambda loop: loop.step([0.0, 0.0], 1.5), "ticks is 1.5: a step is 1 ..."),
        (lambda loop: loop.reset(keyframe="nowhere"), "no keyframe 'nowhere'; there is: home"),
        (lambda loop: loop.reset(2**70), "give an integer of 64 bits"),
        (lambda loop: loop.restore(b"rubbish"), "this is no saved loop"),
        (lambda loop: loop.restore(b""), "no bytes of a saved state: give what save"),
    ],
)
def test_a_bad_request_is_one_line_and_moves_nothing(
    ask: Callable[[RemoteLoop], Any], says: str
) -> None:
    loop = StandIn()
    with serving(loop) as server, connect(server.address) as client:
        client.reset()
        client.step([1.0, 2.0])
        with pytest.raises(EvsError, match=says) as caught:
            ask(client)
        assert "\n" not in str(caught.value)
        assert client.step([1.0, 2.0]).position.tolist() == [2.0, 4.0]
    assert [entry[0] for entry in loop.log].count("step") == 2


def test_a_step_before_the_first_reset_is_the_loops_to_refuse() -> None:
    with serving(StandIn()) as server, connect(server.address) as client:
        with pytest.raises(EvsError, match="the loop has not begun: call reset first"):
            client.step()
        client.reset()


def test_a_repeated_request_is_answered_again_and_done_once() -> None:
    loop = StandIn()
    with serving(loop) as server, raw_client(server.address) as raw:
        for parts in (encode_request(1, Join("raw")), encode_request(2, Reset(4))):
            raw.send_multipart(parts)
            first = raw.recv_multipart()
            raw.send_multipart(parts)
            assert raw.recv_multipart() == first
        step = encode_request(3, Step(2, np.array([1.0, 2.0])))
        raw.send_multipart(step)
        raw.send_multipart(step)
        first = raw.recv_multipart()
        assert raw.recv_multipart() == first
        # one that was given up long ago: nothing is done and nothing said
        raw.send_multipart(encode_request(2, Reset(9)))
        raw.send_multipart(encode_request(4, Step(1, None)))
        assert unpackb(raw.recv_multipart()[0])["number"] == 4
    assert loop.log == [("reset", 4, ""), ("step", (1.0, 2.0), 2), ("step", (1.0, 2.0), 1)]
    assert server.report()["repeated"] == 4


def test_a_controller_of_request_sockets_works() -> None:
    with serving(StandIn()) as server, raw_client(server.address, zmq.REQ) as raw:
        told = answered(raw, [packb({"request": "hello", "number": 1})])
        assert told["protocol"] == 1
        assert told["actuators"] == ["tilt", "slide"]
        assert told["joined"] == []
        answered(raw, encode_request(1, Join("req")))
        assert answered(raw, encode_request(2, Reset(4)))["t"] == 0
        assert answered(raw, encode_request(3, Step(1, np.array([1.0, 2.0]))))["t"] == 1000
        assert answered(raw, [packb({"request": "hello", "number": 4})])["joined"] == ["req"]


@pytest.mark.parametrize(
    ("parts", "says"),
    [
        ([b"\xc1"], "header is not msgpack"),
        ([b"x" * 70_000], "header of 70000 bytes is over 65536"),
        ([packb({"number": 1})], "no request 'None'"),
        ([packb({"number": 1, "request": "stpe"})], "no request 'stpe'; there is: step"),
        ([packb({"request": "step"})], "header lacks 'number'"),
        ([packb({"request": "join", "number": 1, "name": "a"})], "header lacks 'protocol'"),
        (
            [packb({"request": "join", "number": 1, "name": "a", "protocol": 2})],
            "protocol 2 is not supported, only 1",
        ),
        ([*encode_request(1, Step(1, None)), b"x"], "this has more"),
        ([packb({"number": 1, "request": "save", "compress": False}), b"x"], "has no second frame"),
        ([packb({"number": 1, "request": "save", "compress": False})], "you have no seat here"),
        ([packb({"number": 1, "request": "step", "ticks": 1}), b"1234567"], "not whole float64"),
    ],
)
def test_what_is_no_request_is_told_so(parts: list[bytes], says: str) -> None:
    with serving(StandIn()) as server:
        with raw_client(server.address) as raw:
            told = answered(raw, parts)
            assert told["ok"] is False
            assert says in told["error"]
            assert "\n" not in told["error"]
        with connect(server.address) as client:
            client.reset()
    assert server.report()["refused"] == 1


def test_what_is_too_large_costs_only_the_connection(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr("evs.drivers.lockstep.server.MAX_BLOB_BYTES", 1000)
    with serving(StandIn()) as server:
        with raw_client(server.address) as raw:
            raw.send_multipart([packb({"number": 1, "request": "restore"}), bytes(1 << 21)])
            raw.set(zmq.RCVTIMEO, 300)
            with pytest.raises(zmq.Again):
                raw.recv()
        with connect(server.address) as client:
            client.reset()


@pytest.mark.parametrize(
    ("address", "options", "says"),
    [
        ("tcp://0.0.0.0:5570", {}, "cannot serve a closed loop on 'tcp://0.0.0.0:5570'"),
        ("udp://127.0.0.1:1", {}, "is not of the form tcp://HOST:PORT"),
        ("ipc://loop", {}, "is not of the form ipc:///PATH"),
        ("ipc:///nowhere/at/all", {}, "there is no folder '/nowhere/at'"),
        ("ipc:///tmp/" + "x" * 120, {}, "is too long"),
        ("tcp://127.0.0.1:0", {"controllers": 0}, "controllers is 0: give 1 ... 1000"),
        ("tcp://127.0.0.1:0", {"timeout_s": 0.0}, "timeout_s is 0.0: give seconds"),
        ("tcp://127.0.0.1:0", {"allow": ("x",)}, "allow needs key"),
    ],
)
def test_a_server_that_cannot_be(address: str, options: dict[str, Any], says: str) -> None:
    with pytest.raises(EvsError, match=says):
        LockstepServer(StandIn(), address, **options)


def test_a_port_that_is_taken() -> None:
    with serving(StandIn()) as server:
        second = LockstepServer(StandIn(), server.address)
        with pytest.raises(EvsError, match="is in use"):
            second.open()
        second.close()


def test_a_path_that_is_taken(tmp_path: Path) -> None:
    address, file = f"ipc://{tmp_path}/loop", tmp_path / "file"
    with serving(StandIn(), address=address), connect(address) as client:
        second = LockstepServer(StandIn(), address)
        with pytest.raises(EvsError, match="/loop' is in use: end the program that serves there"):
            second.open()
        second.close()
        client.reset()
    assert not (tmp_path / "loop").exists()
    file.write_text("precious")
    with pytest.raises(EvsError, match="is a file: give another path"):
        LockstepServer(StandIn(), f"ipc://{file}").open()
    assert file.read_text() == "precious"


def test_a_path_that_a_killed_server_left_is_taken_over(tmp_path: Path) -> None:
    address = f"ipc://{tmp_path}/loop"
    with socket.socket(socket.AF_UNIX) as left:
        left.bind(str(tmp_path / "loop"))
    with serving(StandIn(), address=address), connect(address) as client:
        client.reset()
