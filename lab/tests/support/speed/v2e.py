"""Where v2e lies. It is not on PyPI, so its venv is made by hand; v2e_peer.py runs in it."""

from __future__ import annotations

import json
import subprocess
from collections.abc import Sequence
from pathlib import Path
from typing import Any

import numpy as np
import numpy.typing as npt

from speed.elsewhere import AbsentError

CHECKOUT = Path(__file__).parents[4]
PEER = Path(__file__).with_name("v2e_peer.py")
V2E = CHECKOUT / "build/venvs/v2e/bin/python"
MISSING = (
    "v2e is not installed: python3 -m venv build/venvs/v2e && build/venvs/v2e/bin/pip install "
    "git+https://github.com/SensorsINI/v2e"
)


def v2e_events(
    folder: Path,
    frames: npt.NDArray[Any],
    options: dict[str, Any],
    times_us: Sequence[int] | None = None,
) -> npt.NDArray[np.float64]:
    """The events of a film by v2e's emulator.

    Args:
        folder: For the files by which the two processes talk.
        frames: (n, h, w) DN, of any dtype.
        options: Arguments of its EventEmulator.
        times_us: When the frames are; None: 1 ms apart.

    Returns:
        (n, 4): t (s), x, y, 1 or -1.

    Raises:
        AbsentError: v2e is missing, or fails.
    """
    if not V2E.exists():
        raise AbsentError(MISSING)
    names = ("film.npy", "times.npy", "options.json", "events.npy")
    film, times, asked, made = (folder / name for name in names)
    np.save(film, frames)
    np.save(times, 1e-3 * np.arange(len(frames)) if times_us is None else np.array(times_us) * 1e-6)
    asked.write_text(json.dumps(options))
    words = [str(word) for word in (V2E, PEER, "events", film, times, asked, made)]
    run = subprocess.run(words, capture_output=True, text=True)
    if run.returncode:
        raise AbsentError(f"v2e failed: {(run.stderr.strip().splitlines() or ['silently'])[-1]}")
    return np.asarray(np.load(made))
