"""Ten minutes of simulated time in lock-step with the whole of a DVS128.

It takes two minutes and more, so `make bench` leaves it out:
`.venv/bin/pytest -m bench -s lab/tests/bench/test_closed_minutes.py`. test_closed_long.py in
tests/emulator/simulation has the same with fewer pixels.
"""

from __future__ import annotations

import time

import pytest

from reference.lockstep_minutes import check, run

TICKS = 600_000


@pytest.mark.bench
@pytest.mark.slow
def test_ten_minutes_of_a_whole_dvs128():
    began = time.perf_counter()
    said = run(128, TICKS)
    check(said, TICKS)
    peaks = said["peaks"]
    print(
        f"\n  600 s simulated in {time.perf_counter() - began:.0f} s, {said['events']} events, "
        f"{said['packets']} packets, {said['dropped']} dropped by the link as asked; peak "
        f"{peaks[0] / 1024:.1f} MiB after a minute, {peaks[-1] / 1024:.1f} MiB after ten"
    )
