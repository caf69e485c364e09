"""The cost of a frame from film to events on one core: ours beside v2e and eventcv, on one film.

All have v2e's pixel with the same thresholds, bandwidth, leak, shot noise and dead time, and get
the same 8-bit frames, 1 ms apart. v2e takes the coded numbers for light; evs does the same with the
unit `dn`. eventcv decodes sRGB, as evs does by itself: more contrast, so more events. v2e
interpolates nothing (`--disable_slomo`); it is not on PyPI, so its row needs a venv that is made by
hand: MISSING says how. The last row of ours is the whole of `evs convert` of a film of ten times as
many frames in H.264: starting, decoding, events, and the recording on disk.
"""

from __future__ import annotations

import json
import os
import subprocess
import sys
from collections.abc import Callable
from contextlib import ExitStack
from pathlib import Path
from typing import Any

import numpy as np
import pytest

import evs
from evs.launch.main import main
from reference.foreign_films import ffmpeg
from speed.drifting import eventcv, film
from speed.elsewhere import AbsentError, elsewhere
from speed.turns import Table, Time, milliseconds, target
from speed.v2e import MISSING, PEER, V2E

PEER_V2E, PEER_EVENTCV = "v2e, from arrays", "eventcv, from arrays"
OURS, OURS_DN = "evs.Pixels, from arrays", "evs.Pixels, from arrays, unit dn"
WHOLE = "evs convert, from the film to a file, unit dn"
PROGRAM_V2E, PROGRAM = "v2e --disable_slomo", "evs convert"
ROUNDS, PROGRAM_ROUNDS = 9, 3
REPEATS = 10
"""of the film that `evs convert` gets"""
SIZES = {"346x260": (346, 260, 60), "1280x720": (1280, 720, 20)}

NOISE: dict[str, Any] = {
    "sigma_thres": 0.03,
    "cutoff_hz": 200.0,
    "leak_rate_hz": 1.0,
    "shot_noise_rate_hz": 10.0,
    "refractory_period_s": 100e-6,
}


class V2e:
    """v2e's emulator in a process of its own."""

    def __init__(self, folder: Path, frames: Any) -> None:
        if not V2E.exists():
            raise AbsentError(MISSING)
        np.save(folder / "frames.npy", frames)
        options = {"pos_thres": 0.2, "neg_thres": 0.2, **NOISE}
        (folder / "options.json").write_text(json.dumps(options))
        words = [V2E, PEER, "frames", folder / "frames.npy", folder / "options.json"]
        self._process = subprocess.Popen(
            [str(word) for word in words],
            stdin=subprocess.PIPE,
            stdout=subprocess.PIPE,
            stderr=subprocess.PIPE,
            text=True,
        )
        if self._answer() != "ready":
            raise AbsentError(f"v2e does not start: {self._error()}")

    def __enter__(self) -> V2e:
        return self

    def __exit__(self, *_: object) -> None:
        self._process.communicate()

    def __call__(self) -> int:
        assert self._process.stdin is not None
        self._process.stdin.write("\n")
        self._process.stdin.flush()
        return int(self._answer())

    def _answer(self) -> str:
        assert self._process.stdout is not None
        return self._process.stdout.readline().strip()

    def _error(self) -> str:
        return (self._process.communicate()[1].strip().splitlines() or ["no reason given"])[-1]


def pixels_of(frames: Any, unit: str) -> Callable[[], int]:
    """The film to its end, or from there back, in turns; how many events."""
    height, width = frames.shape[1:]
    keys = {"log": "linlog", "linlog_dn": 20.0, "pos_thres": 0.2, "neg_thres": 0.2, **NOISE}
    pixels = evs.Pixels("ideal", (width, height), unit=unit, threads=1, **keys)
    pixels.observe(frames[0], 0)
    onwards, back, now_us = list(frames[1:]), list(frames[-2::-1]), 0

    def run() -> int:
        nonlocal onwards, back, now_us
        events = 0
        for frame in onwards:
            now_us += 1000
            events += len(pixels.observe(frame, now_us))
        onwards, back = back, onwards
        return events

    return run


def converter_words(folder: Path, frames: Any) -> list[str]:
    """Make the film, and return the arguments of evs that convert it."""
    turns = [frames[1:-1], frames[::-1]] * (REPEATS // 2)
    source = ffmpeg(folder / "film.mp4", np.concatenate(turns), 1000, "-c:v", "libx264")
    height, width = frames.shape[1:]
    keys = {"log": "linlog", "linlog_dn": 20.0, "pos_thres": 0.2, "neg_thres": 0.2, **NOISE}
    words = ["convert", str(source), str(folder / "run.aedat4")]
    words += [f"sensor.{key}={value}" for key, value in keys.items()]
    words += ["--sensor", "ideal", f"sensor.width={width}", f"sensor.height={height}"]
    return [*words, "--unit", "dn", "--threads", "1", "--quiet", "--force"]


def converter(folder: Path, frames: Any) -> Callable[[], int]:
    """The whole command in this process; how many bytes it wrote."""
    words = converter_words(folder, frames)

    def run() -> int:
        assert main(words) == 0
        return (folder / "run.aedat4").stat().st_size

    return run


def as_installed() -> dict[str, str]:
    """The environment of both programs: they may keep their bytecode, as installed ones do."""
    return {name: os.environ[name] for name in os.environ if name != "PYTHONDONTWRITEBYTECODE"}


def program_of_v2e(folder: Path) -> Callable[[], object]:
    """The whole of v2e on the film of `converter`; AbsentError where it is missing."""
    if not V2E.exists():
        raise AbsentError(MISSING)
    options = {"pos_thres": 0.2, "neg_thres": 0.2, **NOISE}
    options["refractory_period"] = options.pop("refractory_period_s")
    words = [str(V2E), str(PEER), "program", "-i", str(folder / "film.mp4")]
    words += ["-o", str(folder / "v2e"), "--overwrite", "--disable_slomo"]
    words += ["--input_frame_rate", "1000", "--auto_timestamp_resolution", "False"]
    words += ["--timestamp_resolution", "0.001", "--dvs_exposure", "source", "--no_preview"]
    words += ["--output_width", "346", "--output_height", "260", "--skip_video_output"]
    words += ["--dvs_aedat4", "v2e.aedat4", "--dvs_aedat2", "None", "--dvs_text", "None"]
    words += [word for key, value in options.items() for word in (f"--{key}", str(value))]
    one_core = {**as_installed(), "OMP_NUM_THREADS": "1", "MKL_NUM_THREADS": "1"}

    def run() -> None:
        subprocess.run(words, env=one_core, capture_output=True, check=True)
        assert (folder / "v2e/v2e.aedat4").stat().st_size > 0

    return run


def coded(width: int, height: int, frames: int) -> Any:
    """The film of speed.drifting, as 8-bit sRGB."""
    light = film(width, height, frames)
    value = np.where(light <= 0.0031308, 12.92 * light, 1.055 * light ** (1 / 2.4) - 0.055)
    return np.rint(255 * value).astype(np.uint8)


@pytest.mark.bench
def test_a_frame_of_a_film_beside_v2e_and_eventcv(tmp_path: Path) -> None:
    columns: dict[str, dict[str, Time]] = {}
    yardsticks = {OURS: PEER_EVENTCV}
    for size, (width, height, frames) in SIZES.items():
        folder = tmp_path / size
        folder.mkdir()
        shown = coded(width, height, frames)
        calls: dict[str, Callable[[], object]] = {}
        with ExitStack() as stack:
            one_core = {"RAYON_NUM_THREADS": "1"}
            peer = stack.enter_context(
                elsewhere(eventcv, width, height, frames, {}, environment=one_core)
            )
            calls = {PEER_EVENTCV: peer.call, OURS: pixels_of(shown, "auto")}
            try:
                calls[PEER_V2E] = stack.enter_context(V2e(folder, shown))
                yardsticks |= {OURS_DN: PEER_V2E, WHOLE: PEER_V2E}
            except AbsentError as absent:
                print(f"{size}: {absent}")
            calls[OURS_DN], calls[WHOLE] = pixels_of(shown, "dn"), converter(folder, shown)
            events = {name: call() for name, call in calls.items() if name != WHOLE}
            print(
                f"events a frame, {size}: "
                + ", ".join(f"{name} {count / (frames - 1):.0f}" for name, count in events.items())  # type: ignore[operator]
            )
            taken = milliseconds(calls, ROUNDS)
        columns[size] = {name: time / (frames - 1) for name, time in taken.items()}
        columns[size][WHOLE] = columns[size][WHOLE] / REPEATS
    print(Table("a frame of a film, one core", columns, yardsticks))
    for size, times in columns.items():
        for row in (OURS_DN, WHOLE):
            print(f"{row}, {size}: {times[row]} ms")
        if PEER_V2E in times:
            ratio = times[PEER_V2E].median / times[OURS_DN].median
            print(target(f"{OURS_DN}, {size}", ratio, 10, "x"))
        assert times[OURS].median > 0


@pytest.mark.bench
def test_a_whole_film_beside_v2e(tmp_path: Path) -> None:
    """Program beside program, from one film in H.264 to an AEDAT4 file, starting included.

    The first round, which compiles what is imported, does not count.
    """
    width, height, frames = SIZES["346x260"]
    convert_words = converter_words(tmp_path, coded(width, height, frames))
    ours = [sys.executable, "-m", "evs.launch.main", *convert_words]

    def convert() -> None:
        subprocess.run(ours, env=as_installed(), capture_output=True, check=True)

    calls: dict[str, Callable[[], object]] = {PROGRAM: convert}
    try:
        calls[PROGRAM_V2E] = program_of_v2e(tmp_path)
    except AbsentError as absent:
        print(absent)
    taken = milliseconds(calls, PROGRAM_ROUNDS)
    count = REPEATS * (frames - 1)
    for name, time in taken.items():
        print(f"{name}, {count} frames of {width} x {height}: {time} ms")
    if PROGRAM_V2E in taken:
        ratio = taken[PROGRAM_V2E].median / taken[PROGRAM].median
        print(target(PROGRAM, ratio, 10, "x"))
    assert taken[PROGRAM].median > 0
