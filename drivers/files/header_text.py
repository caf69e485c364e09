"""Header lines: the stream's facts as one line of JSON, and what chips' names say of their size."""

from __future__ import annotations

import dataclasses
import json
from collections.abc import Sequence
from pathlib import Path
from typing import Any

from evs.drivers.files.capabilities import MAX_SIDE_PX
from evs.drivers.files.formats import AnyPath
from evs.drivers.files.paths import existing
from evs.msgs import EvsError, StreamInfo

MAX_HEADER_BYTES = 1 << 22
"""A longer header is damage; ours holds the configuration of the run."""

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


def stream_from_json(stated: Any, default: StreamInfo) -> StreamInfo:
    """The StreamInfo that a header's JSON describes.

    Args:
        stated: What json.loads returned; other fields and fields of another type are ignored.
        default: The stream of a file without this JSON; fields that are not stated keep its values.

    Returns:
        The stream; `default` where nothing usable is stated.
    """
    if not isinstance(stated, dict):
        return default
    known = {
        item.name: stated[item.name]
        for item in dataclasses.fields(StreamInfo)
        if type(stated.get(item.name)) is type(getattr(default, item.name))
    }
    stream = dataclasses.replace(default, **known)
    sides = stream.width, stream.height
    possible = all(0 < side <= MAX_SIDE_PX for side in sides) and stream.tick_us > 0
    return stream if possible else default


def stream_json(stream: StreamInfo, **more: Any) -> str:
    """One line of ASCII that `stream_from_header` reads. In: more, keys of the format's own."""
    return json.dumps(dataclasses.asdict(stream) | more, default=str)


def read_file_head(path: AnyPath) -> tuple[Path, bytes]:
    """A file that is there, and its first bytes, as many as a header may have. EvsError: none."""
    found = existing(path)
    try:
        with found.open("rb") as file:
            return found, file.read(MAX_HEADER_BYTES)
    except OSError as reason:
        raise EvsError(f"cannot read {found}: {reason.strerror}") from None


def json_object(line: str) -> dict[str, Any]:
    """What a line of JSON says; nothing where it is none."""
    try:
        said = json.loads(line)
    except (ValueError, RecursionError):
        return {}
    return said if isinstance(said, dict) else {}


def own_line_and_chip(
    lines: Sequence[str], prefix: str, chip: str
) -> tuple[dict[str, Any] | None, str]:
    """What our line of a header says, None without one; the chip's name, empty without one.

    In: prefix, what our line begins with, before its JSON; chip, what the line begins with that
    names the chip. Of several lines the first counts.
    """
    ours = next((line.removeprefix(prefix) for line in lines if line.startswith(prefix)), None)
    name = next((line.removeprefix(chip) for line in lines if line.startswith(chip)), "")
    return None if ours is None else json_object(ours), name.strip()


def stream_from_header(
    said: dict[str, Any] | None, chip: str, frames: bool = False, imu: bool = False
) -> StreamInfo:
    """The stream of a header: of our JSON, else of a chip's name. 0 x 0 px: it says no size.

    In: said, our line; chip, what the format's own line calls it, empty without one (other lines
    may name other cameras); frames, imu, whether the format holds them, so that our line is right
    about them.
    """
    plain = StreamInfo(0, 0, sensor="unknown")
    stream = stream_from_json(said, plain)
    if stream is not plain and stream.width:
        frames, imu = frames and stream.frames, imu and stream.imu
        return dataclasses.replace(stream, frames=frames, imu=imu, triggers=False)
    for name, (width, height) in CHIPS.items():
        if name in chip.upper():
            return StreamInfo(width, height, sensor=name.lower())
    return plain
