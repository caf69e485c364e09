"""Recordings of bars that move left, right, up or down, and slices of them as a data set."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import numpy.typing as npt

from evs.drivers.files import EventSlices, recorder_for
from evs.emulator import Pixels
from evs.msgs import Events

NAMES = ("left", "right", "up", "down")
SIZE = (32, 32)
SPAN_US = 40_000
"""length of a sample"""
BINS = 8
"""steps of a sample in time"""


def record(folder: Path, samples: int = 100, seed: int = 0) -> list[Path]:
    """Record a run for each direction.

    Args:
        folder: Made if it does not exist.
        samples: Of SPAN_US each; speed, contrast and place of the bars differ in each.
        seed: What everything follows from.

    Returns:
        The files, in the order of NAMES.
    """
    folder.mkdir(parents=True, exist_ok=True)
    files = []
    for label, name in enumerate(NAMES):
        random = np.random.default_rng((seed, label))
        pixels = Pixels("davis346", size=SIZE, unit="luminance", seed=seed, name=name)
        file = folder / f"{name}.npz"
        sink = recorder_for(file)
        sink.open([pixels.info])
        for sample in range(samples):
            speed, phase = random.uniform(0.1, 0.4), random.uniform(0, 16)
            dark, bright = random.uniform(0.1, 0.3), random.uniform(0.5, 1.0)
            for tick in range(SPAN_US // 1000):
                moved = phase + speed * tick * (1 if name in ("left", "up") else -1)
                wave = (np.arange(SIZE[0]) + moved) % 16 < 6
                frame = np.where(wave, bright, dark).astype(np.float32) * np.ones((32, 1), "f4")
                if name in ("up", "down"):
                    frame = np.ascontiguousarray(frame.T)
                pixels.observe(frame, sample * SPAN_US + tick * 1000)
                if pixels.packet is not None:
                    sink.write(pixels.packet)
        sink.close()
        files.append(file)
    return files


def in_bins(events: Events, interval: tuple[int, int]) -> npt.NDArray[np.float32]:
    """Count the events of a slice: (BINS, 2, h, w), OFF then ON."""
    begin, end = interval
    counts = np.zeros((BINS, 2, SIZE[1], SIZE[0]), np.float32)
    bins = (events["t"] - begin) * BINS // (end - begin)
    np.add.at(counts, (bins, events["p"], events["y"], events["x"]), 1.0)
    return counts


class Directions:
    """A data set for PyTorch's DataLoader: a sample is (BINS, 2, h, w) and its direction."""

    def __init__(self, files: list[Path]) -> None:
        self.slices = EventSlices(files, span_us=SPAN_US, encode=in_bins)

    def __len__(self) -> int:
        return len(self.slices)

    def __getitem__(self, index: int) -> tuple[npt.NDArray[np.float32], int]:
        return self.slices[index], self.slices.source(index)
