"""FILE.json beside a recording: its StreamInfo, where the format has no place for it.

A recording without this file is still read: the stream is then what can be found from the events.
"""

from __future__ import annotations

from pathlib import Path
from typing import Any

from evs.drivers.files.header_text import MAX_HEADER_BYTES, json_object, stream_json
from evs.drivers.files.paths import target_error
from evs.msgs import EvsError, StreamInfo


def metadata_path(recording: Path) -> Path:
    """Where the metadata of a recording lies: run.csv.json for run.csv."""
    return recording.with_name(f"{recording.name}.json")


def read_metadata(recording: Path) -> dict[str, Any]:
    """The object in a recording's metadata file; empty where there is none that can be read."""
    path = metadata_path(recording)
    try:
        # opening a pipe would block
        if not path.is_file():
            return {}
        with path.open("rb") as file:
            return json_object(file.read(MAX_HEADER_BYTES).decode(errors="replace"))
    except OSError:
        return {}


def check_metadata_replaceable(recording: Path) -> None:
    """EvsError where a file has the name of the metadata file and is not one."""
    path = metadata_path(recording)
    if path.exists() and "camera" not in read_metadata(recording):
        raise EvsError(
            f"{path} would be replaced by the metadata of {recording}, and is not that of an "
            "earlier recording: move it, or choose another name"
        )


def write_metadata(recording: Path, stream: StreamInfo) -> None:
    """Write the metadata file.

    Raises:
        EvsError: It would replace a file that is not a metadata file, or cannot be written.
    """
    check_metadata_replaceable(recording)
    try:
        metadata_path(recording).write_text(f"{stream_json(stream)}\n", encoding="ascii")
    except OSError as reason:
        raise target_error(metadata_path(recording), reason) from None
