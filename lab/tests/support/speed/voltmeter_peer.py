"""DVS-Voltmeter as a program of its own (MIT), from a checkout of it, in any venv with torch.

`CHECKOUT FRAMES.npy TIMES.npy SEED EVENTS.npy` writes the events of the frames (DN) at their times
(us), (n, 4) int: t (us), x, y, 1 or 0, with its authors' parameters of a DAVIS346. Imports nothing
of ours.
"""

from __future__ import annotations

import sys
import types
import warnings

import numpy as np


def events(checkout: str, film: str, times: str, seed: str, target: str) -> None:
    """Emulate the frames of a file, once."""
    import torch

    # its configuration only wants a namespace from that library
    names = types.ModuleType("easydict")
    names.EasyDict = types.SimpleNamespace  # type: ignore[attr-defined]
    sys.modules.setdefault("easydict", names)
    sys.path.insert(0, checkout)
    from src.config import cfg
    from src.simulator import EventSim

    # of torch, about an argument of its meshgrid
    warnings.filterwarnings("ignore", category=UserWarning)
    torch.set_num_threads(1)
    torch.manual_seed(int(seed))
    emulator = EventSim(cfg=cfg, output_folder=".", video_name="film")
    parts = [np.empty((0, 4), np.int64)]
    for now_us, frame in zip(np.load(times), np.load(film, mmap_mode="r"), strict=True):
        found = emulator.generate_events(np.array(frame), int(now_us))
        if found is not None:
            parts.append(found.astype(np.int64))
    np.save(target, np.concatenate(parts))


if __name__ == "__main__":
    events(*sys.argv[1:])
