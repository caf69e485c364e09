"""v2e's emulator as a program of its own: `FRAMES.npy OPTIONS.json` (MIT, in a venv of its own).

Each line on stdin requests the film once more, onwards and back in turns, as a camera goes on; the
answer is a line with the number of events. There is no interpolation: that is `--disable_slomo`.
Imports nothing of ours.
"""

from __future__ import annotations

import json
import logging
import sys
import types
from pathlib import Path

import numpy as np


def without_windows() -> None:
    """What v2e imports for its windows, where a machine has none; the emulator opens none."""
    for name in ("tkinter", "easygui", "screeninfo"):
        try:
            __import__(name)
        except ImportError:
            module = types.ModuleType(name)
            module.filedialog = module.get_monitors = None  # type: ignore[attr-defined]
            sys.modules[name] = module


def main() -> None:
    without_windows()
    import torch
    from v2ecore.emulator import EventEmulator

    logging.disable(logging.CRITICAL)
    torch.set_num_threads(1)
    frames = np.load(sys.argv[1])
    options = json.loads(Path(sys.argv[2]).read_text())
    emulator = EventEmulator(device="cpu", **options)
    now_ms = 0
    emulator.generate_events(frames[0], 0.0)
    onwards, back = list(frames[1:]), list(frames[-2::-1])
    print("ready", flush=True)
    for _ in sys.stdin:
        events = 0
        for frame in onwards:
            now_ms += 1
            found = emulator.generate_events(frame, now_ms * 1e-3)
            events += 0 if found is None else len(found)
        onwards, back = back, onwards
        print(events, flush=True)


if __name__ == "__main__":
    main()
