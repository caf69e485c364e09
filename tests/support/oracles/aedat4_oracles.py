"""Other projects' view of AEDAT4 files, as a program: READER FILE... gives one JSON line a file.

READER is dv-processing, aedat or faery; each runs in a process of its own, since they print, warn,
panic, and (faery) have another licence. `write FOLDER` makes files with dv-processing instead.
"""

from __future__ import annotations

import hashlib
import json
import sys
from collections.abc import Iterator
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


def dv_packets(path: str, facts: dict[str, Any]) -> Iterator[Any]:
    import dv_processing

    file = dv_processing.io.MonoCameraRecording(path)
    facts["resolution"] = list(file.getEventResolution())
    facts["camera"] = file.getCameraName()
    facts["info"] = file.getStreamMetadata("events")
    facts["range"] = list(file.getTimeRange())
    while (store := file.getNextEventBatch()) is not None:
        yield store.numpy()
    # by the data table, where there is one: a seek into the middle
    first, last = facts["range"]
    if first < last:
        middle = (first + last) // 2
        found = file.getEventsTimeRange(middle, last + 1)
        facts["second_half"] = 0 if found is None else len(found)
        facts["middle"] = middle


def hashed(*columns: Any) -> str:
    """One hash over arrays' bytes."""
    summed = hashlib.sha256()
    for column in columns:
        summed.update(np.ascontiguousarray(column).tobytes())
    return summed.hexdigest()


def dv_beside(path: str) -> dict[str, Any]:
    """What dv-processing sees of frames and IMU."""
    import dv_processing

    file = dv_processing.io.MonoCameraRecording(path)
    frames, samples = [], []
    if file.isFrameStreamAvailable():
        while (frame := file.getNextFrame()) is not None:
            exposure_us = round(frame.exposure.total_seconds() * 1e6)
            image = np.array(frame.image)
            frames.append([frame.timestamp, exposure_us, str(image.dtype), hashed(image)])
    if file.isImuStreamAvailable():
        while (batch := file.getNextImuBatch()) is not None:
            for one in batch:
                force = (one.accelerometerX, one.accelerometerY, one.accelerometerZ)
                turn = (one.gyroscopeX, one.gyroscopeY, one.gyroscopeZ)
                samples.append((one.timestamp, one.temperature, *force, *turn))
    triggers = []
    if file.isTriggerStreamAvailable():
        while (marks := file.getNextTriggerBatch()) is not None:
            triggers += [[one.timestamp, int(one.type)] for one in marks]
    values = np.array([row[1:] for row in samples], np.float32).reshape(-1, 7)
    stamps = np.array([row[0] for row in samples], np.int64)
    size = list(file.getFrameResolution() or ()) if frames else []
    told = {"imu": hashed(stamps, values), "samples": len(stamps), "triggers": triggers}
    return {"frames": frames, "size": size, **told}


def aedat_beside(path: str) -> dict[str, Any]:
    """What aedat sees of them; it gives the stamps of the frame too."""
    import aedat

    frames, stamps, values, triggers = [], [], [], []
    names = [f"{kind}_{axis}" for kind in ("accelerometer", "gyroscope") for axis in "xyz"]
    for packet in aedat.Decoder(path):
        if "frame" in packet:
            one = packet["frame"]
            keys = ("begin_t", "exposure_begin_t", "exposure_end_t", "end_t", "format")
            frames.append([*(one[key] for key in keys), hashed(one["pixels"])])
        elif "imus" in packet:
            stamps.append(packet["imus"]["t"].astype(np.int64))
            values.append(np.stack([packet["imus"][n] for n in ("temperature", *names)], 1))
        elif "triggers" in packet:
            triggers += [list(map(int, mark)) for mark in packet["triggers"].tolist()]
    joined = np.concatenate([np.zeros(0, np.int64), *stamps])
    every = np.concatenate([np.zeros((0, 7), np.float32), *values])
    told = {"imu": hashed(joined, every), "samples": len(joined), "triggers": triggers}
    return {"frames": frames, **told}


def aedat_packets(path: str, facts: dict[str, Any]) -> Iterator[Any]:
    import aedat

    decoder = aedat.Decoder(path)
    stream = decoder.id_to_stream()[0]
    facts["resolution"] = [stream["width"], stream["height"]]
    for packet in decoder:
        if "events" in packet:
            yield packet["events"]


def faery_packets(path: str, facts: dict[str, Any]) -> Iterator[Any]:
    import faery

    stream = faery.events_stream_from_file(path)
    facts["resolution"] = list(stream.dimensions())
    yield from stream


READERS = {"dv-processing": dv_packets, "aedat": aedat_packets, "faery": faery_packets}


def look(reader: str, path: str) -> dict[str, Any]:
    """Everything that a reader gives before it ends or fails."""
    facts: dict[str, Any] = {"path": path, "error": ""}
    parts = []
    try:
        for packet in READERS[reader](path, facts):
            parts.append(np.array(packet))
    except BaseException as reason:  # a Rust panic is no Exception
        facts["error"] = f"{type(reason).__name__}: {reason}"[:300]
    whole = np.concatenate(parts) if parts else np.zeros(0, "i8,i2,i2,i1")
    t, x, y, p = whole.dtype.names
    facts |= {"packets": len(parts), "events": len(whole)}
    facts["digest"] = digest(whole[t], whole[x], whole[y], whole[p])
    return facts


def write(folder: str) -> None:
    """Files of dv-processing's own writer, with frames, IMU and triggers between the events."""
    import dv_processing as dv

    random = np.random.default_rng(7)
    for name, compression in dv.CompressionType.__members__.items():
        path = Path(folder, f"{name.lower()}.aedat4")
        config = dv.io.MonoCameraWriter.Config("DVX_123", compression)
        config.addEventStream((640, 480))
        config.addFrameStream((640, 480))
        config.addImuStream()
        config.addTriggerStream()
        writer = dv.io.MonoCameraWriter(str(path), config)
        t = 5_000_000_000 + np.cumsum(random.integers(0, 40, 25_000))
        x, y = random.integers(0, 640, len(t)), random.integers(0, 480, len(t))
        p = random.integers(0, 2, len(t))
        for part in range(0, len(t), 5000):
            store = dv.EventStore()
            for k in range(part, part + 5000):
                store.push_back(int(t[k]), int(x[k]), int(y[k]), bool(p[k]))
            writer.writeEvents(store)
            stamp = int(t[part + 4999])
            image = np.full((480, 640), part // 100, np.uint8)
            writer.writeFrame(dv.Frame(stamp, 777, 0, 0, image, dv.FrameSource.SENSOR))
            writer.writeImu(dv.IMU(stamp, *range(10)))
            kind = dv.TriggerType.EXTERNAL_SIGNAL_RISING_EDGE
            writer.writeTrigger(dv.Trigger(stamp, kind))
        del writer
        said = {"path": str(path), "events": len(t), "digest": digest(t, x, y, p)}
        print(json.dumps(said), flush=True)


def write_some(folder: str) -> None:
    """Files of dv-processing's own writer that declare and hold only some streams: KINDS-HELD."""
    import dv_processing as dv

    kinds = {"e": "EventStream", "f": "FrameStream", "i": "ImuStream", "t": "TriggerStream"}
    for name in ("f-f", "i-i", "t-t", "fit-fit", "eit-e", "eit-eIT", "efit-t"):
        declared, held = name.split("-")
        config = dv.io.MonoCameraWriter.Config("eye")
        for kind in declared:
            sides = ((34, 26),) if kind in "ef" else ()
            getattr(config, f"add{kinds[kind]}")(*sides)
        writer = dv.io.MonoCameraWriter(str(Path(folder, f"{name}.aedat4")), config)
        store = dv.EventStore()
        for k in range(3):
            store.push_back(1000 + k, k, k, True)
            if "f" in held:
                image = np.full((26, 34), k, np.uint8)
                writer.writeFrame(dv.Frame(1000 + k, 7, 0, 0, image, dv.FrameSource.SENSOR))
            if "i" in held:
                writer.writeImu(dv.IMU(1000 + k, *range(10)))
            if "t" in held:
                writer.writeTrigger(
                    dv.Trigger(1000 + k, dv.TriggerType.EXTERNAL_SIGNAL_RISING_EDGE)
                )
        if "e" in held:
            writer.writeEvents(store)
        # packets of nothing
        if "I" in held:
            writer.writeImuPacket(dv.IMUPacket())
        if "T" in held:
            writer.writeTriggerPacket(dv.TriggerPacket())
        del writer


if __name__ == "__main__":
    if sys.argv[1] == "write":
        write(sys.argv[2])
    elif sys.argv[1] == "some":
        write_some(sys.argv[2])
    elif sys.argv[1] in ("dv-beside", "aedat-beside"):
        beside = dv_beside if sys.argv[1] == "dv-beside" else aedat_beside
        for given in sys.argv[2:]:
            print(json.dumps({"path": given, **beside(given)}), flush=True)
    else:
        for given in sys.argv[2:]:
            print(json.dumps(look(sys.argv[1], given)), flush=True)
