"""Another project's AEDAT4 encoder, as a program of its own: `PEER EVENTS.npy FILE` on its stdin.

PEER is faery (LGPL, in a venv of its own, never beside evs) or dv-processing. Each line of stdin
names a compression; the answer is a line with the seconds of processor time that its encoder took
for all packets of 1 ms. Imports nothing of ours.
"""

from __future__ import annotations

import sys
import time
from collections.abc import Callable
from typing import Any

import numpy as np

TICK_US = 1000
SIZE = (1280, 720)


def faery(packets: list[Any], path: str) -> Callable[[str], object]:
    import faery

    aedat = faery.aedat
    levels = {"none": None, "lz4": aedat.LZ4_DEFAULT, "zstd": aedat.ZSTD_DEFAULT}
    ready = []
    for packet in packets:
        own = np.zeros(len(packet), faery.EVENTS_DTYPE)
        for name, field in zip(own.dtype.names or (), "txyp", strict=True):
            own[name] = packet[field]
        ready.append(own)

    def text(value: str | int, kind: str = "string") -> Any:
        return aedat.DescriptionAttribute(attribute_type=kind, value=value)

    def node(name: str, path: str, attributes: dict[str, Any], *nodes: Any) -> Any:
        return aedat.DescriptionNode(name=name, path=path, attributes=attributes, nodes=list(nodes))

    def encode(compression: str) -> None:
        sides = {f"size{a}": text(n, "int") for a, n in zip("XY", SIZE, strict=True)}
        info = node("info", "/outInfo/0/info/", {**sides, "source": text("eye")})
        kinds = {"originalOutputName": text("events"), "typeIdentifier": text("EVTS")}
        stream = node("0", "/outInfo/0/", {**kinds, "compression": text("NONE")}, info)
        description = [node("outInfo", "/outInfo/", {}, stream)]
        with aedat.Encoder(path, description, levels[compression]) as encoder:
            for packet in ready:
                encoder.write(0, packet)

    return encode


def dv_processing(packets: list[Any], path: str) -> Callable[[str], object]:
    import dv_processing as dv

    kinds = {"none": "NONE", "lz4": "LZ4", "zstd": "ZSTD"}
    ready = [[packet[name].tolist() for name in "txyp"] for packet in packets]

    def encode(compression: str) -> None:
        config = dv.io.MonoCameraWriter.Config(
            "eye", dv.CompressionType.__members__[kinds[compression]]
        )
        config.addEventStream(SIZE)
        writer = dv.io.MonoCameraWriter(path, config)
        for columns in ready:
            # its Python has no other way in than event by event
            store = dv.EventStore()
            for event in zip(*columns, strict=True):
                store.push_back(*event)
            writer.writeEvents(store)
        del writer

    return encode


def main() -> None:
    peer, events, path = sys.argv[1:]
    every = np.load(events)
    cuts = np.flatnonzero(np.diff(-(-every["t"] // TICK_US))) + 1
    packets = np.split(every, cuts)
    encode = {"faery": faery, "dv-processing": dv_processing}[peer](packets, path)
    print("ready", flush=True)
    for line in sys.stdin:
        begin = time.process_time()
        encode(line.strip())
        print(f"answer {time.process_time() - begin}", flush=True)


if __name__ == "__main__":
    main()
