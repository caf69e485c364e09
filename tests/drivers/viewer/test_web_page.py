"""Our page: who gets in, what is shown and bounded, sliders that act on a run, clips."""

from __future__ import annotations

import http.client
import json
import socket
import struct
import threading
from collections.abc import Iterator
from contextlib import ExitStack, closing, contextmanager
from pathlib import Path
from typing import Any, NamedTuple
from urllib.parse import parse_qs, urlsplit

import numpy as np
import pytest

import evs
from evs.drivers.bus import Publisher, request, subscribe
from evs.drivers.clock import monotonic_s, sleep_s
from evs.drivers.run.run import run
from evs.launch.main import main
from evs.msgs import EventPacket, EvsError, StreamInfo, make_events

pytest.importorskip("websockets", reason="the extra web")

from websockets.exceptions import InvalidStatus
from websockets.sync.client import ClientConnection, connect

from evs.drivers.viewer.web.feed import CLIP_BYTES, BusFeed, CameraFeed, PixelNews
from evs.drivers.viewer.web.server import MOST_UNDRAWN, PageServer

SIZE = (30, 20)
SCENE = (
    '<mujoco><option timestep=".001"/><worldbody><light pos="0 0 3"/><body pos="0 0 1"><freejoint/>'
    '<geom size=".2"/></body><geom type="plane" size="3 3 .1"/>'
    '<camera name="eye" pos="0 -2 1" xyaxes="1 0 0 0 .2 1"/></worldbody></mujoco>'
)


def packet(seq: int, events: Any = None, camera: str = "left") -> EventPacket:
    if events is None:
        events = make_events([1000 * seq + 1, 1000 * seq + 9], [seq % 30, 3], [5, 7], [1, 0])
    return EventPacket(seq, 1000 * seq, 1000 * seq + 1000, *SIZE, events, camera)


class Answer(NamedTuple):
    """Of the HTTP server."""

    status: int
    headers: dict[str, str]
    body: bytes


class Served:
    """A publisher, and the page of it."""

    def __init__(self, folder: Path) -> None:
        self.sender = Publisher(
            f"ipc://{folder}/packets", control=f"ipc://{folder}/control", wait_for=1, linger_s=0.2
        )
        self._stack = ExitStack()
        stream = self._stack.enter_context(subscribe(self.sender.address, lights=True))
        self._feed = self._stack.enter_context(BusFeed(stream))
        self.sender.open([StreamInfo(*SIZE, "left")])
        self.seq = 0
        ready = threading.Event()
        self.server = PageServer(self._feed, lambda *_: {"cameras": {}})
        self._closing = False
        self._thread = threading.Thread(
            target=self.server.run, args=(lambda _: ready.set(), lambda: self._closing)
        )
        self._thread.start()
        assert ready.wait(10)
        parts = urlsplit(self.server.address)
        self.port, self.token = parts.port or 0, parse_qs(parts.query)["token"][0]

    def send(self, *packets: EventPacket) -> None:
        """Publish packets, or one that follows the last."""
        for one in packets or [packet(self.seq)]:
            self.sender.write(one)
            self.seq = one.seq + 1

    def connect(self, origin: Any = None) -> ClientConnection:
        return connect(f"ws://127.0.0.1:{self.port}/ws?token={self.token}", origin=origin)

    def get(self, path: str, **headers: str) -> Answer:
        with closing(http.client.HTTPConnection("127.0.0.1", self.port, timeout=10)) as client:
            client.request("GET", path, headers=headers)
            with client.getresponse() as answer:
                return Answer(answer.status, dict(answer.headers), answer.read())

    def close(self) -> None:
        self._closing = True
        self._thread.join()
        self._stack.close()
        self.sender.close()


@pytest.fixture
def served(tmp_path: Path) -> Iterator[Served]:
    made = Served(tmp_path)
    yield made
    made.close()


def read(message: bytes) -> tuple[dict[str, Any], np.ndarray, np.ndarray]:
    """Decode a picture, written anew from the docstring of picture_message."""
    (length,) = struct.unpack_from("<I", message)
    header = json.loads(message[4 : 4 + length])
    events = np.frombuffer(message, "<u4", 2 * header["events"], 4 + length).reshape(-1, 2)
    light = np.frombuffer(message, np.uint8, offset=4 + length + events.nbytes)
    assert light.size == header["light"]
    return header, events, light


def next_of(page: ClientConnection, kind: type, timeout_s: float = 10) -> Any:
    """The next message of a kind, text decoded."""
    while True:
        message = page.recv(timeout=timeout_s)
        if isinstance(message, kind):
            return json.loads(message) if isinstance(message, str) else read(message)


def told(page: ClientConnection, key: str) -> Any:
    """What the next text with this key says."""
    while key not in (words := next_of(page, str)):
        pass
    return words[key]


# ---------------------------------------------------------------- who gets in


def test_the_page_needs_its_token(served: Served) -> None:
    answer = served.get(f"/?token={served.token}")
    text = answer.body.decode()
    assert answer.status == 200
    assert "<canvas" not in text  # made by the script
    policy = answer.headers["Content-Security-Policy"]
    assert "default-src 'none'" in policy
    assert "frame-ancestors 'none'" in policy
    nonce = policy.partition("'nonce-")[2].partition("'")[0]
    assert text.count(f'nonce="{nonce}"') == 2
    assert "{{" not in text
    # and another one each time
    assert nonce not in served.get(f"/?token={served.token}").headers["Content-Security-Policy"]
    for path in ("/", "/?token=", f"/?token={served.token}x", "/?token=%ff", "/clip.aedat4"):
        assert served.get(path).status == 403
    assert served.get(f"/other?token={served.token}").status == 404


@pytest.mark.parametrize("host", ["evil.example", "evil.example:{port}", "127.0.0.1.evil:1", ""])
def test_a_name_that_leads_here_is_refused(served: Served, host: str) -> None:
    """DNS rebinding: the browser calls us by a foreign name."""
    path = f"/?token={served.token}"
    assert served.get(path, Host=host.format(port=served.port)).status == 403


@pytest.mark.parametrize("host", ["127.0.0.1:{port}", "localhost:{port}", "localhost:8080"])
def test_a_tunnel_may_have_another_port(served: Served, host: str) -> None:
    assert served.get(f"/?token={served.token}", Host=host.format(port=served.port)).status == 200


@pytest.mark.parametrize(
    "request_lines",
    [
        "GET //[ HTTP/1.1\r\nHost: 127.0.0.1",
        "GET http://[::1 HTTP/1.1\r\nHost: 127.0.0.1",
        "GET /?" + "a=1&" * 1000 + " HTTP/1.1\r\nHost: 127.0.0.1",
        "GET /?token=%ff%00 HTTP/1.1\r\nHost: [",
        "GET / HTTP/1.1\r\nHost: a\r\nHost: b",
        "GET / HTTP/1.1\r\nHost: a\r\nOrigin: b\r\nOrigin: c",
        "\x16\x03\x01 a client that speaks TLS",
        "GET /\xff HTTP/1.1\r\nHost: a",
    ],
)
def test_a_strange_request_is_refused_without_a_traceback(
    served: Served, request_lines: str, caplog: pytest.LogCaptureFixture
) -> None:
    with socket.create_connection(("127.0.0.1", served.port), 10) as link:
        link.sendall(request_lines.encode("latin-1") + b"\r\nConnection: close\r\n\r\n")
        answer = link.recv(1000)
    # what is no HTTP at all the library drops
    assert answer.startswith((b"HTTP/1.1 400", b"HTTP/1.1 403")) or not answer
    assert not [one for one in caplog.records if one.exc_info]
    assert served.get(f"/?token={served.token}").status == 200


def test_a_foreign_page_gets_no_socket(served: Served) -> None:
    with pytest.raises(InvalidStatus, match="403"):
        served.connect(origin="http://evil.example")
    with pytest.raises(InvalidStatus, match="403"):
        served.connect(origin=f"http://localhost:{served.port + 1}")
    with served.connect(origin=f"http://127.0.0.1:{served.port}") as page:
        assert next_of(page, str) == {"cameras": []}


def test_a_port_in_use_is_one_line(served: Served, tmp_path: Path) -> None:
    with subscribe(f"ipc://{tmp_path}/packets") as stream:
        other = PageServer(BusFeed(stream), None, port=served.port)
        with pytest.raises(EvsError, match=f"port {served.port} of this machine.*another --port"):
            other.run(lambda _: None)


# ---------------------------------------------------------------- what is shown


def test_a_page_gets_the_last_event_of_each_pixel(served: Served) -> None:
    with served.connect() as page:
        assert next_of(page, str) == {"cameras": []}
        # two of pixel (3, 7): the later one counts
        served.send(packet(0, make_events([10, 400, 900], [3, 29, 3], [7, 19, 7], [1, 1, 0])))
        assert told(page, "cameras") == [{"name": "left", "width": 30, "height": 20}]
        header, events, light = next_of(page, bytes)
        assert (header["camera"], header["t_us"]) == ("left", 1000)
        assert (header["on"], header["off"], header["lost"]) == (2, 1, 0)
        assert events.tolist() == [[2 * (7 * 30 + 3), 100], [2 * (19 * 30 + 29) + 1, 600]]
        assert light.size == 0
        # light comes once, with the next picture
        assert served.sender.wants_light("left", 2000)
        served.sender.write_light("left", 2000, np.full(SIZE[::-1], 0.25, np.float32))
        served.send()
        header, _, light = next_of(page, bytes)
        assert light.shape == (600,)
        assert 200 < light[0] < 255
        assert header["latency_ms"] is None
        page.send(json.dumps({"camera": "left", "drawn": header["number"]}))
        served.send()
        header, _, light = next_of(page, bytes)
        assert light.size == 0
        assert header["latency_ms"] > 0


@pytest.mark.slow
def test_a_page_that_does_not_draw_waits_and_misses_no_pixel(served: Served) -> None:
    """Two pictures are under way at most; the pixels of all others come with the next one."""
    with served.connect() as idle, served.connect() as page:
        pictures = []
        for _ in range(60):
            served.send()
            header, _, _ = next_of(page, bytes)
            page.send(json.dumps({"camera": "left", "drawn": header["number"]}))
        while len(pictures) < MOST_UNDRAWN:
            pictures.append(next_of(idle, bytes))
        with pytest.raises(TimeoutError):
            next_of(idle, bytes, 0.3)
        idle.send(json.dumps({"camera": "left", "drawn": pictures[0][0]["number"]}))
        header, events, _ = next_of(idle, bytes)
        assert header["t_us"] == 60_000
        # every column of row 5 fired, and (3, 7)
        assert len(events) == 31


def test_strange_messages_are_answered(served: Served) -> None:
    with served.connect() as page:
        for message in (
            "no json",
            "[]",
            "7",
            '{"drawn": 1}',
            '{"set": 3}',
            '{"drawn": {}, "camera": []}',
            "[" * 4000,
            '{"set":' * 500,
            b"\xff\xfe",
            '{"drawn": 1, "camera": "\\udcff"}x',
        ):
            page.send(message)
            assert told(page, "error") == "this message is not understood"
        served.send()
        assert next_of(page, bytes)[0]["camera"] == "left"


def test_what_waits_is_bounded() -> None:
    """However long nobody takes anything."""
    many = make_events([1] * 60_000, [3] * 60_000, [4] * 60_000, [1] * 60_000)
    feed = CameraFeed(packet(0))
    for seq in range(200):
        feed.add(packet(seq, many))
    for kept in (feed.new, feed.kept(10.0)):
        assert 0.9 * CLIP_BYTES < sum(one.events.nbytes for one in kept) <= CLIP_BYTES
    news = PixelNews(*SIZE)
    news.add(packet(0, many))
    assert len(news.take(1000)) == 1
    assert len(news.take(1000)) == 0


def test_a_clip_has_the_last_seconds(served: Served, tmp_path: Path) -> None:
    for _ in range(50):
        served.send()
    with served.connect() as page:
        served.send()
        while next_of(page, bytes)[0]["t_us"] < 51_000:
            pass
    address = f"/clip.aedat4?token={served.token}&camera=left&seconds="
    for seconds, first in (("10", 0), ("0.02", 31)):
        (tmp_path / "clip.aedat4").write_bytes(served.get(address + seconds).body)
        events = evs.read(tmp_path / "clip.aedat4")
        expected = [packet(seq).events for seq in range(first, 51)]
        assert np.array_equal(events, np.concatenate(expected))
    for bad in (f"{address}x", address.replace("left", "right")):
        answer = served.get(bad)
        assert answer.status == 404
        assert answer.body


# ---------------------------------------------------------------- what is changed


@contextmanager
def running(folder: Path) -> Iterator[tuple[Publisher, list[Any]]]:
    """A run of a falling ball until it is told to stop; its report is put into the list."""
    (folder / "ball.xml").write_text(SCENE)
    world = evs.World(str(folder / "ball.xml"))
    sensor = evs.SensorConfig(preset="imx636", width=64, height=48)
    world.add_camera("eye", sensor=sensor, name="left")
    sender = Publisher(f"ipc://{folder}/run", control=f"ipc://{folder}/ask", linger_s=0.1)
    reports: list[Any] = []
    thread = threading.Thread(
        target=lambda: reports.append(
            run(world, [sender], 1000.0, observers=[lambda *_: sleep_s(0.001)])
        )
    )
    thread.start()
    until_s = monotonic_s() + 10
    while True:
        try:
            request(f"ipc://{folder}/ask", "describe", timeout_s=1)
            break
        except EvsError:
            assert monotonic_s() < until_s
    yield sender, reports
    request(f"ipc://{folder}/ask", "stop")
    thread.join()


def by_key(answer: dict[str, Any]) -> dict[str, Any]:
    return {one["key"]: one for one in answer["cameras"]["left"]}


def test_parameters_are_described_and_set_over_the_control_port(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    with running(tmp_path) as (sender, reports):
        control = sender.control_address
        before = by_key(request(control, "parameters"))
        assert before["pos_thres"]["lowest"] == 0.001
        assert before["pos_thres"]["unit"] == "log units"
        assert (
            before["biases.bias_diff_on"]["lowest"],
            before["biases.bias_diff_on"]["highest"],
        ) == (-85, 140)
        after = by_key(request(control, "set", {"values": {"pos_thres": 0.5}}))
        assert after["pos_thres"]["value"] == 0.5
        assert after["pos_thres"]["initial"] == before["pos_thres"]["value"]
        biases = {"camera": "left", "values": {"biases.bias_diff_off": 50}}
        after = by_key(request(control, "set", biases))
        assert after["neg_thres"]["value"] > before["neg_thres"]["value"]
        assert after["pos_thres"]["value"] == 0.5
        for arguments, message in (
            ({"values": {"pos_thres": -1}}, "sensor.pos_thres is -1; give 0.001 ... 20"),
            ({"values": {"self": 1}}, "no parameter that changes 'self'"),
            ({"values": {"pos_thres": {"a": 1}}}, "sensor.pos_thres is"),
            ({"values": {}}, "not a map of parameters"),
            ({"values": 3}, "not a map of parameters"),
            ({"camera": 3, "values": {"pos_thres": 1}}, "not a name"),
            ({"camera": "right", "values": {"pos_thres": 1}}, "no camera 'right'"),
        ):
            with pytest.raises(EvsError, match=message):
                request(control, "set", arguments)
        assert main(["topics", control, "--set", "pos_thres=0.25", "biases.bias_fo=20"]) == 0
        assert "pos_thres" in capsys.readouterr().out
        assert by_key(request(control, "parameters"))["pos_thres"]["value"] == 0.25
        # the page's Reset: biases first, thresholds follow from them, then the rest
        for prefix in ("biases.", ""):
            now = by_key(request(control, "parameters"))
            values = {
                key: one["initial"]
                for key, one in now.items()
                if key.startswith(prefix) and one["value"] != one["initial"]
            }
            after = by_key(request(control, "set", {"values": values}))
        assert after == before
        assert main(["topics", control, "--set", "pos_thres"]) == 2
    (report,) = reports
    assert [one["values"] for one in report.sensor_changes][:3] == [
        {"pos_thres": 0.5}, {"biases.bias_diff_off": 50}, {"pos_thres": 0.25, "biases.bias_fo": 20}
    ]  # fmt: skip
    assert all(one["camera"] == "left" for one in report.sensor_changes)


def test_a_publisher_without_sensors_says_so(served: Served) -> None:
    answers: list[str] = []

    def ask() -> None:
        for name in ("parameters", "set"):
            try:
                request(served.sender.control_address, name, {"values": {"pos_thres": 1}})
            except EvsError as error:
                answers.append(str(error))

    thread = threading.Thread(target=ask)
    thread.start()
    while thread.is_alive():
        served.send()
        sleep_s(0.002)
    assert len(answers) == 2
    assert all("the sensors of this publisher cannot be changed" in line for line in answers)


def test_a_slider_acts_on_the_run(tmp_path: Path) -> None:
    with (
        running(tmp_path) as (sender, _),
        subscribe(sender.address) as stream,
        BusFeed(stream) as feed,
    ):
        server = PageServer(feed, lambda *words: request(sender.control_address, *words))
        stop = threading.Event()
        address: list[str] = []
        thread = threading.Thread(target=server.run, args=(address.append, stop.is_set))
        thread.start()
        while not address:
            sleep_s(0.01)
        socket = address[0].replace("http", "ws").replace("/?", "/ws?")
        with connect(socket) as page:
            assert told(page, "parameters")["left"][0]["key"] == "pos_thres"
            page.send(json.dumps({"set": {"camera": "left", "values": {"pos_thres": 0.75}}}))
            assert told(page, "parameters")["left"][0]["value"] == 0.75
            page.send(json.dumps({"set": {"camera": "left", "values": {"pos_thres": 0}}}))
            assert "sensor.pos_thres is 0; give 0.001 ... 20" in told(page, "error")
        stop.set()
        thread.join()
