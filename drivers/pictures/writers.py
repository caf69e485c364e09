"""Pictures to PNG and GIF files, with Pillow."""

from __future__ import annotations

import contextlib
from collections.abc import Iterable
from pathlib import Path

import numpy as np
from PIL import Image

from evs.drivers.pictures.colours import OFF_RGB, ON_RGB, U8
from evs.drivers.pictures.playback import Playback
from evs.msgs import EvsError, unknown

SUFFIXES = (".gif", ".png", ".mp4")
"""What pictures can be written (.mp4: video.py)."""

GREY_LEVELS = 64
"""Greys of a GIF. With the two event colours they are the whole palette: no dither, no noise."""

MAX_GIF_FPS = 50.0
"""Viewers show a GIF frame for 20 ms at least; shorter ones are slowed down to 100 ms."""

MAX_GIF_FRAMES = 6000
"""All frames are in memory while a GIF is written."""

MAX_FRAMES = {".gif": MAX_GIF_FRAMES, ".mp4": 360_000}
"""Of a film: an hour of events at the usual quarter of real time and 25 fps, as .mp4."""

MAX_SIDE_PX = 16384
"""No picture is wider or higher."""


def suffix_of(path: Path) -> str:
    """The path's suffix in lower case; EvsError if nothing of ours writes it."""
    suffix = path.suffix.lower()
    if suffix not in SUFFIXES:
        raise unknown("picture format", suffix or path.name, SUFFIXES)
    return suffix


def write_png(path: Path, picture: U8, few_colours: bool = False) -> None:
    """One picture (h, w, 3) or (h, w) as PNG. In: few_colours, 256 do: charts become small."""
    check_size(picture)
    image = Image.fromarray(picture)
    if few_colours:
        image = image.quantize(256, Image.Quantize.MEDIANCUT, dither=Image.Dither.NONE)
    with Writing(path):
        image.save(path, "PNG", optimize=True)


def write_gif(path: Path, frames: Iterable[U8], playback: Playback) -> None:
    """Frames as a GIF that loops for ever and takes frame_count / fps seconds, right to 10 ms."""
    if playback.fps > MAX_GIF_FPS:
        raise EvsError(f"a GIF shows at most {MAX_GIF_FPS:g} fps, not {playback.fps:g}: use .mp4")
    if playback.frame_count > MAX_GIF_FRAMES:
        raise EvsError(
            f"a GIF of {playback.frame_count} frames is too long (most: {MAX_GIF_FRAMES}): "
            "show less (--start, --stop), faster (--speed), or use .mp4"
        )
    images = (_indexed(frame) for frame in frames)
    first = next(images)
    durations_ms = [10 * cs for cs in playback.durations_cs()]
    with Writing(path):
        first.save(
            path,
            "GIF",
            save_all=True,
            append_images=images,
            duration=durations_ms if len(durations_ms) > 1 else durations_ms[0],
            loop=0,
            # what stays as it was is left out of a frame: noise all over it costs little
            optimize=True,
        )


def gif_palette() -> list[int]:
    """r, g, b of all entries: GREY_LEVELS greys from black to white, then ON, then OFF."""
    greys = [round(255 * level / (GREY_LEVELS - 1)) for level in range(GREY_LEVELS)]
    return [value for grey in greys for value in (grey, grey, grey)] + [*ON_RGB, *OFF_RGB]


def _indexed(frame: U8) -> Image.Image:
    """A picture of greys, ON_RGB and OFF_RGB as palette indices."""
    check_size(frame)
    indices = np.rint(frame[:, :, 1] * ((GREY_LEVELS - 1) / 255)).astype(np.uint8)
    coloured = (frame[:, :, 0] != frame[:, :, 2]) | (frame[:, :, 0] != frame[:, :, 1])
    blue = frame[:, :, 2] > frame[:, :, 0]
    indices[coloured & blue] = GREY_LEVELS
    indices[coloured & ~blue] = GREY_LEVELS + 1
    image = Image.fromarray(indices)
    image.putpalette(gif_palette())
    return image


def check_size(picture: U8) -> None:
    """EvsError where a side is longer than MAX_SIDE_PX."""
    if max(picture.shape[:2]) > MAX_SIDE_PX:
        raise EvsError(
            f"the picture would be {picture.shape[1]} x {picture.shape[0]} px "
            f"(most: {MAX_SIDE_PX} a side): give a smaller --scale"
        )


class Writing:
    """Makes the folder, turns what the disk says into one line, and leaves no half of a file."""

    def __init__(self, path: Path) -> None:
        self.path = path
        self._is_new = not path.exists()

    def __enter__(self) -> None:
        try:
            self.path.parent.mkdir(parents=True, exist_ok=True)
        except OSError as reason:
            raise self._error(reason) from None

    def __exit__(self, kind: object, reason: object, trace: object) -> None:
        if reason is not None and self._is_new:
            with contextlib.suppress(OSError):
                self.path.unlink(missing_ok=True)
        if isinstance(reason, OSError):
            raise self._error(reason) from None

    def _error(self, reason: OSError) -> EvsError:
        return EvsError(
            f"cannot write {self.path}: {reason.strerror or reason}; give another path with -o"
        )
