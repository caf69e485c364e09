"""The manifest: all files of a data set with checksums, written last, when the set is complete."""

from __future__ import annotations

import hashlib
import json
import os
from collections.abc import Callable, Mapping
from pathlib import Path
from typing import Any

from evs.emulator.base.small_files import open_file
from evs.msgs import EvsError

MANIFEST, SETTINGS = "manifest.json", "settings.json"
KIND = "evs dataset 1"

_CHUNK = 1 << 22


def digest(path: Path) -> str:
    """SHA-256 of a file, hexadecimal."""
    made = hashlib.sha256()
    with open_file(path) as file:
        while data := file.read(_CHUNK):
            made.update(data)
    return made.hexdigest()


def claim(folder: Path, data: Mapping[str, Any]) -> None:
    """Claim a folder for a data set of these settings.

    Args:
        folder: of the data set.
        data: its settings.

    Raises:
        EvsError: the folder holds something else, or a data set of other settings.
    """
    path = folder / SETTINGS
    there = read_json(path) if path.exists() else None
    if there is None and folder.is_dir() and any(folder.iterdir()):
        raise EvsError(f"'{folder}' holds something else ({SETTINGS} is not there); take another")
    if there is None:
        write_json(path, data)
    elif there != json.loads(json.dumps(data)):
        where = _difference(there, json.loads(json.dumps(data)), "")
        raise EvsError(f"'{folder}' holds a data set of other settings: {where}; take another")


def _difference(there: Any, wanted: Any, path: str) -> str:
    """The first place where two plain values differ, with both."""
    if isinstance(there, dict) and isinstance(wanted, dict):
        for key in [*wanted, *there]:
            if there.get(key) != wanted.get(key):
                return _difference(there.get(key), wanted.get(key), f"{path}.{key}".lstrip("."))
    short = [text if len(text) < 60 else text[:57] + "..." for text in (f"{there}", f"{wanted}")]
    return f"{path} is {short[0]}, not {short[1]}"


def write_json(path: Path, data: Mapping[str, Any]) -> None:
    """Write a JSON file atomically.

    Raises:
        EvsError: it cannot be written, as on a full disk.
    """
    part = path.with_name(f".{path.name}.{os.getpid()}")
    try:
        path.parent.mkdir(parents=True, exist_ok=True)
        with part.open("w", encoding="utf-8") as file:
            file.write(json.dumps(data, indent=1) + "\n")
            file.flush()
            os.fsync(file.fileno())
        part.replace(path)
    except OSError as reason:
        raise EvsError(f"cannot write {path}: {reason.strerror}; take another folder") from None


def read_json(path: Path) -> dict[str, Any]:
    """Read a JSON file of a data set.

    Raises:
        EvsError: it does not exist, is damaged, or is another file.
    """
    try:
        with open_file(path) as file:
            data = json.loads(file.read())
    except OSError as reason:
        raise EvsError(
            f"cannot read {path}: {reason.strerror}; is this the folder of a data set that is done?"
        ) from None
    except ValueError:
        raise EvsError(f"{path} is damaged: it is no JSON; make the data set again") from None
    if not isinstance(data, dict) or data.get("kind") != KIND:
        raise EvsError(f"{path} is not of a data set ('{KIND}')")
    return data


def listed(folder: Path) -> dict[str, dict[str, Any]]:
    """Every file below the folder except the manifest: path -> bytes and sha256, sorted."""
    found = {}
    for path in sorted(folder.rglob("*")):
        name = path.relative_to(folder).as_posix()
        # hidden: what a running or killed command has not completed
        if path.is_file() and name != MANIFEST and not any(p[0] == "." for p in name.split("/")):
            found[name] = {"bytes": path.stat().st_size, "sha256": digest(path)}
    return found


def missing(folder: Path) -> bool:
    """Whether there is a manifest that names a file that does not exist."""
    path = folder / MANIFEST
    return path.exists() and not all((folder / name).is_file() for name in read_json(path)["files"])


def verify(folder: Path, moved: Callable[[int, str], None] = lambda _done, _name: None) -> int:
    """Compare every file with the manifest.

    Args:
        folder: of the data set.
        moved: called before each file with the number of files done and its name.

    Returns:
        The number of files.

    Raises:
        EvsError: files are missing or changed; the message names what to remove so that they are
            made again.
    """
    files: dict[str, dict[str, Any]] = read_json(folder / MANIFEST)["files"]
    wrong = []
    bad: dict[str, None] = {}
    for done, (name, entry) in enumerate(files.items()):
        moved(done, name)
        path = folder / name
        if not path.is_file():
            wrong.append(f"{name} is missing")
        elif path.stat().st_size != entry["bytes"]:
            wrong.append(f"{name} has {path.stat().st_size} bytes, not {entry['bytes']}")
        elif digest(path) != entry["sha256"]:
            wrong.append(f"{name} has another checksum")
        else:
            continue
        bad[_made_with(name)] = None
    if wrong:
        more = f" and {len(wrong) - 5} more" if len(wrong) > 5 else ""
        raise EvsError(
            f"'{folder}': {'; '.join(wrong[:5])}{more}; remove {', '.join(bad)} there, and give "
            "the command that made it again"
        )
    return len(files)


def _made_with(name: str) -> str:
    """What is made again with a file: its shard, or all events of its scene, which are a chain."""
    scene, *rest = name.split("/")
    if rest[:1] == ["events"]:
        return f"{scene}/events"
    return name.rpartition("/")[0] if rest[:1] == ["frames"] else name
