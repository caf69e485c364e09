"""Frames and IMU in NPZ recordings: plain arrays, and archives whose arrays do not fit."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np
import pytest

from evs.drivers import files
from evs.drivers.files.npz import NpzRecorder
from evs.msgs import (
    EventPacket,
    EvsError,
    Frame,
    ImuPacket,
    ImuSamples,
    StreamInfo,
    empty_imu,
    make_events,
)

STREAM = StreamInfo(34, 26, frames=True, imu=True)
RANDOM = np.random.default_rng(0)
FRAMES = [
    Frame(n, 10_000 * n, 10_000 * n, 10_000 * n + 5000, 10_000 * n + 8900, image, "camera")
    for n, image in enumerate(RANDOM.integers(0, 2**16, (6, 26, 34)).astype(np.uint16))
]


def samples() -> ImuSamples:
    made = empty_imu(118)
    made["t"] = 500 * np.arange(118)
    made["acceleration"] = RANDOM.normal(size=(118, 3))
    return made


IMU = samples()


def record(path: Path) -> None:
    recorder = NpzRecorder(path)
    recorder.open([STREAM])
    recorder.write(EventPacket(0, 0, 1000, 34, 26, make_events([5, 6], [1, 2], [3, 4], [0, 1])))
    for frame in FRAMES:
        recorder.write_frame(frame)
    recorder.write_imu(ImuPacket(0, IMU))
    recorder.close()


def test_an_npz_file_needs_numpy_alone(tmp_path: Path) -> None:
    record(tmp_path / "a.npz")
    with np.load(tmp_path / "a.npz") as arrays:
        assert arrays["frames"].shape == (6, 26, 34)
        assert arrays["frames"].dtype == np.uint16
        assert arrays["exposure_begin_us"].tolist() == [one.exposure_begin_us for one in FRAMES]
        assert (arrays["frames"][3] == FRAMES[3].pixels).all()
        assert (arrays["imu_acceleration"] == IMU["acceleration"]).all()
        assert arrays["imu_t"].dtype == np.int64


@pytest.mark.parametrize(
    ("changes", "said"),
    [
        ({"frame_end_us": np.zeros(5, np.int64)}, "not of one length"),
        ({"frames": np.zeros((6, 26, 34), np.uint32)}, "is uint32, not uint8 or uint16"),
        ({"frames": np.zeros((6, 26), np.uint8)}, "array 'frames' is uint8 of shape"),
        ({"imu_acceleration": np.zeros((118, 2))}, "acceleration is of shape"),
        ({"imu_t": np.arange(118)[::-1]}, "run backwards"),
    ],
)
def test_an_npz_file_whose_arrays_do_not_fit_is_refused(
    tmp_path: Path, changes: dict[str, Any], said: str
) -> None:
    path = tmp_path / "a.npz"
    record(path)
    with np.load(path) as arrays:
        changed = {**arrays, **changes}
    np.savez(path, **changed)
    with pytest.raises(EvsError, match=said):
        files.read(path)


def test_other_peoples_arrays_of_these_names_are_left_alone(tmp_path: Path) -> None:
    path = tmp_path / "other.npz"
    t = np.arange(5)
    np.savez(path, t=t, x=t, y=t, p=t % 2, frames=np.zeros(3), imu_t=np.zeros(2))
    recording = files.read(path)
    assert (len(recording), recording.frames, len(recording.imu)) == (5, (), 0)
