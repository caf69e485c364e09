"""tonic's view of AEDAT2, AEDAT3.1 and N-MNIST files: FILE... gives one JSON line a file.

tonic is under the GPL: it lies in a virtual environment of its own (.ci/setup.sh makes it) and runs
in a process of its own. Only its io module is loaded, which needs numpy alone.
"""

from __future__ import annotations

import hashlib
import importlib.util
import json
import sys
from pathlib import Path
from typing import Any

import numpy as np

COLUMNS = ("<i8", "<i2", "<i2", "i1")


def digest(t: Any, x: Any, y: Any, p: Any) -> str:
    """One hash over the four columns."""
    summed = hashlib.sha256()
    for column, kind in zip((t, x, y, p), COLUMNS, strict=True):
        summed.update(np.ascontiguousarray(column).astype(kind).tobytes())
    return summed.hexdigest()


def tonic_io() -> Any:
    """tonic's module of readers, without the rest of tonic, which wants much more installed."""
    found = importlib.util.find_spec("tonic")
    assert found is not None
    assert found.submodule_search_locations is not None
    path = Path(found.submodule_search_locations[0], "io.py")
    spec = importlib.util.spec_from_file_location("tonic_io", path)
    assert spec is not None
    assert spec.loader is not None
    module = importlib.util.module_from_spec(spec)
    spec.loader.exec_module(module)
    return module


def look(path: str) -> dict[str, Any]:
    """Events of one file; AEDAT3.1's stamps as they stand in the packets, without overflows."""
    io = tonic_io()
    if path.endswith(".bin"):
        events = io.read_mnist_file(path, io.events_struct)
        columns = [events[name] for name in "txyp"]
        return {"version": None, "events": len(events), "digest": digest(*columns)}
    version, data_at, _ = io.read_aedat_header_from_file(path)
    if version < 3:
        _, _, events = io.read_davis_346(path)
        t, x, y, p = (events[name] for name in "txyp")
    else:
        raw = io.get_aer_events_from_file(path, version, data_at)
        # as its readers of AEDAT3.1 do (read_dvs_red), with 15 bits for y as well
        address, t = raw["address"], raw["timeStamp"]
        x, y, p = address >> 17 & 0x7FFF, address >> 2 & 0x7FFF, address >> 1 & 1
    return {"version": version, "events": len(t), "digest": digest(t, x, y, p)}


if __name__ == "__main__":
    for given in sys.argv[1:]:
        print(json.dumps({"path": given, **look(given)}), flush=True)
