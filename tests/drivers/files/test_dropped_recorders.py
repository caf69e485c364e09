"""Recorders that are dropped without being closed, as after an exception in a program."""

from __future__ import annotations

import gc
import warnings
from pathlib import Path

import numpy as np
import pytest

from evs.drivers import files
from evs.drivers.files.npz.frame_writer import FrameArray, NpzFrameWriter
from evs.msgs import EventPacket, Frame, StreamInfo, make_events

FORMATS = [row.name for row in files.RECORDED]


def _descriptors() -> int:
    return len(list(Path("/proc/self/fd").iterdir()))


def _drop(path: Path, name: str) -> None:
    if name == "frames":
        NpzFrameWriter(path, 3, {"luminance": FrameArray("<f4", (4, 6))}, {})
        return
    (row,) = (row for row in files.RECORDED if row.name == name)
    sink = files.recorder_for(path.with_suffix(row.suffixes[0]), kind=name)
    sink.open([StreamInfo(346, 260, frames=row.capabilities.frames)])
    sink.write(EventPacket(0, 0, 1000, 346, 260, make_events([5, 6], [1, 2], [3, 4], [0, 1])))
    if row.capabilities.frames:
        sink.write_frame(Frame(0, 1, 2, 3, 4, np.zeros((260, 346), np.uint8)))


@pytest.mark.parametrize("name", [*FORMATS, "frames"])
def test_a_recorder_that_is_dropped_leaves_no_descriptor(name: str, tmp_path: Path) -> None:
    with warnings.catch_warnings():
        warnings.simplefilter("ignore", ResourceWarning)
        # what is loaded once stays open
        _drop(tmp_path / "first", name)
        gc.collect()
        before = _descriptors()
        for k in range(3):
            _drop(tmp_path / f"{k}", name)
        gc.collect()
        assert _descriptors() == before
