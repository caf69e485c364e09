"""v2e as a program of its own (MIT, in a venv of its own): `frames FRAMES.npy OPTIONS.json`.

Each line on stdin requests the film once more, onwards and back in turns, as a camera goes on; the
answer is a line with the number of events. There is no interpolation: that is `--disable_slomo`.
`events FRAMES.npy TIMES.npy OPTIONS.json EVENTS.npy` writes the events instead, (n, 4) float64:
t (s), x, y, 1 or -1. `program ARGUMENTS...` is the whole of v2e instead. Imports nothing of ours.
"""

from __future__ import annotations

import json
import logging
import runpy
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


def program(arguments: list[str]) -> None:
    """Run v2e's own program, as its user does."""
    script = Path(sys.executable).with_name("v2e.py")
    sys.argv = [str(script), *arguments]
    runpy.run_path(str(script), run_name="__main__")


def frames(film: str, options_file: str) -> None:
    """Emulate the frames of a file, once for each line on stdin."""
    import torch
    from v2ecore.emulator import EventEmulator

    logging.disable(logging.CRITICAL)
    torch.set_num_threads(1)
    shown = np.load(film)
    options = json.loads(Path(options_file).read_text())
    emulator = EventEmulator(device="cpu", **options)
    now_ms = 0
    emulator.generate_events(shown[0], 0.0)
    onwards, back = list(shown[1:]), list(shown[-2::-1])
    print("ready", flush=True)
    for _ in sys.stdin:
        events = 0
        for frame in onwards:
            now_ms += 1
            found = emulator.generate_events(frame, now_ms * 1e-3)
            events += 0 if found is None else len(found)
        onwards, back = back, onwards
        print(events, flush=True)


def events(film: str, times: str, options_file: str, target: str) -> None:
    """Emulate the frames of a file at their times (s), once."""
    import torch
    from v2ecore.emulator import EventEmulator

    logging.disable(logging.CRITICAL)
    torch.set_num_threads(1)
    shown = np.load(film, mmap_mode="r")
    options = json.loads(Path(options_file).read_text())
    emulator = EventEmulator(device="cpu", **options)
    parts = [np.empty((0, 4))]
    for now_s, frame in zip(np.load(times), shown, strict=True):
        found = emulator.generate_events(np.array(frame), float(now_s))
        if found is not None:
            parts.append(np.asarray(found, np.float64))
    np.save(target, np.concatenate(parts))


if __name__ == "__main__":
    without_windows()
    if sys.argv[1] == "program":
        program(sys.argv[2:])
    elif sys.argv[1] == "events":
        events(*sys.argv[2:])
    else:
        frames(*sys.argv[2:])
