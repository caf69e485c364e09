"""Our page in a real browser, headless: what it draws, its slider, its latency."""

from __future__ import annotations

import base64
import io
import json
import os
import shutil
import signal
import subprocess
import threading
import urllib.request
from collections.abc import Iterator
from contextlib import closing, contextmanager
from pathlib import Path
from typing import Any

import numpy as np
import pytest

import evs
from evs.drivers.bus import Publisher, subscribe
from evs.drivers.clock import monotonic_s, sleep_s
from evs.msgs import EventPacket, StreamInfo, make_events

pytest.importorskip("websockets", reason="the extra web")

from websockets.sync.client import ClientConnection, connect

from evs.drivers.viewer.web.feed import BusFeed
from evs.drivers.viewer.web.server import PageServer

CHROMIUM = next(
    filter(None, map(shutil.which, ("chromium", "chromium-browser", "google-chrome"))), ""
)

pytestmark = [
    pytest.mark.slow,
    pytest.mark.skipif(not CHROMIUM, reason="no chromium (Debian: apt install chromium)"),
]

WIDTH, HEIGHT = 160, 120
SCALE = 3
ON, OFF = np.array([0, 114, 255]), np.array([224, 48, 16])


class Browser:
    """A page in headless chromium, by its DevTools protocol."""

    def __init__(self, socket: ClientConnection) -> None:
        self._socket, self._number = socket, 0

    def call(self, method: str, **parameters: Any) -> Any:
        self._number += 1
        self._socket.send(json.dumps({"id": self._number, "method": method, "params": parameters}))
        while True:
            answer = json.loads(self._socket.recv(timeout=30))
            if answer.get("id") == self._number:
                return answer["result"]

    def evaluate(self, code: str, *, sure: bool = True) -> Any:
        result = self.call("Runtime.evaluate", expression=code, returnByValue=True)
        if "exceptionDetails" in result:
            assert not sure, result
            return None
        return result["result"].get("value")

    def wait(self, code: str) -> Any:
        until_s = monotonic_s() + 30
        # the page may not be there yet
        while not (value := self.evaluate(code, sure=False)):
            assert monotonic_s() < until_s, f"never true: {code}"
            sleep_s(0.05)
        return value

    def picture(self, place: dict[str, float]) -> np.ndarray:
        """The pixels (h, w, 3) of a part of the page."""
        from PIL import Image

        shot = self.call("Page.captureScreenshot", format="png", clip={**place, "scale": 1})
        return np.asarray(Image.open(io.BytesIO(base64.b64decode(shot["data"]))).convert("RGB"))


def page_of(port: int) -> str:
    """The DevTools address of the page that chromium shows."""
    until_s = monotonic_s() + 60
    while True:
        try:
            with urllib.request.urlopen(f"http://127.0.0.1:{port}/json") as answer:
                (found,) = (one for one in json.load(answer) if one["type"] == "page")
            return str(found["webSocketDebuggerUrl"])
        except (OSError, ValueError):
            assert monotonic_s() < until_s, "chromium does not answer"
            sleep_s(0.1)


@contextmanager
def browser(address: str, folder: Path) -> Iterator[Browser]:
    words = ["--headless=new", "--no-sandbox", "--disable-gpu", "--window-size=1000,800"]
    words += ["--hide-scrollbars", "--force-device-scale-factor=1", "--force-color-profile=srgb"]
    words += ["--remote-debugging-port=0", "--remote-allow-origins=*", f"--user-data-dir={folder}"]
    quiet = {"stdout": subprocess.DEVNULL, "stderr": subprocess.DEVNULL}
    with subprocess.Popen([CHROMIUM, *words, address], start_new_session=True, **quiet) as process:
        try:
            port_file = folder / "DevToolsActivePort"
            until_s = monotonic_s() + 60
            while not port_file.exists() or not port_file.read_text().strip():
                assert process.poll() is None, "chromium does not start"
                assert monotonic_s() < until_s, "chromium does not start"
                sleep_s(0.1)
            with connect(page_of(int(port_file.read_text().split()[0])), max_size=None) as socket:
                yield Browser(socket)
        finally:
            os.killpg(process.pid, signal.SIGTERM)


class Shown:
    """A publisher whose page a browser shows."""

    def __init__(self, folder: Path) -> None:
        self.sender = Publisher(f"ipc://{folder}/packets", wait_for=1, linger_s=0.2)
        self.stream = subscribe(self.sender.address, lights=True)
        self.sender.open([StreamInfo(WIDTH, HEIGHT, "left")])
        self.asked: list[tuple[str, Any]] = []
        self.value, self.wanted, self.address = 0.2, True, ""
        self.server = PageServer(BusFeed(self.stream), self._ask)
        self._ready = threading.Event()
        self._thread = threading.Thread(target=self._serve)
        self._thread.start()
        assert self._ready.wait(10)

    def _serve(self) -> None:
        with self.server.feed:
            self.server.run(self._begin, lambda: not self.wanted)

    def _begin(self, address: str) -> None:
        self.address = address
        self._ready.set()

    def _ask(self, name: str, arguments: dict[str, Any]) -> dict[str, Any]:
        self.asked.append((name, arguments))
        if name == "set":
            self.value = arguments["values"]["pos_thres"]
        limits = {
            "initial": 0.2,
            "lowest": 0.001,
            "highest": 20.0,
            "unit": "log units",
            "text": "ON threshold",
        }
        return {"cameras": {"left": [{"key": "pos_thres", "value": self.value, **limits}]}}

    def close(self) -> None:
        self.wanted = False
        self._thread.join()
        self.stream.close()
        self.sender.close()


@pytest.fixture
def shown(tmp_path: Path) -> Iterator[Shown]:
    with closing(Shown(tmp_path)) as made:
        yield made


def packet(seq: int, x: Any, y: Any, p: Any, age_us: int = 0) -> EventPacket:
    end_us = 1000 * (seq + 1)
    events = make_events([end_us - age_us] * len(x), x, y, p)
    return EventPacket(seq, end_us - 1000, end_us, WIDTH, HEIGHT, events, "left")


def test_the_page_draws_events_over_light(shown: Shown, tmp_path: Path) -> None:
    """Each pixel of the screenshot has the colour of its event, or of the pale light behind it."""
    y, x = np.mgrid[:HEIGHT, :WIDTH]
    light = ((x + 1) / WIDTH).astype(np.float32)
    on, off = (x - 40) ** 2 + (y - 60) ** 2 < 400, (x - 110) ** 2 + (y - 60) ** 2 < 400
    with browser(shown.address, tmp_path / "profile") as page:
        page.wait("document.getElementById('state').textContent === 'live'")
        shown.sender.write(packet(0, [], [], []))
        until_s = monotonic_s() + 10
        while not shown.sender.wants_light("left", 2000):
            assert monotonic_s() < until_s
        shown.sender.write_light("left", 2000, light)
        places = np.argwhere(on | off)
        rows, columns = places.T
        shown.sender.write(packet(1, columns, rows, on[rows, columns]))
        page.wait(
            "cameras.get('left') && cameras.get('left').now.on > 0 && cameras.get('left').light"
        )
        sleep_s(0.3)
        place = page.evaluate(
            "(({x, y, width, height}) => ({x, y, width, height}))"
            "(document.querySelector('canvas.events').getBoundingClientRect())"
        )
        assert (place["width"], place["height"]) == (SCALE * WIDTH, SCALE * HEIGHT)
        picture = page.picture(place)
        grey = page.evaluate("Array.from(cameras.get('left').light)")
        assert page.evaluate("cameras.get('left').facts.textContent").startswith("t 0.002 s")
    expected = np.repeat(96 + 0.62 * np.array(grey).reshape(HEIGHT, WIDTH, 1), 3, axis=2)
    expected[on], expected[off] = ON, OFF
    expected = expected.repeat(SCALE, 0).repeat(SCALE, 1)
    assert picture.shape == expected.shape
    # the screenshot's rounding
    assert np.abs(picture - expected).max() <= 3
    assert np.ptp(grey) > 200


def test_the_window_fades_and_pause_stops(shown: Shown, tmp_path: Path) -> None:
    with browser(shown.address, tmp_path / "profile") as page:
        page.wait("document.getElementById('state').textContent === 'live'")
        shown.sender.write(packet(0, [5], [5], [1], age_us=400))
        colour = "Array.from(cameras.get('left').context.getImageData(5, 5, 1, 1).data)"
        page.wait("cameras.get('left') && cameras.get('left').now && !cameras.get('left').dirty")
        strong = page.evaluate(colour)
        page.evaluate("byId('window').value = 0; byId('window').oninput()")
        page.wait("!cameras.get('left').dirty")
        weak = page.evaluate(colour)
        assert ON[0] <= strong[0] < weak[0] < 255
        page.call("Input.dispatchKeyEvent", type="keyDown", key=" ", text=" ")
        page.wait("paused")
        before = page.evaluate("cameras.get('left').now.t_us")
        for seq in range(1, 40):
            shown.sender.write(packet(seq, [7], [7], [0]))
            sleep_s(0.01)
        assert page.evaluate("cameras.get('left').now.t_us") == before
        page.call("Input.dispatchKeyEvent", type="keyDown", key=" ", text=" ")
        shown.sender.write(packet(40, [7], [7], [0]))
        page.wait("cameras.get('left').now.t_us === 41000")


def test_a_dragged_slider_asks_for_its_value(shown: Shown, tmp_path: Path) -> None:
    with browser(shown.address, tmp_path / "profile") as page:
        shown.sender.write(packet(0, [], [], []))
        place = page.wait(
            "(s => s && (r => [r.x, r.y, r.width, r.height])(s.getBoundingClientRect()))"
            "(document.querySelector('.parameters input'))"
        )
        x, y, width, height = place
        middle = {"y": y + height / 2, "button": "left", "clickCount": 1}
        page.call("Input.dispatchMouseEvent", type="mousePressed", x=x + width / 2, **middle)
        for step in range(1, 6):
            page.call(
                "Input.dispatchMouseEvent",
                type="mouseMoved", x=x + width * (0.5 + step / 20), buttons=1, **middle,
            )  # fmt: skip
        page.call("Input.dispatchMouseEvent", type="mouseReleased", x=x + width * 0.75, **middle)
        # three quarters of two decades around 0.2, after values on the way there
        until_s = monotonic_s() + 60
        while shown.value != pytest.approx(0.2 * 10**0.5, rel=0.2):
            assert monotonic_s() < until_s, shown.asked
            sleep_s(0.05)
        sets = [arguments for name, arguments in shown.asked if name == "set"]
        assert all(one["camera"] == "left" for one in sets)
        shown_text = f"'{shown.value:.3g} log units'"
        page.wait(f"document.querySelector('.parameters span').textContent === {shown_text}")
        # it stays where it was put: three quarters of the way
        slider = "(s => (s.value - s.min) / (s.max - s.min))"
        slider += "(document.querySelector('.parameters input'))"
        assert page.evaluate(slider) == pytest.approx(0.75, abs=0.06)
        page.evaluate("document.querySelector('.parameters button').click()")
        page.wait("document.querySelector('.parameters span').textContent === '0.2 log units'")
        assert shown.value == 0.2
        assert page.evaluate(slider) == pytest.approx(0.5, abs=0.01)


def test_events_reach_pixels(
    shown: Shown, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    """Every picture is drawn; prints how long events take to their pixels here."""
    random = np.random.default_rng(0)
    with browser(shown.address, tmp_path / "profile") as page:
        page.wait("document.getElementById('state').textContent === 'live'")
        begin_s = monotonic_s()
        for seq in range(2000):
            x, y = random.integers(0, (WIDTH, HEIGHT), (500, 2)).T
            shown.sender.write(packet(seq, x, y, x % 2))
            sleep_s(max(0.0, begin_s + 0.001 * seq - monotonic_s()))
        page.wait("cameras.get('left').now.t_us === 2000000")
        frames = len(shown.server.latencies_s)
    found_ms = 1e3 * np.quantile(shown.server.latencies_s, (0.5, 0.95))
    with capsys.disabled():
        print(
            f"\n{frames} pictures, events to pixels: median {found_ms[0]:.0f} ms, "
            f"95 % {found_ms[1]:.0f} ms"
        )
    assert frames > 5


def test_emulate_shows_its_run(tmp_path: Path) -> None:
    """The command as users call it: the page of a run, and its end."""
    scene = tmp_path / "ball.xml"
    scene.write_text(
        '<mujoco><worldbody><light pos="0 0 3"/><body pos="0 0 1"><freejoint/><geom size=".2"/>'
        '</body><geom type="plane" size="3 3 .1"/></worldbody></mujoco>'
    )
    words = ["emulate", str(scene), "--view", "--duration", "100", "--pace", "realtime"]
    command = [str(Path(evs.__file__).parents[3] / ".venv" / "bin" / "evs"), *words]
    if not Path(command[0]).exists():
        command[0] = shutil.which("evs") or pytest.skip("no evs on the path")
    with subprocess.Popen(command, stdout=subprocess.PIPE, text=True) as process:
        assert process.stdout is not None
        address = next(line for line in process.stdout if line.startswith("view: ")).split()[1]
        with browser(address, tmp_path / "profile") as page:
            page.wait(
                "cameras.size && [...cameras.values()][0].now && [...cameras.values()][0].light"
            )
            page.wait("document.querySelectorAll('.parameters input').length > 5")
            process.send_signal(signal.SIGINT)
            page.wait("document.getElementById('state').textContent === 'the run has ended'")
        assert process.wait(20) == 130
