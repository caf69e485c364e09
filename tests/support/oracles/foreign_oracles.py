"""Other projects' view of RAW, DAT, HDF5 and bag files, as a program: one JSON line a file.

READER FILE..., where READER is faery, eventcv, h5py or rosbags; each runs in a process of its own,
since faery has another licence. `write FORMAT FILE EVENTS.npy` makes a file with faery or h5py
instead.
"""

from __future__ import annotations

import hashlib
import json
import sys
from pathlib import Path
from typing import Any

import numpy as np

COLUMNS = ("<i8", "<i2", "<i2", "i1")


def digest(*columns: Any) -> str:
    """One hash over t, x, y, p."""
    summed = hashlib.sha256()
    for column, kind in zip(columns, COLUMNS, strict=True):
        summed.update(np.ascontiguousarray(column).astype(kind).tobytes())
    return summed.hexdigest()


def faery_events(path: str) -> tuple[Any, dict[str, Any]]:
    import faery

    stream = faery.events_stream_from_file(path)
    parts = [np.array(part) for part in stream]
    whole = np.concatenate(parts) if parts else np.zeros(0, "i8,i2,i2,i1")
    t, x, y, p = whole.dtype.names
    facts = {"size": list(stream.dimensions())}
    return (whole[t], whole[x], whole[y], whole[p]), facts


def eventcv_events(path: str) -> tuple[Any, dict[str, Any]]:
    import eventcv

    x, y, t, p = np.asarray(eventcv.load(path).numpy()).T
    return (t, x, y, p), {}


def h5py_events(path: str) -> tuple[Any, dict[str, Any]]:
    import h5py

    with h5py.File(path) as file:
        columns = [file["events"][name][()] for name in "txyp"]
        index = file["ms_to_idx"][()]
        # the slice of a time window, as data set loaders take it by the index of ms
        wrong = 0
        for ms in range(0, len(index), max(1, len(index) // 200)):
            wrong += int(index[ms]) != int(np.searchsorted(columns[0], ms * 1000))
        columns[0] = columns[0] + file["t_offset"][()]
        facts = {"wrong": wrong, "indices": len(index), "integer": columns[0].dtype.kind == "i"}
    return columns, facts


def rosbags_events(path: str) -> tuple[Any, dict[str, Any]]:
    """By rosbags' own types, a Python object an event where it is dvs_msgs."""
    from rosbags.highlevel import AnyReader

    parts: list[Any] = []
    facts: dict[str, Any] = {"topics": [], "encodings": [], "seq": []}
    with AnyReader([Path(path)]) as bag:
        facts["topics"] = sorted(f"{one.topic} {one.msgtype}" for one in bag.connections)
        for topic, _, data in bag.messages():
            if not topic.topic.endswith("/events"):
                continue
            said = bag.deserialize(data, topic.msgtype)
            facts["size"] = [said.width, said.height]
            facts["frame_id"] = said.header.frame_id
            if "EventArray" in topic.msgtype:
                rows = [
                    (e.ts.sec * 1_000_000 + e.ts.nanosec // 1000, e.x, e.y, e.polarity)
                    for e in said.events
                ]
                parts.append(np.array(rows, np.int64).reshape(-1, 4))
                continue
            facts["encodings"].append(said.encoding)
            facts["seq"].append(said.seq)
            words = said.events.view("<u8")
            if said.encoding == "mono":
                t = (words & 0xFFFFFFFF) // 1000 + said.time_base // 1000
                columns = [t, words >> 32 & 0xFFFF, words >> 48 & 0x7FFF, words >> 63]
            elif said.encoding == "libcaer":
                low = (words >> 32).astype(np.int64)
                low[1:] += np.cumsum(np.diff(low) < 0) << 31
                t = low + said.time_base // 1000
                columns = [t, words >> 17 & 0x7FFF, words >> 2 & 0x7FFF, words >> 1 & 1]
            else:
                continue
            parts.append(np.stack([column.astype(np.int64) for column in columns], 1))
    whole = np.concatenate(parts) if parts else np.zeros((0, 4), np.int64)
    return whole.T, facts


READERS = {
    "faery": faery_events,
    "eventcv": eventcv_events,
    "h5py": h5py_events,
    "rosbags": rosbags_events,
}


def write(kind: str, path: str, events: Any) -> None:
    """A file by somebody else's writer."""
    if kind == "rpg":
        import h5py

        with h5py.File(path, "w") as file:
            file["events/ts"] = events["t"] * 1e-6
            file["events/xs"], file["events/ys"] = events["x"], events["y"]
            file["events/ps"] = np.where(events["p"] > 0, 1.0, -1.0)
            file.attrs["sensor_resolution"] = (720, 1280)
        return
    if kind == "dsec":
        import h5py
        import hdf5plugin

        offset = int(events["t"][0]) // 1000 * 1000
        t = (events["t"] - offset).astype("u4")
        packed = hdf5plugin.Blosc(cname="zstd", clevel=1, shuffle=hdf5plugin.Blosc.SHUFFLE)
        with h5py.File(path, "w") as file:
            columns = {"t": t, "x": events["x"], "y": events["y"], "p": events["p"]}
            for name, kind_of in zip("txyp", ("u4", "u2", "u2", "u1"), strict=True):
                data = columns[name].astype(kind_of)
                file.create_dataset(f"events/{name}", data=data, chunks=(1000,), **packed)
            file["ms_to_idx"] = np.searchsorted(t, np.arange(t[-1] // 1000 + 1) * 1000)
            file["t_offset"] = np.int64(offset)
        return
    import faery

    if kind == "dat":
        rows = np.zeros(len(events), [("t", "u8"), ("x", "u2"), ("y", "u2"), ("payload", "u1")])
        encoder = faery.dat.Encoder(path, "dat2", "cd", False, (1280, 720))
    else:
        rows = np.zeros(len(events), [("t", "u8"), ("x", "u2"), ("y", "u2"), ("on", "?")])
        encoder = faery.evt.Encoder(path, kind, False, (1280, 720), True)
    for ours, theirs in zip("txyp", rows.dtype.names, strict=True):
        rows[theirs] = events[ours]
    with encoder:
        encoder.write(rows if kind == "dat" else {"events": rows})


if __name__ == "__main__":
    if sys.argv[1] == "write":
        write(sys.argv[2], sys.argv[3], np.load(sys.argv[4]))
    else:
        for given in sys.argv[2:]:
            found, told = READERS[sys.argv[1]](given)
            told |= {"path": given, "events": len(found[0]), "digest": digest(*found)}
            print(json.dumps(told), flush=True)
