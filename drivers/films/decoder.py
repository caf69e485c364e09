"""Decode films and pictures with PyAV (FFmpeg's libraries), of the extra `video`.

Nothing is resized here and no light is calculated: arrays leave as they were stored, in 8 or 16
bits or as floats, with the film's own time stamps.
"""

from __future__ import annotations

from collections.abc import Iterator
from fractions import Fraction
from pathlib import Path
from types import TracebackType
from typing import Any, NamedTuple

import numpy as np
import numpy.typing as npt

from evs.msgs import EvsError

HDR_CURVES = {16: "PQ", 18: "HLG"}
"""FFmpeg's transfer characteristics of displays that are much brighter than white paper"""


PLANAR = tuple(f"yuv{j}{kind}p" for j in ("", "j") for kind in ("420", "422", "444"))
"""8-bit formats of three planes, the first of which is luma"""

NEUTRAL = 128
"""chroma of grey, in 8 bits"""


class Picture(NamedTuple):
    """One picture of a film."""

    t_s: Fraction | None
    """its own time stamp, s; None: the film has none"""
    pixels: npt.NDArray[Any]
    """(h, w) or (h, w, 3) RGB; uint8, uint16, float16 or float32; perhaps read-only"""
    label: str
    """file and number, for messages"""


def load_av() -> Any:
    """Import the library; EvsError names the extra where it is missing."""
    try:
        import av
    except ImportError:
        raise EvsError(
            "reading films and frames needs the extra 'video': pip install 'evs[video]'"
        ) from None
    return av


def planes_of_floats(frame: Any) -> npt.NDArray[Any]:
    """(h, w) or (h, w, 3) of a picture of floats, which lie in planes of a channel each.

    FFmpeg's own conversion of floats goes by whole numbers and cuts at white.
    """
    name = frame.format.name
    kind = f"{'>' if name.endswith('be') else '<'}f{2 if 'f16' in name else 4}"
    planes = [
        np.frombuffer(plane, kind).reshape(plane.height, -1)[:, : plane.width]
        for plane in frame.planes
    ]
    if name.startswith("gray"):
        return planes[0]
    # green, blue, red, and perhaps alpha
    return np.stack([planes[2], planes[0], planes[1]], axis=-1)


def plane_of_bytes(plane: Any) -> npt.NDArray[np.uint8]:
    """(h, w) of a plane of 8 bits, in the frame's own memory."""
    return np.frombuffer(plane, np.uint8).reshape(-1, plane.line_size)[
        : plane.height, : plane.width
    ]


class Decoder:
    """The pictures of one file, one after the other, in little memory."""

    def __init__(self, path: Path) -> None:
        """Open a film or a picture.

        Args:
            path: The file.

        Raises:
            EvsError: No such file, no film, or the extra is missing.
        """
        self._av = load_av()
        self.path = path
        if not path.is_file():
            raise EvsError(f"no film '{path}'; give a film or a folder of frames")
        try:
            # an absolute path is no protocol, and a playlist may not lead elsewhere
            self._container = self._av.open(
                str(path.absolute()), options={"protocol_whitelist": "file"}
            )
        except (OSError, ValueError) as reason:
            raise self._error(reason) from None
        videos = self._container.streams.video
        if not videos:
            self.close()
            raise EvsError(f"'{path}' holds no video")
        self._stream = videos[0]
        # the pictures are the same in any number of threads
        self._stream.thread_type = "AUTO"
        self._greys: dict[tuple[Any, ...], npt.NDArray[np.uint8] | None] = {}

    def __enter__(self) -> Decoder:
        return self

    def __exit__(
        self, _: type[BaseException] | None, __: BaseException | None, ___: TracebackType | None
    ) -> None:
        self.close()

    def close(self) -> None:
        """Release the file; safe to call twice."""
        self._container.close()

    @property
    def rate_hz(self) -> Fraction | None:
        """Pictures a second, by the file's header; None: it does not say."""
        rate = self._stream.average_rate or self._stream.guessed_rate
        return Fraction(rate) if rate else None

    @property
    def count(self) -> int | None:
        """How many pictures there are, by the file's header; None: it does not say."""
        if self._stream.frames:
            return int(self._stream.frames)
        seconds, rate_hz = self._container.duration, self.rate_hz
        return round(seconds / 1e6 * rate_hz) if seconds and rate_hz else None

    @property
    def hdr_curve(self) -> str:
        """The name of its transfer curve where that is HDR; empty: it is not."""
        return HDR_CURVES.get(int(self._stream.codec_context.color_trc or 0), "")

    def pictures(self) -> Iterator[Picture]:
        """All pictures, in the order in which they are shown.

        Raises:
            EvsError: The file is damaged; what came before is whole.
        """
        frames = self._container.decode(self._stream)
        number = 0
        while True:
            try:
                frame = next(frames, None)
            except (OSError, ValueError) as reason:
                raise self._error(reason, f" after {number} frames") from None
            if frame is None:
                return
            number += 1
            t_s = None if frame.pts is None else frame.pts * Fraction(frame.time_base)
            yield Picture(t_s, self._pixels(frame), f"{self.path}, frame {number}")

    def _pixels(self, frame: Any) -> npt.NDArray[Any]:
        """The values of a picture, upright."""
        name = frame.format.name
        is_grey = name.startswith(("gray", "ya", "mono"))
        if name.startswith(("gbrpf", "gbrapf", "grayf")):
            pixels = planes_of_floats(frame)
        elif (grey := self._grey(frame)) is not None:
            pixels = grey
        else:
            # alpha alone may be deeper than colour
            bits = frame.format.components[0].bits
            wanted = ("gray16le", "rgb48le") if bits > 8 else ("gray", "rgb24")
            pixels = self._converted(frame, wanted[0 if is_grey else 1])
        # a phone stores the picture as the sensor lies, and how to turn it
        turns = round(frame.rotation / 90) % 4
        return np.rot90(pixels, turns) if turns else pixels

    def _grey(self, frame: Any) -> npt.NDArray[np.uint8] | None:
        """(h, w, 3) RGB of a picture in colour that shows none; None: of any other.

        Without chroma a pixel's colour is a function of its luma alone, so a table gives the bytes
        of the conversion, for a small part of its cost.
        """
        # a picture whose lines go upwards has negative steps
        if frame.format.name not in PLANAR or frame.planes[0].line_size < 0:
            return None
        luma, *chroma = (plane_of_bytes(plane) for plane in frame.planes)
        if not all((plane[0] == NEUTRAL).all() and (plane == NEUTRAL).all() for plane in chroma):
            return None
        how = (
            *(frame.format.name, frame.colorspace, frame.color_range),
            *(frame.color_primaries, frame.color_trc),
        )
        if how not in self._greys:
            self._greys[how] = self._grey_by_luma(*how)
        table = self._greys[how]
        if table is None:
            return None
        shown = luma if np.array_equal(table, np.arange(256)) else table[luma]
        return np.broadcast_to(shown[:, :, np.newaxis], (*shown.shape, 3))

    def _grey_by_luma(self, name: str, *how: int) -> npt.NDArray[np.uint8] | None:
        """The grey of each luma, by the conversion of a picture that has them all."""
        frame = self._av.VideoFrame(16, 16, name)
        frame.colorspace, frame.color_range, frame.color_primaries, frame.color_trc = how
        for number, plane in enumerate(frame.planes):
            values = np.full((plane.height, plane.line_size), NEUTRAL, np.uint8)
            if number == 0:
                values[:, :16] = np.arange(256).reshape(16, 16)
            plane.update(values)
        red, green, blue = self._converted(frame, "rgb24").reshape(256, 3).T
        return red if np.array_equal(red, green) and np.array_equal(red, blue) else None

    def _converted(self, frame: Any, name: str) -> npt.NDArray[Any]:
        """A picture in another format."""
        found: npt.NDArray[Any] = frame.to_ndarray(
            format=name, interpolation=self._exact, threads=1
        )
        return found

    @property
    def _exact(self) -> int:
        """How colours are converted: the same bytes on every processor."""
        how = self._av.video.reformatter.Interpolation
        return int(
            how.BILINEAR | how.ACCURATE_RND | how.BITEXACT | how.FULL_CHR_H_INT | how.FULL_CHR_H_INP
        )

    def _error(self, reason: Exception, where: str = "") -> EvsError:
        text = getattr(reason, "strerror", None) or " ".join(str(reason).split())
        return EvsError(f"cannot read '{self.path}'{where} as a film: {text}")
