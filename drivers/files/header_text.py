"""Header lines: the stream's facts as one line of JSON, and what chips' names say of their size."""

from __future__ import annotations

import dataclasses
import json
from typing import Any

from evs.drivers.files.recorded import said_stream
from evs.msgs import StreamInfo

CHIPS = {
    "DAVIS346": (346, 260),
    "DAVIS240": (240, 180),
    "DAVIS640": (640, 480),
    "DAVIS208": (208, 192),
    "DAVIS128": (128, 128),
    "DVS128": (128, 128),
    "DVXPLORER": (640, 480),
}
"""Names of chips, upper case, as they stand in headers -> width, height, px."""


def stream_json(stream: StreamInfo, **more: Any) -> str:
    """One line of ASCII that `stream_from` reads. In: more, keys of the format's own."""
    return json.dumps(dataclasses.asdict(stream) | more, default=str)


def said_in(line: str) -> dict[str, Any]:
    """What a line of JSON says; nothing where it is none."""
    try:
        said = json.loads(line)
    except (ValueError, RecursionError):
        return {}
    return said if isinstance(said, dict) else {}


def stream_from(said: dict[str, Any], header: str) -> StreamInfo:
    """The stream of a header: of our JSON, else of a chip's name. 0 x 0 px: it says no size.

    In: said, our line; header, the text of the whole header.
    """
    plain = StreamInfo(0, 0, sensor="unknown")
    stream = said_stream(said, plain)
    if stream is not plain and stream.width:
        return dataclasses.replace(stream, frames=False, imu=False)
    for name, (width, height) in CHIPS.items():
        if name in header.upper():
            return StreamInfo(width, height, sensor=name.lower())
    return plain
