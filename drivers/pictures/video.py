"""Pictures to MP4 files (H.264), with the ffmpeg binary that the extra `video` brings."""

from __future__ import annotations

import contextlib
import importlib
import subprocess
import tempfile
from collections.abc import Iterable, Iterator
from pathlib import Path

import numpy as np

from evs.drivers.pictures.colours import U8
from evs.drivers.pictures.writers import Writing, check_size
from evs.msgs import EvsError

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
    """Frames (h, w, 3) of one size, both sides even, as a video of `fps` pictures a second.

    Colour is stored for 2 x 2 pixels together: single sensor pixels keep their exact colour from
    scale 2 on. Raises EvsError without the extra `video`, and where ffmpeg cannot write.
    """
    ffmpeg = need_video()
    pictures = iter(frames)
    first = next(pictures)
    check_size(first)
    with Writing(path), tempfile.TemporaryFile() as complaints:
        process = subprocess.Popen(
            _command(ffmpeg, path, first, fps),
            stdin=subprocess.PIPE,
            stdout=subprocess.DEVNULL,
            stderr=complaints,
        )
        assert process.stdin is not None
        try:
            # a broken pipe: ffmpeg gave up and says why below
            with contextlib.suppress(BrokenPipeError):
                for picture in _chain(first, pictures):
                    process.stdin.write(np.ascontiguousarray(picture).data)
        finally:
            code = _finish(process)
        if code:
            complaints.seek(0)
            lines = complaints.read().decode(errors="replace").strip().splitlines()
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
