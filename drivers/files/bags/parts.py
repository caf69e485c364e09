"""The files of a ROS 2 bag: a folder, its split files, and files that are compressed as a whole."""

from __future__ import annotations

import re
import shutil
import tempfile
import weakref
from pathlib import Path

from evs.drivers.files.aedat4.compression import decompressed
from evs.drivers.files.aedat4.layout import CorruptDataError
from evs.drivers.files.formats import BAG_METADATA, PACKED_SUFFIX, is_bag_file
from evs.drivers.files.paths import existing
from evs.msgs import EvsError

_LISTED = re.compile(r"^[ \t]*relative_file_paths:[ \t]*\n((?:[ \t]*-[^\n]*\n?)+)", re.MULTILINE)
_NUMBER = re.compile(r"_(\d{1,9})\.")
_MAX_METADATA_BYTES = 1 << 24


def files_of(path: Path) -> list[Path]:
    """The files of a bag in their order.

    Args:
        path: A file, or the folder of a bag: metadata.yaml lists its files; without it (the
            recorder was killed), they are those with the endings of bags, by their numbers.

    Raises:
        EvsError: There is no such file, or a file that is listed is missing.
    """
    if not path.is_dir():
        return [existing(path)]
    listed = _listed(path)
    found = listed or [one for one in path.iterdir() if is_bag_file(one)]
    return [existing(one) for one in (found if listed else sorted(found, key=_order))]


def whole(path: Path) -> list[Path]:
    """The files of the bag that begins with this file; only the file if it is not the first."""
    listed = _listed(path.parent)
    begins = bool(listed) and listed[0].name == path.name
    return [existing(one) for one in listed] if begins else [path]


def _listed(folder: Path) -> list[Path]:
    """The files that the metadata of a bag's folder list; none without metadata."""
    try:
        with (folder / BAG_METADATA).open("rb") as file:
            text = file.read(_MAX_METADATA_BYTES).decode(errors="replace")
    except OSError:
        return []
    match = _LISTED.search(text)
    names = (
        [line.strip().lstrip("-").strip(" '\"") for line in match[1].splitlines()] if match else []
    )
    # a path leads nowhere else
    return [folder / Path(name).name for name in names if name]


def _order(path: Path) -> tuple[int, str]:
    number = _NUMBER.search(path.name)
    return (int(number[1]) if number else 0, path.name)


class UnpackedFile:
    """A file that was compressed as a whole, decompressed as long as this object lives."""

    def __init__(self, packed: Path) -> None:
        """Decompress a file. EvsError: it is damaged, or there is no space for it."""
        folder = tempfile.mkdtemp(prefix="evs-bag-")
        weakref.finalize(self, shutil.rmtree, folder, ignore_errors=True)
        self.path = Path(folder) / packed.name[: -len(PACKED_SUFFIX)]
        try:
            with packed.open("rb") as source, self.path.open("wb") as target:
                for part in decompressed(source):
                    target.write(part)
        except CorruptDataError as reason:
            raise EvsError(f"{packed} is damaged: {reason}") from None
        except OSError as reason:
            raise EvsError(
                f"cannot decompress {packed} in {folder}: {reason.strerror}; set TMPDIR to a place "
                "with space, or decompress it with zstd -d"
            ) from None
