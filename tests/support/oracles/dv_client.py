"""iniVation's own NetworkReader as a program: KIND HOST PORT [SECONDS TO SLEEP FIRST].

Prints one JSON line when connected, and one with all that it got when the server hung up.
"""

from __future__ import annotations

import hashlib
import json
import sys
import time
from typing import Any

import numpy as np

COLUMNS = ("<i8", "<i2", "<i2", "i1")


def rows(kind: str, batch: Any) -> list[Any]:
    if kind == "frames":
        pixels = np.ascontiguousarray(batch.image)
        digest = hashlib.sha256(pixels.tobytes()).hexdigest()
        return [[batch.timestamp, str(pixels.dtype), list(pixels.shape), digest]]
    if kind == "imu":
        return [
            [one.timestamp, one.temperature]
            + [one.accelerometerX, one.accelerometerY, one.accelerometerZ]
            + [one.gyroscopeX, one.gyroscopeY, one.gyroscopeZ]
            for one in batch
        ]
    return [[one.timestamp, int(one.type)] for one in batch]


def main() -> None:
    import dv_processing as dv

    kind, host, port, *first = sys.argv[1:]
    for _ in range(200):
        try:
            reader = dv.io.NetworkReader(host, int(port))
            break
        except RuntimeError:
            # nobody serves there yet
            time.sleep(0.05)
    available = {
        "events": reader.isEventStreamAvailable,
        "frames": reader.isFrameStreamAvailable,
        "imu": reader.isImuStreamAvailable,
        "triggers": reader.isTriggerStreamAvailable,
    }
    there = [name for name, ask in available.items() if ask()]
    size = list(reader.getEventResolution() or ()) if kind == "events" else []
    said = {"streams": there, "camera": reader.getCameraName(), "size": size}
    print(json.dumps(said), flush=True)
    if first:
        time.sleep(float(first[0]))
    take = {
        "events": reader.getNextEventBatch,
        "frames": reader.getNextFrame,
        "imu": reader.getNextImuBatch,
        "triggers": reader.getNextTriggerBatch,
    }[kind]
    stores: list[Any] = []
    found: list[Any] = []
    quiet = 0
    while quiet < 20:
        batch = take()
        if batch is not None:
            quiet = 0
            if kind == "events":
                stores.append(batch.numpy())
            else:
                found += rows(kind, batch)
        else:
            # what was sent before it hung up may still be on its way through the reader
            quiet += not reader.isRunning()
            time.sleep(0.005)
    whole = np.concatenate(stores) if stores else np.zeros(0, "i8,i2,i2,i1")
    summed = hashlib.sha256()
    for name, column in zip(whole.dtype.names or (), COLUMNS, strict=True):
        summed.update(np.ascontiguousarray(whole[name]).astype(column).tobytes())
    ends = [int(whole[0][0]), int(whole[-1][0])] if len(whole) else []
    told = {"events": len(whole), "digest": summed.hexdigest(), "ends": ends, "rows": found}
    print(json.dumps(told), flush=True)


if __name__ == "__main__":
    main()
