"""Track a line by events: each event pulls it a little. After Conradt et al.

The line u = base + slope v minimises a quadratic form in (base, slope): the sum over all events of
weight (u - base - slope v)^2. Each event is added to its five sums, and the older sums decay.
Events far from the last line (noise, other objects) have little weight. The line of a frame is
fitted in the same way: the weight of a pixel is its darkness.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
import numpy.typing as npt

from evs.msgs import Events, EvsError

F64 = npt.NDArray[np.float64]

LOWEST_PX = 2.5
"""pixels nearer to the row of the cup show the cup and the cart"""

CUP_SHARE = 10.0
"""weight of the line's beginning in the cup, relative to that of all events"""


@dataclass(frozen=True)
class StickLine:
    """u = base + slope v in an image with the principal point as origin and v upwards."""

    base: float
    """u in the row of the cup, px"""
    slope: float


@dataclass(frozen=True)
class PrincipalPoint:
    """The principal point of a camera, counted from the centre of its first pixel, px."""

    x: float = 63.5
    y: float = 119.5


class EventLineTracker:
    """The line that a camera's events follow."""

    def __init__(
        self,
        height_px: float,
        *,
        memory: float = 0.5,
        sigma_px: float = 3.0,
        edge_px: float = 1.3,
        principal_point: PrincipalPoint | None = None,
    ) -> None:
        """Begin with an upright line in the middle.

        Args:
            height_px: height of the stick in the image.
            memory: events that count, for each of its rows.
            sigma_px: how far from an edge an event may be and still count.
            edge_px: how far the edges are from the line, a little less than half of the stick's
                width, since the log of light changes most where a pixel is nearly covered.
            principal_point: of the camera.
        """
        if not (height_px > 0 and memory * height_px > 1 and sigma_px > 0 and edge_px >= 0):
            raise EvsError(
                "a line needs height_px and sigma_px over 0, edge_px of 0 or more, and a memory of "
                "more than an event"
            )
        self._origin = principal_point or PrincipalPoint()
        self._sigma, self._edge = sigma_px, edge_px
        # natural logarithm of the share of the sums that remains after an event
        self._decay = float(np.log1p(-1.0 / (memory * height_px)))
        # as certain of an upright line as after many events on it
        v = np.linspace(LOWEST_PX, LOWEST_PX + height_px, 16)
        share = memory * height_px / len(v)
        self._sums = share * _moments(np.ones_like(v), np.zeros_like(v), v)
        self._line = StickLine(0.0, 0.0)

    def update(self, events: Events, cup_px: float = 0.0) -> StickLine:
        """Update the line by the events of a packet, all at once.

        The sums are relative to the cup, so they move with it, and the line should begin there.

        Args:
            events: (n,) EVENT_DTYPE.
            cup_px: position of the cup now, from the encoders.

        Returns:
            The line.
        """
        u = events["x"] - (self._origin.x + cup_px)
        v = self._origin.y - events["y"]
        off = u - (self._line.base + self._line.slope * v)
        # an event is of the edge on its side of the line
        side = self._edge * np.sign(off)
        u, off = u - side, off - side
        near = (v > LOWEST_PX) & (np.abs(off) < 3.0 * self._sigma)
        u, v, off = u[near], v[near], off[near]
        if len(u):
            # the last event has not decayed, the first has most
            weight = np.exp(-0.5 * (off / self._sigma) ** 2 + self._decay * np.arange(len(u))[::-1])
            self._sums = np.exp(self._decay * len(u)) * self._sums + _moments(weight, u, v)
            cup = np.array([CUP_SHARE * self._sums[0], 0.0, 0.0, 0.0, 0.0])
            self._line = _solve(self._sums + cup) or self._line
        return StickLine(cup_px + self._line.base, self._line.slope)


class FrameLineTracker:
    """The line of dark pixels in a frame, on a bright background."""

    def __init__(
        self, width: int, height: int, principal_point: PrincipalPoint | None = None
    ) -> None:
        """Prepare the coordinates of the pixels.

        Args:
            width: of the frames, px.
            height: of the frames, px.
            principal_point: of the camera.
        """
        principal_point = principal_point or PrincipalPoint()
        rows = int(principal_point.y - LOWEST_PX) + 1
        u, v = np.arange(width) - principal_point.x, principal_point.y - np.arange(height)[:rows]
        self._rows, self._u, self._v = rows, u, v

    def update(self, pixels: npt.NDArray[np.generic]) -> StickLine | None:
        """Fit the line of a frame.

        Args:
            pixels: (h, w) proportional to the light.

        Returns:
            The line; None: nothing is dark enough to be a stick.
        """
        part = pixels[: self._rows].astype(np.float64)
        bright = float(np.max(part))
        dark = np.clip(1.0 - part / bright - 0.1, 0.0, None) if bright > 0.0 else 0.0 * part
        row = dark.sum(1)
        across = dark @ self._u
        v = self._v
        return _solve(np.array([row.sum(), row @ v, row @ (v * v), across.sum(), across @ v]))


def _moments(weight: F64, u: F64, v: F64) -> F64:
    """(5,) sums of weight times 1, v, v^2, u, u v."""
    heavy = weight * v
    return np.array([weight.sum(), heavy.sum(), heavy @ v, weight @ u, heavy @ u])


def _solve(sums: F64) -> StickLine | None:
    """The line that minimises the quadratic form; None: the sums define no line."""
    w, wv, wvv, wu, wuv = (float(value) for value in sums)
    spread = w * wvv - wv * wv
    # w^2 times the variance of v: a line of less than a pixel's height has no slope
    if not spread > 0.08 * w * w:
        return None
    slope = (w * wuv - wv * wu) / spread
    return StickLine((wu - slope * wv) / w, slope)
