"""Where DVS-Voltmeter lies. It is no package: a checkout, run by v2e's venv, as that has torch."""

from __future__ import annotations

import subprocess
from collections.abc import Sequence
from pathlib import Path
from typing import Any

import numpy as np
import numpy.typing as npt

from speed.elsewhere import AbsentError
from speed.v2e import CHECKOUT, V2E

PEER = Path(__file__).with_name("voltmeter_peer.py")
VOLTMETER = CHECKOUT / "build/venvs/dvs-voltmeter"
MISSING = (
    "DVS-Voltmeter is missing: git clone https://github.com/Lynn0306/DVS-Voltmeter "
    "build/venvs/dvs-voltmeter; v2e's venv runs it"
)


def voltmeter_events(
    folder: Path, frames: npt.NDArray[Any], times_us: Sequence[int], seed: int
) -> npt.NDArray[np.int64]:
    """The events of a film by DVS-Voltmeter, with its parameters of a DAVIS346.

    Args:
        folder: For the files by which the two processes talk.
        frames: (n, h, w) DN, of any dtype.
        times_us: When they are.
        seed: Of its noise.

    Returns:
        (n, 4): t (us), x, y, 1 or 0.

    Raises:
        AbsentError: It is missing, or fails.
    """
    if not (VOLTMETER / "src/simulator.py").exists() or not V2E.exists():
        raise AbsentError(MISSING)
    film, times, made = (folder / name for name in ("film.npy", "times.npy", "events.npy"))
    np.save(film, frames)
    np.save(times, np.array(times_us))
    words = [str(word) for word in (V2E, PEER, VOLTMETER, film, times, seed, made)]
    run = subprocess.run(words, capture_output=True, text=True)
    if run.returncode:
        last = (run.stderr.strip().splitlines() or ["silently"])[-1]
        raise AbsentError(f"DVS-Voltmeter failed: {last}")
    return np.asarray(np.load(made))
