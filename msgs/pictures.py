"""Pictures of events over light, and the colours of every picture.

One pair of colours for the two polarities, grey for everything else. Linear light becomes what a
screen shows: one exposure, then the sRGB curve, 8 bits. Notebooks show packets, recordings and
cameras by `html_card`.
"""

from __future__ import annotations

import html
import math
import struct
import zlib
from base64 import b64encode
from collections.abc import Mapping

import numpy as np
import numpy.typing as npt

from evs.msgs.errors import EvsError
from evs.msgs.event import Events

U8 = npt.NDArray[np.uint8]
"""Pictures are uint8: (h, w) grey or (h, w, 3) sRGB."""

ON_RGB = (0, 114, 255)
"""Blue: the light grew. The field uses blue and red; this pair differs in hue, in lightness and
along the axis that every kind of colour blindness leaves (yellow-blue, or dark-light)."""

OFF_RGB = (224, 48, 16)
"""Red with a little orange: the light fell."""

PAPER = 255
"""Grey of the page, and of pixels without light or events."""

INK = 24
"""Grey of letters."""

FAINT = 208
"""Grey of the line around a panel."""


BRIGHT_SHARE = 0.99
"""This share of the pixels is not brighter than BRIGHT_LEVEL after exposure."""

BRIGHT_LEVEL = 0.8
"""Linear display light of the BRIGHT_SHARE quantile: a little room is left for highlights."""


def exposure_for(luminance: npt.NDArray[np.float32]) -> float:
    """The factor that brings a picture's bright parts near white.

    Args:
        luminance: (h, w) linear, in any unit; NaN, Inf and negative values are ignored.

    Returns:
        A factor above 0; 1.0 for a picture without any light, so that black stays black.
    """
    valid = luminance[np.isfinite(luminance) & (luminance > 0)]
    if not valid.size:
        return 1.0
    bright = float(np.quantile(valid, BRIGHT_SHARE))
    return BRIGHT_LEVEL / bright if bright > 0 else 1.0


def to_srgb8(luminance: npt.NDArray[np.float32], exposure: float) -> U8:
    """Code linear luminance as sRGB grey (IEC 61966-2-1).

    Args:
        luminance: (h, w) linear; NaN and negative light is black, +Inf is white.
        exposure: Factor; the product is white from 1.0 on.

    Returns:
        (h, w) uint8.
    """
    with np.errstate(over="ignore", invalid="ignore"):
        scaled = luminance.astype(np.float64) * exposure
    light = np.clip(np.nan_to_num(scaled, nan=0.0, posinf=1.0, neginf=0.0), 0.0, 1.0)
    coded = np.where(light <= 0.0031308, 12.92 * light, 1.055 * light ** (1 / 2.4) - 0.055)
    return np.rint(255.0 * coded).astype(np.uint8)


class SteadyExposure:
    """One exposure for the pictures of a camera: that of the brightest so far."""

    def __init__(self) -> None:
        """Start without a picture."""
        self._factor = math.inf

    def code(self, luminance: npt.NDArray[np.float32]) -> U8:
        """Code the next picture.

        Args:
            luminance: (h, w) linear, in one unit; as in `to_srgb8`.

        Returns:
            (h, w) uint8.
        """
        # one without light says nothing about the next
        if (luminance > 0).any():
            self._factor = min(self._factor, exposure_for(luminance))
        return to_srgb8(luminance, 1.0 if math.isinf(self._factor) else self._factor)


def event_frame(events: Events, width: int, height: int, background: U8 | None = None) -> U8:
    """Draw events in colour over a grey picture.

    Args:
        events: (n,) EVENT_DTYPE; a pixel with several events has the colour of the last one.
        width: Sensor width, px.
        height: Sensor height, px.
        background: (height, width) grey; None: paper white.

    Returns:
        (height, width, 3).

    Raises:
        EvsError: An event lies outside the sensor, or the background has another size.
    """
    if background is None:
        grey = np.full((height, width), PAPER, np.uint8)
    else:
        grey = background
    if grey.shape != (height, width):
        size = " x ".join(str(n) for n in grey.shape[::-1])
        raise EvsError(f"the background is {size}, not {width} x {height}: give the sensor's size")
    frame = np.repeat(grey[:, :, np.newaxis], 3, axis=2)
    x, y = events["x"], events["y"]
    outside = (x < 0) | (x >= width) | (y < 0) | (y >= height)
    if outside.any():
        first = events[np.argmax(outside)]
        raise EvsError(
            f"an event at ({first['x']}, {first['y']}) is outside the sensor of "
            f"{width} x {height}: the file's resolution is wrong"
        )
    # with repeated indices numpy keeps the last assignment: the last event wins
    colours = np.array([OFF_RGB, ON_RGB], np.uint8)
    frame[y, x] = colours[(events["p"] != 0).astype(np.intp)]
    return frame


def png_bytes(picture: U8) -> bytes:
    """A picture, (h, w, 3), as the bytes of a PNG file."""
    height, width, _ = picture.shape
    # a byte before each row: not filtered
    rows = np.zeros((height, 1 + 3 * width), np.uint8)
    rows[:, 1:] = picture.reshape(height, -1)
    head = struct.pack(">IIBBBBB", width, height, 8, 2, 0, 0, 0)
    chunks = (b"IHDR", head), (b"IDAT", zlib.compress(rows.tobytes())), (b"IEND", b"")
    return b"\x89PNG\r\n\x1a\n" + b"".join(
        struct.pack(">I", len(data)) + name + data + struct.pack(">I", zlib.crc32(name + data))
        for name, data in chunks
    )


def html_card(
    title: str, facts: Mapping[str, str], picture: U8, rates: tuple[Events, int] | None = None
) -> str:
    """What a notebook shows: a picture, facts beside it, and a curve of event rates.

    Args:
        title: A line above the facts.
        facts: Name -> value, in their order.
        picture: (h, w, 3).
        rates: Events, (n,) sorted by t, and the number of intervals that they are counted in; None:
            no curve.

    Returns:
        HTML without scripts.
    """
    width = picture.shape[1]
    source = b64encode(png_bytes(picture)).decode()
    rows = "".join(
        f'<tr><td style="text-align:left;color:gray">{html.escape(name)}</td>'
        f'<td style="text-align:left">{html.escape(value)}</td></tr>'
        for name, value in facts.items()
    )
    shown = min(2 * width, max(width, 480))
    curve = "" if rates is None else _rate_curve(*rates)
    return (
        '<div style="display:flex;gap:16px;align-items:flex-start">'
        f'<img alt="{html.escape(title)}" width="{shown}" '
        f'style="image-rendering:pixelated;border:1px solid rgb({FAINT},{FAINT},{FAINT})" '
        f'src="data:image/png;base64,{source}">'
        f"<div><b>{html.escape(title)}</b><table>{rows}</table>{curve}</div></div>"
    )


def _rate_curve(events: Events, intervals: int) -> str:
    """Events per interval of ON and OFF, as two lines of an SVG."""
    width, height = 240, 48
    span = (int(events["t"][0]), int(events["t"][-1]) + 1)
    counts = [
        np.histogram(events["t"][(events["p"] != 0) == on], intervals, span)[0]
        for on in (False, True)
    ]
    most = max(1, *(int(each.max()) for each in counts))
    lines = []
    for each, colour in zip(counts, (OFF_RGB, ON_RGB), strict=True):
        points = " ".join(
            f"{width * (k + 0.5) / intervals:.1f},{height - 1 - (height - 2) * n / most:.1f}"
            for k, n in enumerate(each.tolist())
        )
        lines.append(f'<polyline fill="none" stroke="rgb{colour}" points="{points}"/>')
    peak = most * intervals * 1e6 / (span[1] - span[0])
    return (
        f'<svg width="{width}" height="{height}">{"".join(lines)}</svg>'
        f'<div style="color:gray">peak {peak:,.0f} events/s of one polarity</div>'
    )


def event_facts(events: Events) -> dict[str, str]:
    """How many events there are, of each polarity and per second: for `html_card`."""
    on = int(np.count_nonzero(events["p"]))
    facts = {"events": f"{len(events):,} ({on:,} ON, {len(events) - on:,} OFF)"}
    if len(events):
        first, last = int(events["t"][0]), int(events["t"][-1])
        facts["time"] = f"{first:,} to {last:,} us"
        if last > first:
            facts["rate"] = f"{1e6 * len(events) / (last - first):,.0f} events/s"
    return facts
