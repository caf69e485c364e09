"""The control port and the newest state: discovery, requests from anybody, and no waiting."""

from __future__ import annotations

import json
import threading
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import msgpack
import numpy as np
import pytest
import zmq

from evs.drivers.bus import Latest, Publisher, discover, request, subscribe
from evs.drivers.bus.curve_keys import write_keys
from evs.drivers.clock import monotonic_s, sleep_s
from evs.launch.main import main
from evs.msgs import EventPacket, EvsError, Pose, StreamInfo, decode_status, empty_imu, make_events
from evs.msgs.imu import ImuPacket

ANY = "tcp://127.0.0.1:0"
INFO = {
    "width": 346,
    "height": 260,
    "distortion_model": "plumb_bob",
    "d": [0.1, 0, 0, 0, 0],
    "k": [300, 0, 173, 0, 300, 130, 0, 0, 1],
    "r": [1, 0, 0, 0, 1, 0, 0, 0, 1],
    "p": [300, 0, 173, 0, 0, 300, 130, 0, 0, 0, 1, 0],
}
STREAMS = [
    StreamInfo(346, 260, "left", sensor="davis346", camera_info=INFO),
    StreamInfo(128, 128, "right", sensor="dvs128"),
]


def packet(seq: int, camera: str = "left") -> EventPacket:
    size = (346, 260) if camera == "left" else (128, 128)
    events = make_events([1000 * seq + 1] * 3, [1, 2, 3], [4, 5, 6], [1, 0, 1])
    return EventPacket(seq, 1000 * seq, 1000 * seq + 1000, *size, events, camera)


class Running:
    """A publisher that sends a packet of each camera every 2 ms until it is told to stop."""

    def __init__(self, **options: Any) -> None:
        self.sender = Publisher(ANY, control=ANY, linger_s=0.1, **options)
        self.sender.open(STREAMS)
        self.sent, self.wanted, self.slowest_s = 0, True, 0.0
        self._thread = threading.Thread(target=self._run)
        self._thread.start()

    def _run(self) -> None:
        while self.wanted and not self.sender.stop_wanted:
            begin_s = monotonic_s()
            self._tick(self.sent)
            self.slowest_s = max(self.slowest_s, monotonic_s() - begin_s)
            self.sent += 1
            sleep_s(0.002)

    def _tick(self, seq: int) -> None:
        for camera in ("left", "right"):
            sample = empty_imu(1)
            sample["t"], sample["acceleration"] = 1000 * seq + 1, (0.0, -9.81, seq)
            self.sender.write_imu(ImuPacket(seq, sample, camera))
            if self.sender.wants_pose(camera):
                at = Pose(seq, 1000 * seq, (seq, 1, 2), (0, 0, 0, 1), camera)
                self.sender.write_pose(at)
            self.sender.write(packet(seq, camera))

    def stop(self) -> dict[str, Any]:
        self.wanted = False
        self._thread.join()
        return self.sender.close()


@pytest.fixture
def running() -> Iterator[Running]:
    one = Running()
    yield one
    one.stop()


def test_one_address_tells_all_others(running: Running) -> None:
    found = discover(running.sender.control_address)
    assert found.address == running.sender.address
    assert found.latest == running.sender.latest_address
    assert [one["camera"] for one in found.cameras] == ["left", "right"]
    left = found.cameras[0]
    assert (left["width"], left["height"], left["sensor"]) == (346, 260, "davis346")
    assert {"events", "clock", "status", "ground_truth"} <= {one["name"] for one in found.topics}
    with subscribe(found.address, "left", timeout_s=5) as stream:
        assert stream.receive(5) is not None
        told = discover(running.sender.control_address).cameras
        assert [one["subscribers"]["events"] for one in told] == [1, 0]


def test_status_and_calibration_are_told_on_request(running: Running) -> None:
    control = running.sender.control_address
    left, right = request(control, "status")["cameras"]
    assert (left["camera"], left["seq"] + 1, left["events"]) == (
        "left",
        left["packets"],
        3 * left["packets"],
    )
    assert left["last"]["imu"] >= 0
    # a status as on the wire, but for the names of the others
    assert decode_status(msgpack.packb({**left, "cameras": ["left", "right"]})).camera == "left"
    assert "time_end_us" not in left
    assert right["width"] == 128
    (info,) = request(control, "camera_info")["cameras"]
    assert info == {**INFO, "camera": "left"}


def test_the_end_may_be_asked_for(running: Running) -> None:
    assert request(running.sender.control_address, "stop") == {"ok": True}
    running._thread.join(5)
    assert running.sender.stop_wanted
    assert running.stop()["requests_answered"] == 1


def test_a_wrong_request_is_one_line(running: Running) -> None:
    with pytest.raises(EvsError, match="no request 'describ'; there is: describe"):
        request(running.sender.control_address, "describ")
    with pytest.raises(EvsError, match=r"nobody answers at .*control port"):
        request("tcp://127.0.0.1:9", "describe", timeout_s=0.1)
    # a port of packets takes no requests
    with pytest.raises(EvsError, match="nobody answers"):
        request(running.sender.address, "describe", timeout_s=0.3)


def test_strange_requests_harm_nobody(running: Running) -> None:
    bad = [
        b"",
        b"\xc1",
        b"\x80",
        msgpack.packb({"request": 7}),
        msgpack.packb({"request": "x" * 2000}),
        msgpack.packb([1] * 100),
        b"\xdd\xff\xff\xff\xff" * 500,
        np.random.default_rng(0).bytes(4000),
        bytes(5000),
        bytes(60_000),
        *(
            msgpack.packb({"request": "set", "camera": "left", "values": values})
            for values in (1, [], {"pos_thres": [1]}, {"pos_thres": float("nan")}, {"": {}})
        ),
        msgpack.packb({"request": "set", "camera": ["left"]}),
    ]
    with zmq.Context() as context, context.socket(zmq.DEALER) as client:
        client.set(zmq.LINGER, 0)
        client.connect(running.sender.control_address)
        answers = []
        for request_bytes in bad:
            # with REQ's empty part and without; then with parts that mean nothing
            client.send_multipart([b"", request_bytes])
            client.send(request_bytes)
            client.send_multipart([b"a", b"b", b"c", request_bytes])
            for _ in range(3):
                assert client.poll(3000), request_bytes[:40]
                answers.append(client.recv_multipart()[-1])
        assert len(answers) == 3 * len(bad)
        for answer in map(msgpack.unpackb, answers):
            assert answer["ok"] is False
            assert "\n" not in answer["error"]
        # one of any length more ends that connection only
        client.send(bytes(100_000))
    assert discover(running.sender.control_address).cameras


@pytest.mark.slow
def test_a_crowd_of_requests_does_not_stop_the_camera(running: Running) -> None:
    """Thousands of requests, whose answers nobody reads; packets go on leaving."""
    message = msgpack.packb({"request": "describe"})
    with zmq.Context() as context, context.socket(zmq.DEALER) as client:
        client.set(zmq.LINGER, 0)
        client.set(zmq.RCVHWM, 1)
        client.connect(running.sender.control_address)
        before, begin_s = running.sent, monotonic_s()
        while monotonic_s() < begin_s + 1.0:
            for _ in range(50):
                client.send(message)
            sleep_s(0.001)
        assert running.sent > before + 20
        # the bound leaves room for a busy machine: all requests at once would take seconds
        assert running.slowest_s < 0.5


def test_the_newest_state_is_the_newest(running: Running) -> None:
    with Latest(running.sender.latest_address) as latest:
        first = latest.get(5)
        assert first is not None
        # hundreds of packets pass unread
        sleep_s(0.5)
        before = running.sent
        newest = latest.get(5)
        assert newest is not None
        left = newest.of("left")
        # what is on its way is at most the few states that kernel and ZeroMQ hold
        assert left.seq >= first.of("left").seq + 20
        assert left.seq >= before - 100
        assert (left.packets, left.events, left.end) == (left.seq + 1, 3 * left.packets, False)
        assert left.acceleration[:2] == (0.0, -9.81)
        assert left.orientation == (0.0, 0.0, 0.0, 1.0)
        assert left.position[0] in (left.seq, left.seq + 1)
        assert latest.get(0) is None or latest.get(0) != newest
        said = running.stop()
        end = latest.get(2)
        while end is not None and not end.of("left").end:
            end = latest.get(2)
        assert end is not None
    assert said["states_sent"] > 0


def test_the_last_state_is_sent_twice() -> None:
    """ZeroMQ may lose one that comes while the one before is read."""
    sender = Publisher(ANY, control=ANY, linger_s=0.1)
    sender.open(STREAMS)
    deadline_s = monotonic_s() + 30
    with Latest(sender.latest_address):
        while not sender.wants_pose("left"):
            assert monotonic_s() < deadline_s
            sleep_s(0.01)
        assert sender.close()["states_sent"] == 2


def test_no_state_is_made_while_nobody_looks(running: Running) -> None:
    sleep_s(0.05)
    assert running.stop()["states_sent"] == 0


def test_keys_guard_every_port(tmp_path: Path) -> None:
    write_keys(tmp_path / "camera")
    running = Running(key=str(tmp_path / "camera.secret.key"))
    keys = {"server_key": str(tmp_path / "camera.key")}
    try:
        with pytest.raises(EvsError, match="nobody answers"):
            discover(running.sender.control_address, timeout_s=0.3)
        found = discover(running.sender.control_address, **keys)  # type: ignore[arg-type]
        with Latest(found.latest) as shut, pytest.raises(EvsError, match="does not let us in"):
            shut.get(5)
        with Latest(found.latest, **keys) as latest:
            assert latest.get(5) is not None
    finally:
        running.stop()


def test_a_control_port_in_use_leaves_nothing_bound() -> None:
    first = Publisher(ANY, control=ANY)
    first.open(STREAMS)
    second = Publisher(ANY, control=first.control_address)
    with pytest.raises(EvsError, match="in use"):
        second.open(STREAMS)
    again = Publisher(second.address)
    again.open(STREAMS)
    again.close()
    first.close()


def test_topics_prints_a_table_and_plain_values(
    running: Running, capsys: pytest.CaptureFixture[str]
) -> None:
    control = running.sender.control_address
    assert main(["topics", control]) == 0
    out = capsys.readouterr().out
    assert "events/left" in out
    assert "camera right: dvs128, 128 x 128 px" in out
    assert running.sender.address in out
    assert main(["topics", control, "--json"]) == 0
    assert json.loads(capsys.readouterr().out)["address"] == running.sender.address
    assert main(["topics", control, "--status"]) == 0
    assert len(json.loads(capsys.readouterr().out)) == 2
    assert main(["topics", control, "--camera-info"]) == 0
    assert json.loads(capsys.readouterr().out)[0]["camera"] == "left"
    assert main(["topics", control, "--stop"]) == 0
    running._thread.join(5)
    assert running.sender.stop_wanted
