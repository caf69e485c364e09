"""AEDAT4's infoNode: the XML that describes the streams of a file, to and from StreamInfo."""

from __future__ import annotations

import json
import re
from collections.abc import Collection
from dataclasses import dataclass
from typing import Any
from xml.etree import ElementTree as ET

from evs.drivers.files.aedat4.layout import CorruptDataError
from evs.drivers.files.capabilities import MAX_SIDE_PX
from evs.msgs import StreamInfo

EVENT_STREAM, FRAME_STREAM, IMU_STREAM, TRIGGER_STREAM = 0, 1, 2, 3
"""Our streams' ids, as dv uses them."""

_NOT_XML = re.compile("[^\t\n\x20-\ud7ff\ue000-\ufffd\U00010000-\U0010ffff]")


@dataclass(frozen=True)
class Declared:
    """One stream as a file's description declares it."""

    identifier: str
    """Kind of its packets: EVTS, FRME, IMUS, TRIG, ..."""
    name: str
    """Name of the stream, `events` as a rule."""
    info: dict[str, str]
    """Attributes of its info node."""


@dataclass(frozen=True)
class StreamKind:
    """One kind of stream, as dv knows it."""

    name: str
    identifier: str
    """four letters that its packets begin with"""
    about: str


KINDS = {
    EVENT_STREAM: StreamKind("events", "EVTS", "Array of events (polarity ON/OFF)."),
    FRAME_STREAM: StreamKind("frames", "FRME", "Intensity frames of active pixels."),
    IMU_STREAM: StreamKind("imu", "IMUS", "Inertial measurement unit samples."),
    TRIGGER_STREAM: StreamKind("triggers", "TRIG", "External triggers and special events."),
}
"""stream id -> what it carries"""


def held_by(stream: StreamInfo) -> tuple[int, ...]:
    """The ids of a camera's streams: events, and the auxiliary streams that it has."""
    auxiliary = (
        (FRAME_STREAM, stream.frames),
        (IMU_STREAM, stream.imu),
        (TRIGGER_STREAM, stream.triggers),
    )
    return (EVENT_STREAM, *(number for number, there in auxiliary if there))


def to_xml(
    stream: StreamInfo, compression: str, numbers: Collection[int] = (), part: int | None = None
) -> str:
    """The description of a file with an event stream and its auxiliary streams.

    sizeX, sizeY and source are dv's; the other attributes of the events' info node are ours:
    camera_info, config, latency_us, part, seed, sensor, tick_us, versions (JSON where they are not
    plain text).

    Args:
        stream: The camera's stream.
        compression: none, lz4 or zstd.
        numbers: Describe only these streams; empty: all that the camera has.
        part: Number of this file in a recording of several files; None: there is one file.
    """
    root = ET.Element("dv", version="2.0")
    streams = _node(root, "outInfo", "/outInfo/")
    for number in numbers or held_by(stream):
        info = _stream_node(streams, number, stream, compression)
        if number != EVENT_STREAM:
            continue
        _attribute(info, "sensor", stream.sensor)
        for key in ("tick_us", "seed", "versions", "config", "camera_info"):
            _attribute(info, key, json.dumps(getattr(stream, key), default=str))
        if stream.latency_us:
            _attribute(info, "latency_us", json.dumps(stream.latency_us))
        if part is not None:
            _attribute(info, "part", json.dumps(part))
    return ET.tostring(root, encoding="unicode")


def _stream_node(
    streams: ET.Element, number: int, stream: StreamInfo, compression: str
) -> ET.Element:
    """Add the node of one stream; return its info node, with the attributes that dv needs."""
    kind = KINDS[number]
    path = f"/outInfo/{number}/"
    node = _node(streams, str(number), path)
    _attribute(node, "compression", compression.upper())
    _attribute(node, "originalModuleName", "evs")
    _attribute(node, "originalOutputName", kind.name)
    _attribute(node, "typeDescription", kind.about)
    _attribute(node, "typeIdentifier", kind.identifier)
    info = _node(node, "info", f"{path}info/")
    if number in (EVENT_STREAM, FRAME_STREAM):
        _attribute(info, "sizeX", str(stream.width), "int")
        _attribute(info, "sizeY", str(stream.height), "int")
    _attribute(info, "source", stream.camera)
    return info


def from_xml(text: str) -> dict[int, Declared]:
    """The streams that a description declares, by stream id; CorruptDataError if it is not one."""
    if "<!" in text:
        raise CorruptDataError(
            "the stream description holds declarations, which no writer puts there"
        )
    try:
        root = ET.fromstring(text)
    except ET.ParseError as reason:
        raise CorruptDataError(f"the stream description is not XML: {reason}") from None
    streams = root.find("./node[@name='outInfo']")
    declared: dict[int, Declared] = {}
    for node in [] if streams is None else streams.findall("node"):
        number = node.get("name", "")
        if number.isascii() and number.isdigit() and len(number) < 10:
            attributes = _attributes(node)
            info = node.find("./node[@name='info']")
            declared[int(number)] = Declared(
                attributes.get("typeIdentifier", ""),
                attributes.get("originalOutputName", ""),
                {} if info is None else _attributes(info),
            )
    return declared


def event_streams(declared: dict[int, Declared]) -> dict[str, str]:
    """Id -> name of the event streams: the camera, and the output where a camera has several."""
    events = {n: one for n, one in sorted(declared.items()) if one.identifier == "EVTS"}
    cameras = [one.info.get("source", "") for one in events.values()]
    return {
        str(number): f"{camera} {one.name}".strip() if cameras.count(camera) > 1 else camera
        for (number, one), camera in zip(events.items(), cameras, strict=True)
    }


def stream_info(info: dict[str, str], width: int = 0, height: int = 0) -> StreamInfo:
    """The content of an event stream's info node; other writers' get tick_us 1, sensor `unknown`.

    Width and height are taken where the node states none that is possible.
    """
    stated = _json(info, "sizeX", 0), _json(info, "sizeY", 0)
    if all(0 < side <= MAX_SIDE_PX for side in stated):
        width, height = stated
    return StreamInfo(
        width=width,
        height=height,
        camera=info.get("source", "camera"),
        sensor=info.get("sensor", "unknown"),
        tick_us=max(1, _json(info, "tick_us", 1)),
        seed=_json(info, "seed", 0),
        versions=_json(info, "versions", {}),
        config=_json(info, "config", {}),
        camera_info=_json(info, "camera_info", {}),
        latency_us=_json(info, "latency_us", 0),
    )


def _node(parent: ET.Element, name: str, path: str) -> ET.Element:
    return ET.SubElement(parent, "node", name=name, path=path)


def _attribute(parent: ET.Element, key: str, text: str, kind: str = "string") -> None:
    # what XML cannot carry at all (control characters, lone surrogates) becomes a question mark
    ET.SubElement(parent, "attr", key=key, type=kind).text = _NOT_XML.sub("?", text)


def _attributes(node: ET.Element) -> dict[str, str]:
    return {attr.get("key", ""): attr.text or "" for attr in node.findall("attr")}


def _json(info: dict[str, str], key: str, default: Any) -> Any:
    """A JSON attribute of the default's type; the default if it is missing or of another type."""
    try:
        value = json.loads(info[key])
    except (KeyError, ValueError, RecursionError):
        return default
    return value if type(value) is type(default) else default
