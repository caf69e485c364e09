"""Where frames come from: a film, or a folder of pictures in the order of their names."""

from __future__ import annotations

import re
from collections.abc import Iterator
from fractions import Fraction
from pathlib import Path
from typing import Protocol

from evs.drivers.files.formats import SUFFIXES, is_bag_folder
from evs.drivers.films.decoder import Decoder, Picture
from evs.msgs import EvsError

FILM_SUFFIXES = (
    *(".mp4", ".mkv", ".avi", ".mov", ".webm", ".m4v", ".mpg", ".mpeg", ".wmv", ".flv", ".ogv"),
    *(".gif", ".apng", ".y4m", ".ts", ".mts", ".m2ts", ".3gp", ".mxf", ".h264", ".h265", ".ivf"),
)
"""Endings of films, in lower case."""

PICTURE_SUFFIXES = (
    *(".png", ".jpg", ".jpeg", ".tif", ".tiff", ".exr", ".bmp", ".webp", ".pgm", ".ppm", ".hdr"),
)
"""Endings of the frames in a folder, in lower case."""

_SAME = {".jpeg": ".jpg", ".tiff": ".tif"}


class FrameSource(Protocol):
    """Frames, one after the other."""

    path: Path
    rate_hz: Fraction | None
    """frames a second, by a header; None: not known"""
    count: int | None
    """how many there are; None: not known"""

    def pictures(self) -> Iterator[Picture]:
        """All frames, in their order. Raises EvsError where one cannot be read."""

    def close(self) -> None:
        """Release what is open; safe to call twice."""


class FilmFile:
    """A film."""

    def __init__(self, path: Path) -> None:
        self._decoder = Decoder(path)
        self.path, self.rate_hz, self.count = path, self._decoder.rate_hz, self._decoder.count
        self.hdr_curve = self._decoder.hdr_curve

    def pictures(self) -> Iterator[Picture]:
        """All frames."""
        return self._decoder.pictures()

    def close(self) -> None:
        """Release the file."""
        self._decoder.close()


class FrameFolder:
    """A folder of pictures, without any times."""

    hdr_curve = ""

    def __init__(self, path: Path) -> None:
        """List the pictures.

        Raises:
            EvsError: There are none, or some of two kinds.
        """
        found = [
            file
            for file in path.iterdir()
            if file.suffix.lower() in PICTURE_SUFFIXES and not file.name.startswith(".")
        ]
        kinds = sorted({_SAME.get(f.suffix.lower(), f.suffix.lower()) for f in found})
        if len(kinds) > 1:
            raise EvsError(
                f"folder '{path}' has {' and '.join(kinds)} files; put the frames into a folder of "
                "their own"
            )
        if not found:
            raise EvsError(f"folder '{path}' has no frames ({', '.join(PICTURE_SUFFIXES)})")
        self.path, self.rate_hz = path, None
        self.files = sorted(found, key=lambda file: natural_order(file.name))
        self.count = len(self.files)

    def pictures(self) -> Iterator[Picture]:
        """One picture of each file."""
        for file in self.files:
            with Decoder(file) as decoder:
                picture = next(decoder.pictures(), None)
            if picture is None:
                raise EvsError(f"'{file}' holds no picture")
            yield picture._replace(t_s=None, label=str(file))

    def close(self) -> None:
        """Nothing is open between two pictures."""


def natural_order(name: str) -> list[tuple[int, int, str]]:
    """A key that puts frame_2 before frame_10."""
    parts = re.split(r"(\d+)", name.lower())
    return [(0, int(p), "") if p.isdecimal() else (1, 0, p) for p in parts if p]


def is_film(path: str | Path) -> bool:
    """Whether a path is a film or a folder, by its ending, and no recording of events."""
    found = Path(path)
    if found.is_dir():
        return not is_bag_folder(found)
    return found.suffix.lower() in FILM_SUFFIXES and found.suffix.lower() not in SUFFIXES


def open_film(path: str | Path) -> FilmFile | FrameFolder:
    """Open a film or a folder of frames. Raises EvsError where it is none."""
    found = Path(path)
    return FrameFolder(found) if found.is_dir() else FilmFile(found)
