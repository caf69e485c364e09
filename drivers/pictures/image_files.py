"""Pictures as files: PNG and GIF with Pillow, MP4 (H.264) with the ffmpeg of the extra `video`."""

from __future__ import annotations

import contextlib
import importlib
import io
import subprocess
import tempfile
from collections.abc import Iterable, Iterator
from pathlib import Path
from typing import Any

import numpy as np
import numpy.typing as npt
from PIL import Image

from evs.drivers.pictures.playback import Playback
from evs.msgs import EvsError, unknown
from evs.msgs.pictures import OFF_RGB, ON_RGB, U8

SUFFIXES = (".gif", ".png", ".mp4")
"""The endings of pictures that can be written."""

GREY_LEVELS = 64
"""Greys of a GIF. With the two event colours they are the whole palette: no dither, no noise."""

MAX_GIF_FPS = 50.0
"""Viewers show a GIF frame for at least 20 ms; they slow shorter ones down to 100 ms."""

MAX_GIF_FRAMES = 6000
"""All frames are in memory while a GIF is written."""

MAX_FRAMES = {".gif": MAX_GIF_FRAMES, ".mp4": 360_000}
"""Of a film: an hour of events at the usual quarter of real time and 25 fps, as .mp4."""

MAX_SIDE_PX, MAX_AREA_PX = 16384, 1 << 26
"""No picture is wider or higher, or has more pixels."""


def suffix_of(path: Path) -> str:
    """The path's suffix in lower case. EvsError: no function here writes such files."""
    suffix = path.suffix.lower()
    if suffix not in SUFFIXES:
        raise unknown("picture format", suffix or path.name, SUFFIXES)
    return suffix


def write_png(path: Path, picture: U8, few_colours: bool = False) -> None:
    """Write one picture as PNG.

    Args:
        path: The file to write.
        picture: (h, w, 3) or (h, w) uint8.
        few_colours: Whether 256 colours suffice, as for a chart, whose file then becomes small.

    Raises:
        EvsError: The picture is too large, or the file cannot be written.
    """
    check_size(*picture.shape[:2])
    image = Image.fromarray(picture)
    if few_colours:
        image = image.quantize(256, Image.Quantize.MEDIANCUT, dither=Image.Dither.NONE)
    with Writing(path):
        image.save(path, "PNG", optimize=True)


def write_gif(path: Path, frames: Iterable[U8], playback: Playback) -> None:
    """Write frames as a GIF that loops for ever, frame_count / fps seconds long within 10 ms."""
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
    check_size(*frame.shape[:2])
    indices = np.rint(frame[:, :, 1] * ((GREY_LEVELS - 1) / 255)).astype(np.uint8)
    coloured = (frame[:, :, 0] != frame[:, :, 2]) | (frame[:, :, 0] != frame[:, :, 1])
    blue = frame[:, :, 2] > frame[:, :, 0]
    indices[coloured & blue] = GREY_LEVELS
    indices[coloured & ~blue] = GREY_LEVELS + 1
    image = Image.fromarray(indices)
    image.putpalette(gif_palette())
    return image


def check_size(height: int, width: int) -> None:
    """Check the size of a picture before it is made.

    Args:
        height: Of the picture, px.
        width: Of the picture, px.

    Raises:
        EvsError: A side is longer than MAX_SIDE_PX, or there are more pixels than MAX_AREA_PX.
    """
    if max(height, width) > MAX_SIDE_PX or height * width > MAX_AREA_PX:
        raise EvsError(
            f"the picture would be {width} x {height} px (most: {MAX_SIDE_PX} a side, "
            f"{MAX_AREA_PX} in all): give a smaller --scale, or see `evs info` for the sensor's "
            "size, which is that of the farthest events where the file states none"
        )


class Writing:
    """A file while it is written: its folder is created, and an error removes a new file.

    An OSError becomes an EvsError of one line.
    """

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


QUALITY_CRF = 18
"""x264's constant rate factor: at 18 the eye sees no difference."""


def need_video() -> str:
    """Path of the ffmpeg binary; EvsError with the pip line without the extra `video`."""
    try:
        return str(importlib.import_module("imageio_ffmpeg").get_ffmpeg_exe())
    except (ImportError, RuntimeError):
        raise EvsError(
            "writing .mp4 needs the extra 'video': pip install 'evs[video]' (or write .gif)"
        ) from None


def write_mp4(path: Path, frames: Iterable[U8], fps: float) -> None:
    """Write frames (h, w, 3) of one size, both sides even, as a video of `fps` pictures a second.

    Colour is stored for 2 x 2 pixels together: single sensor pixels keep their exact colour from
    scale 2 on. Raises EvsError without the extra `video`, and where ffmpeg cannot write.
    """
    ffmpeg = need_video()
    pictures = iter(frames)
    first = next(pictures)
    check_size(*first.shape[:2])
    with Writing(path), tempfile.TemporaryFile() as messages:
        process = subprocess.Popen(
            _command(ffmpeg, path, first, fps),
            stdin=subprocess.PIPE,
            stdout=subprocess.DEVNULL,
            stderr=messages,
        )
        assert process.stdin is not None
        try:
            # a broken pipe: ffmpeg has ended, and its reason is reported below
            with contextlib.suppress(BrokenPipeError):
                for picture in _chain(first, pictures):
                    process.stdin.write(np.ascontiguousarray(picture).data)
        finally:
            code = _finish(process)
        if code:
            messages.seek(0)
            lines = messages.read().decode(errors="replace").strip().splitlines()
            raise EvsError(
                f"cannot write {path}: ffmpeg: {lines[-1] if lines else f'exit code {code}'}"
            )


def _command(ffmpeg: str, path: Path, first: U8, fps: float) -> list[str]:
    height, width = first.shape[:2]
    source = ["-f", "rawvideo", "-pix_fmt", "rgb24", "-s", f"{width}x{height}", "-r", f"{fps:.6f}"]
    coding = ["-an", "-c:v", "libx264", "-crf", str(QUALITY_CRF), "-pix_fmt", "yuv420p"]
    # an absolute path can be taken neither for an option nor for a protocol
    return [ffmpeg, "-y", "-v", "error", *source, "-i", "-", *coding, str(path.absolute())]


def _finish(process: subprocess.Popen[bytes]) -> int:
    assert process.stdin is not None
    with contextlib.suppress(BrokenPipeError):
        process.stdin.close()
    return process.wait()


def _chain(first: U8, rest: Iterator[U8]) -> Iterator[U8]:
    yield first
    yield from rest


def grey_png(data: bytes, width: int, height: int) -> npt.NDArray[np.uint16] | None:
    """Decode a grey picture of 16 bits.

    Args:
        data: The bytes of a PNG file.
        width: Expected width, px.
        height: Expected height, px.

    Returns:
        (height, width) pixels; None: no PNG file, or one of another size or in colour.
    """
    try:
        with Image.open(io.BytesIO(data), formats=("PNG",)) as picture:
            if picture.size != (width, height) or not picture.mode.startswith("I"):
                return None
            pixels: Any = np.asarray(picture)
    except Exception:  # damaged bytes make Pillow raise a dozen kinds
        return None
    return pixels.astype(np.uint16) if pixels.shape == (height, width) else None
