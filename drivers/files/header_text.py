"""Header lines of text: the StreamInfo as one line of JSON, and the name of the chip."""

from __future__ import annotations

import dataclasses
import json
from collections.abc import Sequence
from pathlib import Path
from typing import Any

from evs.drivers.files.capabilities import MAX_SIDE_PX
from evs.drivers.files.chips import chip_named
from evs.drivers.files.formats import AnyPath
from evs.drivers.files.paths import existing
from evs.msgs import EvsError, StreamInfo

MAX_HEADER_BYTES = 1 << 22
"""A longer header is corrupt; ours contains the configuration of the run."""


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
    if not all(isinstance(name, str) for name in known.get("classes", ())):
        del known["classes"]
    stream = dataclasses.replace(default, **known)
    sides = stream.width, stream.height
    possible = all(0 < side <= MAX_SIDE_PX for side in sides) and stream.tick_us > 0
    return stream if possible else default


def stream_json(stream: StreamInfo, **more: Any) -> str:
    """The stream as one line of JSON in ASCII, with `more` keys of the format's own."""
    return json.dumps(dataclasses.asdict(stream) | more, default=str)


def read_file_head(path: AnyPath) -> tuple[Path, bytes]:
    """An existing file, and its first MAX_HEADER_BYTES bytes. EvsError: it cannot be read."""
    found = existing(path)
    try:
        with found.open("rb") as file:
            return found, file.read(MAX_HEADER_BYTES)
    except OSError as reason:
        raise EvsError(f"cannot read {found}: {reason.strerror}") from None


def json_object(line: str) -> dict[str, Any]:
    """The object in a line of JSON; an empty one where the line holds none."""
    try:
        value = json.loads(line)
    except (ValueError, RecursionError):
        return {}
    return value if isinstance(value, dict) else {}


def percent_lines(head: bytes, last: str = "") -> tuple[dict[str, str], int]:
    """Parse header lines of the form `% key value`, as Prophesee's files begin with.

    Args:
        head: The first bytes of a file.
        last: The key of the last line; empty: the header ends before a line without `%`.

    Returns:
        Key in lower case -> value, of several lines with one key the first; the header's size in
        bytes.
    """
    lines: dict[str, str] = {}
    at = 0
    while head.startswith(b"%", at):
        end = head.find(b"\n", at)
        if end < 0:
            break
        key, _, value = head[at + 1 : end].decode(errors="replace").strip().partition(" ")
        at = end + 1
        if last and key == last:
            break
        # older files have names like "% Date" and "% Height:"
        lines.setdefault(key.lower().rstrip(":"), value.strip())
    return lines, at


def own_line_and_chip(
    lines: Sequence[str], prefix: str, chip: str
) -> tuple[dict[str, Any] | None, str]:
    """Find our line and the chip's name in a header. Of several such lines the first counts.

    Args:
        lines: The lines of the header.
        prefix: Start of our line, before its JSON.
        chip: Start of the line that names the chip.

    Returns:
        The object in our line, None without such a line; the chip's name, empty without one.
    """
    ours = next((line.removeprefix(prefix) for line in lines if line.startswith(prefix)), None)
    name = next((line.removeprefix(chip) for line in lines if line.startswith(chip)), "")
    return None if ours is None else json_object(ours), name.strip()


def stream_from_header(
    stated: dict[str, Any] | None, chip: str, frames: bool = False, imu: bool = False
) -> StreamInfo:
    """The stream that a header describes, by our JSON or else by the name of the chip.

    Args:
        stated: The object in our line; None without one.
        chip: The chip's name in the format's own line, empty without one (other lines may name
            other cameras).
        frames: Whether the format can hold frames; if not, the JSON's flag does not apply.
        imu: The same for IMU samples.

    Returns:
        The stream; 0 x 0 px where the header does not state a size.
    """
    plain = StreamInfo(0, 0, sensor="unknown")
    stream = stream_from_json(stated, plain)
    if stream is not plain and stream.width:
        frames, imu = frames and stream.frames, imu and stream.imu
        return dataclasses.replace(stream, frames=frames, imu=imu, triggers=False)
    known = chip_named(chip)
    return StreamInfo(known.width, known.height, sensor=known.name) if known else plain
