"""`evs view` of a recording with intensity frames: the events lie over them."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest
from PIL import Image

from evs.drivers.files import recorder_for
from evs.drivers.pictures import recorded_light
from evs.drivers.sink import Stream
from evs.launch.main import main
from evs.msgs import EventPacket, Frame, StreamInfo, make_events

WIDTH, HEIGHT = 16, 12


def frame(seq: int, level: int, dtype: type = np.uint8) -> Frame:
    """Dark on the left, `level` on the right."""
    pixels = np.zeros((HEIGHT, WIDTH), dtype)
    pixels[:, WIDTH // 2 :] = level
    begin_us = seq * 100_000
    return Frame(seq, begin_us, begin_us, begin_us + 5000, begin_us + 6000, pixels)


@pytest.mark.parametrize("ending", ["png", "gif"])
def test_events_lie_over_the_recorded_frames(tmp_path: Path, ending: str) -> None:
    file, out = tmp_path / "run.aedat4", tmp_path / f"run.{ending}"
    recorder = recorder_for(file)
    recorder.open([StreamInfo(WIDTH, HEIGHT, sensor="davis", frames=True)])
    assert Stream.FRAMES in recorder.streams
    for step in range(100):
        end_us = (step + 1) * 10_000
        if step % 10 == 0:
            recorder.write_frame(frame(step // 10, 200))
        events = make_events([end_us], [step % WIDTH], [step % HEIGHT], [1])
        recorder.write(EventPacket(step, end_us - 10_000, end_us, WIDTH, HEIGHT, events))
    recorder.close()
    assert main(["view", str(file), "-o", str(out), "--scale", "10"]) == 0
    with Image.open(out) as image:
        page = np.asarray(image.convert("RGB"))
    # the dark half of a frame: events alone lie on paper white
    black = np.all(page == 0, axis=2).sum()
    assert black > 0.3 * WIDTH * HEIGHT * 100


def test_the_frame_shown_is_the_last_one_that_was_exposed() -> None:
    frames = [frame(1, 250), frame(0, 100)]
    light = recorded_light(frames, WIDTH, HEIGHT)
    assert light is not None
    at = {t: light.at(t) for t in (0, 5000, 104_999, 105_000)}
    assert [picture[0, -1] for picture in at.values() if picture is not None] == [
        231,
        231,
        231,
        255,
    ]


def test_frames_of_another_size_are_left_out_and_wide_ones_keep_their_light() -> None:
    assert recorded_light([frame(0, 9)], WIDTH + 1, HEIGHT) is None
    assert recorded_light([], WIDTH, HEIGHT) is None
    wide = recorded_light([frame(0, 51400, np.uint16)], WIDTH, HEIGHT)
    usual = recorded_light([frame(0, 200)], WIDTH, HEIGHT)
    assert wide is not None
    assert usual is not None
    np.testing.assert_array_equal(wide.at(0), usual.at(0))
