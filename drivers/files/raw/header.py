"""The text that a RAW file begins with: lines of `% key value`, the last of them `% end`."""

from __future__ import annotations

import dataclasses
import json
import re
from dataclasses import dataclass

from evs.drivers.files.capabilities import MAX_SIDE_PX
from evs.drivers.files.header_text import percent_lines, stream_from_json
from evs.msgs import StreamInfo

MAX_HEADER_BYTES = 1 << 24
"""A longer header is corrupt; ours contains the configuration of the run."""

STREAM = "evs_stream"
ORIGIN = "evs_time_origin_us"

_SIDES = re.compile(r"(\d{1,5})x(\d{1,5})")
_GENERATIONS = {"2": (304, 240), "3": (640, 480), "4": (1280, 720)}
"""generation of Prophesee's sensors -> width, height, px, for files that state no size"""


@dataclass(frozen=True)
class RawHeader:
    """The content of the header."""

    version: str
    """EVT version of the events: `2.0`, `2.1` or `3.0`; empty: not stated"""
    stream: StreamInfo
    """width and height are 0 where they are not stated"""
    time_origin_us: int
    """stamp of the stream's time zero"""
    size: int
    """its bytes"""
    upper_first: bool | None = None
    """EVT2.1: whether the upper half of each word comes first (IMX636); None: not stated"""
    ours: bool = False
    """whether evs recorded it, which means that it holds only events"""


def header_bytes(stream: StreamInfo, version: str, time_origin_us: int) -> bytes:
    """The header of our files: the lines that Prophesee's SDK needs, then our own two."""
    name = {"2.1": "EVT21;endianness=little"}.get(version, f"EVT{version[0]}")
    lines = {
        "evt": version,
        "format": f"{name};height={stream.height};width={stream.width}",
        "geometry": f"{stream.width}x{stream.height}",
        "camera_integrator_name": "evs",
        "plugin_integrator_name": "Prophesee",
        "plugin_name": "hal_plugin_prophesee",
        ORIGIN: str(time_origin_us),
        STREAM: json.dumps(dataclasses.asdict(stream), default=str),
    }
    return "".join(f"% {key} {value}\n" for key, value in lines.items()).encode() + b"% end\n"


def parse_header(head: bytes) -> RawHeader:
    """Parse the first bytes of a file; never raises."""
    lines, size = percent_lines(head, last="end")
    version = lines.get("evt", "")
    parts = dict(part.partition("=")[::2] for part in lines.get("format", "").split(";"))
    for name, number in (("EVT21", "2.1"), ("EVT2", "2.0"), ("EVT3", "3.0")):
        version = number if name in parts else version
    sides = _size(lines, parts)
    default = StreamInfo(*sides, sensor="unknown")
    try:
        stated = json.loads(lines.get(STREAM, "null"))
    except (ValueError, RecursionError):
        stated = None
    origin = lines.get(ORIGIN, "0")
    # of a stream that begins at a Unix time it is negative
    digits = origin.removeprefix("-")
    known = digits.isascii() and digits.isdigit() and len(digits) < 17
    stream = stream_from_json(stated, default)
    # frames and IMU samples went elsewhere
    stream = dataclasses.replace(stream, frames=False, imu=False, triggers=False)
    order = parts.get("endianness")
    upper_first = None if order is None else order == "legacy"
    return RawHeader(
        version, stream, int(origin) if known else 0, size, upper_first, STREAM in lines
    )


def _size(lines: dict[str, str], parts: dict[str, str]) -> tuple[int, int]:
    """Width and height, px; 0, 0 if they are not stated."""
    geometry = _SIDES.fullmatch(lines.get("geometry", ""))
    for width, height in (
        (parts.get("width", ""), parts.get("height", "")),
        geometry.groups() if geometry else ("", ""),
        (lines.get("width", ""), lines.get("height", "")),
    ):
        if all(side.isascii() and side.isdigit() and len(side) < 6 for side in (width, height)):
            sides = int(width), int(height)
            if all(0 < side <= MAX_SIDE_PX for side in sides):
                return sides
    generation = lines.get("sensor_generation", lines.get("generation", ""))
    return _GENERATIONS.get(generation[:1], (0, 0))
