"""Samples a second: simulated when they are taken, beside slices of a recording.

.venv/bin/pytest -m bench -s lab/tests/bench/test_simulated_dataset_speed.py
"""

from __future__ import annotations

from collections.abc import Callable
from itertools import count
from pathlib import Path

import pytest

import evs
from evs.drivers.files import recorder_for
from evs.emulator.base.package_paths import in_package
from speed.turns import milliseconds

SCENE, CAMERA = "evs:config/scenes/pantilt.xml", "eye"
BATCH, TICKS, ROUNDS = 16, 50, 7
SIZES = ((64, 64), (346, 260))


def recorded(file: Path, sensor: evs.SensorConfig) -> evs.EventSlices:
    """Slices of one run, as many as a batch has, as the same voxel grids."""
    world = evs.World(in_package(SCENE), control="random")
    camera = world.add_camera(CAMERA, sensor=sensor)
    sink = recorder_for(file)
    sink.open([camera.info])
    for _ in range((BATCH + 1) * TICKS):
        sink.write(world.step()[0])
    sink.close()
    size = (camera.info.width, camera.info.height)
    return evs.EventSlices(
        file,
        span_us=TICKS * 1000,
        encode=lambda events, interval: evs.voxel_grid(events, 5, size, interval),
    )


def drawing(sensor: evs.SensorConfig, threads: int) -> Callable[[], object]:
    """What simulates the next batch."""
    dataset = evs.SimulatedDataset(
        SCENE, CAMERA, samples=10**6, sensor=sensor, ticks=TICKS, threads=threads
    )
    firsts = count(step=BATCH)

    def draw() -> object:
        first = next(firsts)
        return dataset.__getitems__(range(first, first + BATCH))

    return draw


def measured(size: tuple[int, int], file: Path) -> str:
    """A row of the table."""
    width, height = size
    sensor = evs.SensorConfig("davis346", width=width, height=height)
    slices = recorded(file, sensor)
    calls = {
        "one": drawing(sensor, 1),
        "two": drawing(sensor, 2),
        "slices": lambda: slices[:BATCH],
    }
    rates = [1e3 * BATCH / one.median for one in milliseconds(calls, ROUNDS).values()]
    assert min(rates) > 0
    mb = file.stat().st_size / 1e6 / (BATCH + 1)
    return f"| {width}x{height} | {' | '.join(f'{one:.3g}' for one in rates)} | {mb:.2g} |"


@pytest.mark.bench
def test_samples_a_second(tmp_path: Path) -> None:
    print(f"\nsamples of {TICKS} ms a second, in batches of {BATCH}\n")
    print("| px | simulated, one core | two cores | slices of an AEDAT4 file | their size, MB |")
    print("|---|---|---|---|---|")
    for size in SIZES:
        print(measured(size, tmp_path / f"{size[0]}.aedat4"))
