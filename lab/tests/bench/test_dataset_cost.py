"""What a simulated second of each scene of the data set costs: processor seconds, and bytes.

`.venv/bin/pytest -m bench -s lab/tests/bench/test_dataset_cost.py` prints the table of
docs/howto/datasets.md: it makes TICKS ticks and one frame of each scene, 2 s into it, with one
thread. Processor time, so that it holds for planning; neighbours on the machine still move it.
"""

from __future__ import annotations

import time
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from evs.emulator import World
from evs.tools.dataset import named, names
from evs.tools.dataset.sequence_spec import SequenceSpec, make_sequence_spec
from evs.tools.dataset.shards import EVENTS, FRAMES, EventShard, FrameShard

TICKS = 10
BEGIN_S = 2.0

WAYS = {
    "path": ("16 samples, frames of 256", []),
    "direct": ("4 samples, frames of 64", [("render.renderer", "direct"), ("frames.spp", "64")]),
}


def seconds_of(
    sequence: SequenceSpec, folder: Path, shard: type[EventShard] | type[FrameShard]
) -> float:
    """Processor seconds of a shard's making, without what leads up to its begin."""
    job = shard(sequence, 0, sequence.begin, sequence.end)
    folder.mkdir()
    before = time.process_time()
    job.make(folder)
    return time.process_time() - before


def lead_up(sequence: SequenceSpec) -> float:
    """Processor seconds of the physics up to the begin, and of building world and camera."""
    before = time.process_time()
    with sequence.with_model_file() as config:
        if sequence.begin:
            sequence.world_at_begin(config)
        else:
            World.from_config(config)
    return time.process_time() - before


@pytest.mark.bench
@pytest.mark.slow
@pytest.mark.parametrize("way", WAYS)
def test_cost_of_a_scene_second(way: str, tmp_path: Path) -> None:
    config_json, keys = WAYS[way]
    print(f"\n{way}: {config_json}; for a simulated second, 346 x 260, one thread")
    print(
        f"{'scene':10s}{'physics':>9s}{'events':>9s}{'frames':>9s} CPU s{'events':>12s}{'MB':>7s}"
    )
    total = 0.0
    for name in names():
        # what the camera sees before the recording is paid once a scene
        common = [("threads", "1"), ("begin_s", f"{BEGIN_S}"), ("settle_s", "0")]
        common += [("frames.fps", "60"), *keys]
        scene = named(name, [*common, ("duration_s", f"{TICKS / 1000}")])
        sequence = make_sequence_spec(name, scene)
        begin_s = lead_up(sequence)
        film_s = seconds_of(sequence, tmp_path / f"{name}_events", EventShard) - begin_s
        # the second frame's tick lies beyond one tick: one frame alone
        one = replace(sequence, end=sequence.begin + 1)
        frame_s = seconds_of(one, tmp_path / f"{name}_frame", FrameShard) - begin_s
        events_s, frames_s = film_s * 1000 / TICKS, 60 * frame_s
        files = (tmp_path / f"{name}_events" / EVENTS, tmp_path / f"{name}_frame" / FRAMES)
        megabytes = (files[0].stat().st_size * 1000 / TICKS + files[1].stat().st_size * 60) / 1e6
        count = _events(files[0]) * 1000 / TICKS
        print(
            f"{name:10s}{begin_s / BEGIN_S:9.2f}{events_s:9.0f}{frames_s:9.0f}      "
            f"{count:12,.0f}{megabytes:7.0f}"
        )
        total += (events_s + frames_s) * named(name).duration_s
        assert film_s > 0
        assert frame_s > 0
    print(f"the whole set: {total / 3600:.1f} hours of a core")


def _events(path: Path) -> int:
    with np.load(path) as arrays:
        return len(arrays["t"])
