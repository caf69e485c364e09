"""What notebooks show of packets, recordings and cameras."""

from __future__ import annotations

import io
import re
from base64 import b64decode
from html.parser import HTMLParser
from pathlib import Path

import mujoco
import numpy as np
import pytest
from PIL import Image

import evs
from evs.drivers import files
from evs.msgs import EventPacket, StreamInfo, empty_events, make_events
from evs.msgs.pictures import OFF_RGB, ON_RGB, PAPER, event_frame, png_bytes

PENCIL = Path(evs.__file__).parent / "config" / "scenes" / "pencil.xml"


class Balanced(HTMLParser):
    """Fails where tags do not close in their order; collects what is between them."""

    def __init__(self, text: str) -> None:
        super().__init__()
        self.open: list[str] = []
        self.words: list[str] = []
        self.feed(text)
        self.close()
        assert self.open == []

    def handle_starttag(self, tag: str, attrs: list[tuple[str, str | None]]) -> None:
        assert tag != "script"
        if tag not in ("img", "polyline"):
            self.open.append(tag)

    def handle_endtag(self, tag: str) -> None:
        assert tag == "polyline" or self.open.pop() == tag

    def handle_data(self, data: str) -> None:
        self.words.append(data)


def picture_of(text: str) -> np.ndarray:
    found = re.search(r"base64,([^\"]*)", text)
    assert found
    return np.asarray(Image.open(io.BytesIO(b64decode(found[1]))))


def recording(count: int, folder: Path) -> files.reading.Recording:
    random = np.random.default_rng(1)
    t = np.sort(random.integers(1, 100_000, count))
    events = make_events(
        t,
        random.integers(0, 64, count),
        random.integers(0, 48, count),
        random.integers(0, 2, count),
    )
    sink = files.recorder_for(folder / "a.npz")
    sink.open([StreamInfo(64, 48, camera="left <b>", sensor="davis346")])
    sink.write(EventPacket(0, 0, 100_000, 64, 48, events, "left <b>"))
    sink.close()
    return files.read(folder / "a.npz")


@pytest.mark.parametrize("shape", [(1, 1, 3), (48, 64, 3), (260, 346, 3)])
def test_a_png_has_the_pixels(shape: tuple[int, int, int]) -> None:
    picture = np.random.default_rng(2).integers(0, 256, shape).astype(np.uint8)
    assert np.array_equal(np.asarray(Image.open(io.BytesIO(png_bytes(picture)))), picture)


def test_a_packet() -> None:
    events = make_events([5, 6, 7], [1, 2, 3], [0, 1, 2], [1, 0, 1])
    text = EventPacket(3, 0, 1000, 8, 4, events, "<i>eye</i>")._repr_html_()
    page = Balanced(text)
    assert "EventPacket 3 of <i>eye</i>" in page.words
    assert {"8 x 4 px", "0 to 1,000 us", "3 (2 ON, 1 OFF)"} <= set(page.words)
    picture = picture_of(text)
    assert picture.shape == (4, 8, 3)
    assert [picture[row, row + 1].tolist() for row in range(3)] == [
        list(ON_RGB),
        list(OFF_RGB),
        list(ON_RGB),
    ]
    assert (picture == PAPER).all(axis=2).sum() == 29
    Balanced(EventPacket(0, 0, 1000, 8, 4, empty_events())._repr_html_())


def test_a_recording_and_its_parts(tmp_path: Path) -> None:
    every = recording(5000, tmp_path)
    text = every._repr_html_()
    page = Balanced(text)
    assert "Recording of left <b>" in page.words
    assert {"64 x 48 px", "davis346"} <= set(page.words)
    assert text.count("<polyline") == 2
    middle = int(every["t"][2500])
    shown = every[abs(every["t"] - middle) <= 10_000]
    assert np.array_equal(picture_of(text), event_frame(shown, 64, 48))
    for part in (every[:1], every[:0], every[::-1], every[every["p"] == 1]):
        Balanced(part._repr_html_())
    # a column is no recording: as text
    assert Balanced(every.reshape(1, -1)._repr_html_()).words[0].startswith("Recording(")


def test_a_camera_shows_events_over_light() -> None:
    model = mujoco.MjModel.from_xml_path(str(PENCIL))
    data = mujoco.MjData(model)
    camera = evs.EventCamera(model)
    assert "nothing yet: call observe(data)" in Balanced(camera._repr_html_()).words
    data.qvel[:] = 1
    for _ in range(20):
        mujoco.mj_step(model, data)
        camera.observe(data)
    text = camera._repr_html_()
    Balanced(text)
    assert camera.packet is not None
    picture, events = picture_of(text).astype(int), camera.packet.events
    assert len(events)
    grey = (picture[..., 0] == picture[..., 1]) & (picture[..., 1] == picture[..., 2])
    pixels = {(int(x), int(y)) for x, y in zip(events["x"], events["y"], strict=True)}
    assert int(np.count_nonzero(~grey)) == len(pixels)
    # the light is not black
    assert picture[grey].mean() > 10
