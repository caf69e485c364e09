"""Films and frames made by other encoders than the one that we decode with."""

from __future__ import annotations

import subprocess
from pathlib import Path
from typing import Any

import cv2
import imageio_ffmpeg
import mitsuba
import numpy as np
from PIL import Image


def texture(frames: int, width: int = 64, height: int = 48, step: int = 2) -> Any:
    """(frames, h, w) uint8: a soft texture that moves to the left, by `step` px a frame."""
    random = np.random.default_rng(5)
    wide = random.integers(0, 256, (height, width + step * frames)).astype(np.uint8)
    soft = cv2.GaussianBlur(wide, (0, 0), 2.0)
    soft = cv2.normalize(soft, None, 8, 250, cv2.NORM_MINMAX)
    return np.stack([soft[:, step * k : step * k + width] for k in range(frames)])


def ffmpeg(path: Path, frames: Any, fps: float, *options: str) -> Path:
    """A film by the ffmpeg program of another wheel: of (n, h, w) or (n, h, w, 3) uint8."""
    count, height, width = frames.shape[:3]
    form = "rgb24" if frames.ndim == 4 else "gray"
    given = ["-f", "rawvideo", "-pix_fmt", form, "-s", f"{width}x{height}", "-r", str(fps)]
    words = [imageio_ffmpeg.get_ffmpeg_exe(), "-y", "-v", "error", *given, "-i", "-", *options]
    data = np.ascontiguousarray(frames).tobytes()
    subprocess.run([*words, str(path)], input=data, check=True, capture_output=True)
    assert count
    return path


def lossless(path: Path, frames: Any, fps: float = 100.0) -> Path:
    """FFV1 in Matroska: every bit of the frames is in it."""
    form = "bgr0" if frames.ndim == 4 else "gray"
    return ffmpeg(path, frames, fps, "-c:v", "ffv1", "-pix_fmt", form)


def motion_jpeg(path: Path, frames: Any, fps: float) -> Path:
    """Motion JPEG in AVI, by OpenCV's own encoder and muxer."""
    height, width = frames.shape[1:3]
    code = cv2.VideoWriter.fourcc(*"MJPG")
    writer = cv2.VideoWriter(str(path), cv2.CAP_OPENCV_MJPEG, code, fps, (width, height))
    assert writer.isOpened()
    for frame in frames:
        writer.write(cv2.cvtColor(frame, cv2.COLOR_GRAY2BGR))
    writer.release()
    return path


def gif(path: Path, frames: Any, durations_ms: list[int]) -> Path:
    """A GIF of Pillow's, each frame with its own duration."""
    images = [Image.fromarray(frame) for frame in frames]
    images[0].save(path, save_all=True, append_images=images[1:], duration=durations_ms)
    return path


def exr(path: Path, light: Any, half: bool) -> Path:
    """OpenEXR by Mitsuba, of (h, w), (h, w, 3) or (h, w, 4) float32."""
    mitsuba.set_variant("scalar_rgb")
    bitmap = mitsuba.Bitmap(np.ascontiguousarray(light, np.float32))
    kind = mitsuba.Struct.Type.Float16 if half else mitsuba.Struct.Type.Float32
    forms = mitsuba.Bitmap.PixelFormat
    form = {(): forms.Y, (3,): forms.RGB, (4,): forms.RGBA}[light.shape[2:]]
    bitmap.convert(form, kind, srgb_gamma=False).write(str(path))
    return path
